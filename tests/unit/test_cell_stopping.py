"""Stopping in parallel: a silent device does not delay the stop of any other."""

import asyncio

from controller.cell.devices.stopping import stop_side_by_side
from drivers.clock import CellClock
from drivers.errors import LinkError


async def test_the_lamps_and_the_fixed_gripper_do_not_wait_for_a_silent_arm() -> None:
    stopped: list[str] = []
    others_stopped = asyncio.Event()

    async def arm() -> None:
        await others_stopped.wait()  # silent until the others have been stopped
        raise LinkError("arm: silent")

    async def gripper() -> None:
        stopped.append("gripper")

    async def lights() -> None:
        stopped.append("lights")
        others_stopped.set()

    stops = {"arm": arm, "gripper": gripper, "lights": lights}
    failures = await stop_side_by_side(stops, CellClock())
    assert stopped == ["gripper", "lights"]
    assert {name: str(error) for name, error in failures.items()} == {"arm": "arm: silent"}


async def test_a_device_that_never_confirms_is_given_up_and_named() -> None:
    never = asyncio.Event()

    async def quick() -> None: ...

    failures = await stop_side_by_side(
        {"arm": never.wait, "gripper": quick}, CellClock(speed=1000.0), limit_s=1.0
    )
    assert list(failures) == ["arm"]
    assert isinstance(failures["arm"], TimeoutError)
