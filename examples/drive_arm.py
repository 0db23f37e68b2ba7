"""Home the arm, then turn its shoulder by ten degrees."""

import asyncio
from math import degrees, radians

from controller.interface import open_cell


async def main() -> None:
    async with open_cell(speed=10) as cell:
        arm = await cell.arm()
        await arm.home()  # sweeps its whole reach
        q = await arm.read_q()  # shoulder, elbow, yaw, zed, pitch, roll
        q[0] += radians(10.0 if q[0] < 0 else -10.0)
        await arm.move_joints(q)
        print(f"shoulder at {degrees((await arm.read_q())[0]):.1f} degrees")


asyncio.run(main())
