"""What the emulated gripper can be made to do, and what the driver makes of it."""

import asyncio

import pytest

from controller.cli.project.starter.drivers.gripper import AcmeGripper, Settings
from controller.cli.project.starter.drivers.gripper.emulator import AcmeDevice, serve
from drivers.errors import StalledError
from drivers.kinds import Hold
from drivers.modbus_link import ModbusLink, TcpAddress


def test_a_part_is_held_until_it_is_taken_out() -> None:
    """Close on a part, then pull it out."""

    async def story() -> None:
        device = AcmeDevice()
        async with serve(device) as address:
            host, _, port = address.rpartition(":")
            async with ModbusLink(TcpAddress(host, int(port))) as link:
                gripper = AcmeGripper(link, 1, Settings())
                await gripper.connect()
                await gripper.activate()
                device.part_mm = 30.0
                grasp = await gripper.close_on(30.0, force_n=40.0)
                assert grasp.object_detected
                assert grasp.opening_mm == pytest.approx(30.0, abs=0.01)
                assert await gripper.hold() is Hold.HELD
                device.part_mm = 0.0
                await gripper.wait_lost()
                assert await gripper.hold() is Hold.LOST

    asyncio.run(story())


def test_jammed_jaws_end_the_move_in_time() -> None:
    """Let the jaws stand still: the move ends, and the gripper is stopped."""

    async def story() -> None:
        device = AcmeDevice()
        async with serve(device) as address:
            host, _, port = address.rpartition(":")
            async with ModbusLink(TcpAddress(host, int(port))) as link:
                gripper = AcmeGripper(link, 1, Settings(move_s=0.2))
                await gripper.connect()
                await gripper.activate()
                device.is_jammed = True
                with pytest.raises(StalledError):
                    await gripper.open_to(20.0)
                assert device.target_mm == device.opening_mm

    asyncio.run(story())
