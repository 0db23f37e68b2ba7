"""Fingertips set down by a person: the arm goes above a place and releases its motors.

No camera sees the trays, and no force is felt by this arm. A person finds a corner to half a
millimetre; where the finger tips are then, the calibrated arm knows.
"""

import asyncio
from typing import Any, Final

import numpy as np

from controller.arrays import FloatArray
from controller.calibration.reach import rows_down, shifted
from controller.planning import JointPath, NoMotionError
from controller.planning.model import CellLayout
from controller.planning.motion import Scene, connect, segment_seconds, tcp_pose
from controller.setup.measured_arm import measured_arm
from drivers.kinds import Stop
from messages import say

from ..bench import SLOW, Bench
from ..errors import StepFailedError
from ..person import Errand

ABOVE_MM: Final = 30.0  # height over a place at which a person takes over
MARGIN_MM: Final = 10.0
CLOSED_MM: Final = 2.0  # opening at which the tips look like one point and the jaws do not press
RISES: Final = 3  # moves by which the finger tips rise straight enough
READINGS: Final = 3
BETWEEN_S: Final = 0.3
STILL_MM: Final = 0.3  # largest change between two readings of fingertips held still by a person
BELOW_MM: Final = 2.0  # a place may be lower than the cell file has it
TRIED: Final = 12  # configurations above a place that are tried
SEARCHED: Final = 2


async def close_the_fingers(bench: Bench) -> None:
    """Bring the finger tips of empty jaws together."""
    await bench.move_jaws(
        f"the arm gripper closes to {CLOSED_MM:.0f} mm, empty",
        lambda: bench.arm.move_gripper_mm(CLOSED_MM),
    )


async def path_above(
    bench: Bench, scene: Scene, place_mm: FloatArray, name: str, *, is_folded: bool = False
) -> JointPath:
    """Return a path that ends with the fingertips above a place; empty if there is none.

    From its end the arm also gets down to the place.

    Parameters
    ----------
    bench : bench of the step
    scene : scene that has to be free
    place_mm : (3,) in the world
    name : name of the place, as a message begins
    is_folded : whether the arm may be folded so far that it cannot home from there
    """
    start = await bench.arm.read_q()
    goals = await asyncio.to_thread(_above, bench.layout, scene, place_mm, start)
    if not is_folded and goals:
        may_home = measured_arm(bench.layout).homes_from(np.array(goals))
        goals = [q for q, may in zip(goals, may_home, strict=True) if may]
    # by the arm's own detours to any of them, before one is searched for at length
    for is_long, some in ((False, goals[:TRIED]), (True, goals[:SEARCHED])):
        for q in some:
            try:
                return await asyncio.to_thread(connect, start, q, scene, name, search=is_long)
            except NoMotionError:
                continue
    return ()


def _above(
    layout: CellLayout, scene: Scene, place_mm: FloatArray, near: FloatArray
) -> list[FloatArray]:
    """Return configurations (6,) with the finger tips above a place, the quickest first."""
    q = rows_down(layout, place_mm + np.array([0.0, 0.0, ABOVE_MM]))
    if len(q):
        lowered = shifted(layout, q, np.array([0.0, 0.0, -ABOVE_MM - BELOW_MM]))
        q = q[layout.arm.within_limits(lowered)]
    q = q[scene.free(q, MARGIN_MM)] if len(q) else q
    return sorted(q, key=lambda one: float(segment_seconds(layout, near, one)))


async def set_down(
    bench: Bench, path: JointPath, name: str, text: str, order: dict[str, Any]
) -> tuple[FloatArray, FloatArray]:
    """Go above a place, have the finger tips guided onto it, and rise again.

    Parameters
    ----------
    bench : bench of the step
    path : path that ends above it
    name : name of the place, as a message begins
    text : instruction for a person
    order : equivalent order to an emulated cell

    Returns
    -------
    where the tips were (3,), and the joints (6,)

    Raises
    ------
    StepFailedError : the tips do not rest
    DeclinedError, NobodyThereError, CellError, DeviceError : it cannot be done
    """
    bench.evidence.show(f"going above {name}")
    await bench.motion.follow(path)
    await bench.person.confirm(
        "hold_arm",
        f"{name}: the motors release next, and the arm may sink by {ABOVE_MM:.0f} mm. Take "
        "hold of it above the gripper. Do you hold it?",
    )
    await bench.arm.stop(Stop.FREE)
    await bench.person.have_done(Errand("set_down", text, (order,)))
    at_mm, there = await _read_at_rest(bench, name)
    await bench.person.confirm(
        "let_go", "The motors hold next, and the arm rises. Take your hands away. Are they away?"
    )
    await bench.motion.enable_power()
    # where it was before, it was free; now it is near that
    up_mm = np.linspace(0.0, ABOVE_MM, RISES + 1)[1:]
    for high_mm in up_mm:
        risen = shifted(bench.layout, there[None], np.array([0.0, 0.0, high_mm]))[0]
        if not bench.layout.arm.within_limits(risen):
            raise StepFailedError(
                say("{name}: the arm cannot rise from where it was guided to", name=name)
            )
        await bench.motion.follow((risen,), first_speed=SLOW)
    return at_mm, there


async def _read_at_rest(bench: Bench, name: str) -> tuple[FloatArray, FloatArray]:
    rows = []
    for _ in range(READINGS):
        rows.append(await bench.arm.read_q())
        await bench.clock.sleep(BETWEEN_S)
    q = np.array(rows)
    points = tcp_pose(bench.layout, q)[:, :3, 3]
    apart_mm = float(np.ptp(points, axis=0).max())
    if apart_mm > STILL_MM:
        raise StepFailedError(
            say(
                "{name}: the finger tips moved by {apart_mm:.1f} mm while they "
                "were read; hold them still and repeat the step",
                name=name,
                apart_mm=apart_mm,
            )
        )
    return points[-1], q[-1]
