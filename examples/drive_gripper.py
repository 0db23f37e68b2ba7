"""Close the fixed gripper on what is between its jaws, then open it."""

import asyncio

from controller.interface import open_cell


async def main() -> None:
    async with open_cell(speed=10) as cell:  # open_cell("cell.yaml") for your own cell
        gripper = await cell.gripper()
        await gripper.activate()  # moves the jaws
        grip = await gripper.close_on(20.0, force_n=60.0)
        print(f"{gripper.model}: {grip.opening_mm:.1f} mm, part: {grip.object_detected}")
        await gripper.open_to(gripper.max_opening_mm)
        status = await gripper.status()
        print(f"open at {status.opening_mm:.1f} mm")


asyncio.run(main())
