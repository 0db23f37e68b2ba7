"""How the arm is built, and what its driver makes of jaws, joints and stops."""

import asyncio

import numpy as np
import pytest

from controller.cli.project.starter.drivers.arm import AcmeArm, Settings, SixAxis
from controller.cli.project.starter.drivers.arm.emulator import AcmeDevice, serve
from drivers.clock import CellClock
from drivers.errors import ArmStalledError, PositionLostError

ARM = SixAxis()


def _driver(address: str, settings: Settings) -> AcmeArm:
    host, _, port = address.rpartition(":")
    return AcmeArm(host, int(port), settings, CellClock(), reply_s=1.0, limits=ARM)


def test_every_branch_of_the_inverse_brings_the_tcp_to_its_pose() -> None:
    """Go to drawn configurations, and back by the inverse; one branch is the one drawn."""
    drawn = ARM.spread(np.random.default_rng(1).random((200, 6)))
    index, _, q = ARM.inverse(ARM.forward(drawn))
    np.testing.assert_allclose(ARM.forward(q), ARM.forward(drawn)[index], atol=1e-6)
    nearest = [np.abs(q[index == k] - drawn[k]).max(axis=1).min() for k in range(len(drawn))]
    assert max(nearest) < 1e-6


def test_a_part_stops_the_jaws_and_is_pressed_on() -> None:
    """Close on a part of 30 mm."""

    async def story() -> None:
        device = AcmeDevice()
        async with serve(device) as address:
            arm = _driver(address, Settings())
            await arm.connect()
            await arm.enable_power()
            await arm.home()
            device.part_mm = 30.0
            assert await arm.grasp(40) == pytest.approx(30.0, abs=0.01)
            assert (await arm.read_jaws()).is_pressing
            await arm.aclose()

    asyncio.run(story())


def test_an_arm_that_stands_still_is_stopped_and_reported() -> None:
    """Block the joints: the move ends, and no goal is left in the controller."""

    async def story() -> None:
        device = AcmeDevice()
        async with serve(device) as address:
            arm = _driver(address, Settings(move_s=1.0))
            await arm.connect()
            await arm.enable_power()
            await arm.home()
            device.is_blocked = True
            before = await arm.read_q()
            with pytest.raises(ArmStalledError):
                await arm.move_joints(before + np.radians([20.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
            device.is_blocked = False
            np.testing.assert_allclose(await arm.read_q(), before, atol=1e-6)
            await arm.aclose()

    asyncio.run(story())


def test_positions_are_taken_over_only_where_the_arm_was_sent() -> None:
    """Claim that it was sent elsewhere, then where it is."""

    async def story() -> None:
        async with serve(AcmeDevice()) as address:
            arm = _driver(address, Settings())
            await arm.connect()
            there = np.radians([[0.0, 110.0, -110.0, 0.0, 90.0, 0.0]])
            with pytest.raises(PositionLostError):
                await arm.take_over_positions(there + 0.1)
            await arm.take_over_positions(there)
            assert arm.is_homed
            await arm.aclose()

    asyncio.run(story())
