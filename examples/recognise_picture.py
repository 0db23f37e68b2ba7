"""Put a part on the emulated table, take a picture, recognise the part."""

import asyncio
from math import degrees

from controller.interface import open_cell, recognise_picture, shipped_file

PARTS = [shipped_file("parts/holder.stl"), shipped_file("parts/flange_xy.stl")]


async def main() -> None:
    async with open_cell(parts=PARTS[:1], at="360,20,30", speed=10) as cell:
        await cell.clock.sleep(2.0)  # until the part is at rest
        picture = await cell.take_picture("overhead", {"table_backlight": 1.0})
    for found in recognise_picture(picture, PARTS):
        pose = f"{found.x_mm:.1f} mm, {found.y_mm:.1f} mm, {degrees(found.theta_rad):.1f} degrees"
        print(f"{found.part}, stable pose {found.pose_index}, at {pose}")


asyncio.run(main())
