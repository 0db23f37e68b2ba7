"""The plate handed to the fixed gripper and back: the effect of a hand-off on a pose.

The inspection camera sees the plate in the arm gripper before and after. In between the arm
releases it, draws back, returns and closes. The difference is the disagreement between fixed
gripper and arm, plus the motion of jaws in closing.
"""

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import degrees
from typing import Any, Final

import numpy as np

from controller.arrays import FloatArray
from controller.calibration.kinematics import BoardPicture
from controller.cell.custody import Custody
from controller.imaging import rotation_angle
from controller.planning import JointPath
from controller.planning.motion import Scene, inverse_rows
from messages import say

from ..bench import Bench, with_clearance
from ..boards import HALF_OPEN_MM, HANDED_MM, PLATE_FORCE, PlateInJaws
from ..errors import StepFailedError

# largest error of a fixed gripper that was placed by tape measure
TAPE_MM: Final = 5.0
MARGIN_MM: Final = 5.0
OVER_MM: Final = 12.0  # length of plate beyond the middle of the fixed pads
OUT_MM: Final = 130.0  # retreat along the arm's approach that clears the fixed fingers of the plate
BACK_MM: Final = 40.0  # retreat that clears the arm's fingers of the plate
STEP_MM: Final = 10.0
TURNS_DEG: Final = (0.0, 15.0, -15.0, 30.0, -30.0)  # turns of the plate tried, in its plane
TURNING: Final = (0, 1, 2, 4, 5)  # joints that are angles
LEAP_RAD: Final = 0.5  # largest step between waypoints; more is another configuration
FORCE_N: Final = 40.0
OFF_MM: Final = 3.0  # largest difference of the fixed jaws' opening from the plate's thickness


@dataclass(frozen=True, slots=True)
class ProvenHandOff:
    """The plate's pose in the arm gripper after a hand-off there and back.

    Attributes
    ----------
    mm : moved, where the pads hold it
    deg : turned
    """

    mm: float
    deg: float


async def hand_off_and_back(
    bench: Bench,
    held: PlateInJaws,
    views: Sequence[FloatArray],
    pose_in_jaws: Callable[[BoardPicture], FloatArray],
) -> ProvenHandOff:
    """Hand the plate to the fixed gripper and back; return its pose in the jaws afterwards.

    Parameters
    ----------
    bench : bench of the step
    held : plate in the arm gripper
    views : configurations (6,) that show it to the inspection camera, tried in turn
    pose_in_jaws : returns T_tcp_plate (4, 4) of a picture

    Raises
    ------
    StepFailedError : no path is free, the plate is not seen, or a gripper does not hold it
    DeclinedError, CellError, DeviceError : it cannot be done
    """
    before, view = await _shown(held, views, "before_hand_off")
    line = await _line(bench, held)
    fixed = bench.devices.gripper
    if not (await fixed.status()).is_activated:
        await bench.move_jaws("the fixed gripper is activated and may move", fixed.activate)
    widest_mm = fixed.max_opening_mm
    await bench.move_jaws("the fixed gripper opens", lambda: fixed.open_to(widest_mm))
    await bench.motion.follow(line)
    try:
        await _give(bench, held.plate.board.plate_mm[2])
    except StepFailedError:
        # the arm still has it: out of the fixed gripper first, as it came
        await bench.move_jaws("the fixed gripper opens", lambda: fixed.open_to(widest_mm))
        await bench.motion.follow(tuple(reversed(line[:-1])))
        raise
    count = round(BACK_MM / STEP_MM)
    away = tuple(line[-1 - i] for i in range(1, count + 1))
    await bench.motion.follow(away)
    await bench.motion.follow((*reversed(away[:-1]), line[-1]))
    await _receive(bench)
    await bench.motion.follow(tuple(reversed(line[:-1])))
    after, _ = await _shown(held, (view,), "after_hand_off")
    T_before, T_after = pose_in_jaws(before), pose_in_jaws(after)
    return ProvenHandOff(
        float(np.linalg.norm(T_after[:3, 3] - T_before[:3, 3])),
        degrees(rotation_angle(T_before[:3, :3].T @ T_after[:3, :3])),
    )


async def _shown(
    held: PlateInJaws, views: Sequence[FloatArray], name: str
) -> tuple[BoardPicture, FloatArray]:
    for q in views:
        picture = await held.shown("inspection", q, name, from_below=True)
        if picture is not None:
            return picture, q
    raise StepFailedError(
        say(
            "{name}: the inspection camera does not see the plate; see which "
            "pictures were left out, and why",
            name=name,
        )
    )


async def _give(bench: Bench, thickness_mm: float) -> None:
    """Close the fixed gripper on the plate, then open the arm's jaws."""
    fixed = bench.devices.gripper
    found: list[Any] = []

    async def close() -> None:
        found.append(await fixed.close_on(thickness_mm, force_n=FORCE_N))

    await bench.move_jaws("the fixed gripper closes on the plate", close)
    opening_mm = found[0].opening_mm
    if not found[0].object_detected or abs(opening_mm - thickness_mm) > OFF_MM:
        raise StepFailedError(
            say(
                "the fixed gripper closed to {opening_mm:.1f} mm, the plate is "
                "{thickness_mm:g} mm thick: the gripper is not at its pose in the "
                "cell file; repeat the step `grippers`, or measure and correct it",
                opening_mm=opening_mm,
                thickness_mm=thickness_mm,
            )
        )
    bench.handed.custody = Custody.IN_BOTH
    await bench.move_jaws(
        f"the arm gripper opens to {HALF_OPEN_MM:.0f} mm; the fixed gripper holds the plate",
        lambda: bench.arm.move_gripper_mm(HALF_OPEN_MM),
    )
    bench.handed.custody = Custody.IN_FIXED


async def _receive(bench: Bench) -> None:
    """Close the arm's jaws on the plate, then open the fixed gripper."""
    fixed = bench.devices.gripper
    await bench.move_jaws(
        "the arm gripper closes on the plate", lambda: bench.arm.grasp(PLATE_FORCE)
    )
    bench.handed.custody = Custody.IN_BOTH
    await bench.move_jaws(
        "the fixed gripper opens; the arm gripper holds the plate",
        lambda: fixed.open_to(fixed.max_opening_mm),
    )
    bench.handed.custody = Custody.NONE


async def _line(bench: Bench, held: PlateInJaws) -> JointPath:
    """Return a path to where both grippers hold the plate; its last part is a straight line.

    The line has a waypoint every `STEP_MM`, and the path starts at its first waypoint: the arm's
    path to it is checked at once.
    """
    layout = with_clearance(bench.layout, TAPE_MM)
    thickness_mm = held.plate.board.plate_mm[2]
    scene = Scene(layout, thickness_mm + 2.0, layout.fixed_open_mm, carried=held.plate.box)
    fallen: list[str] = []
    lines = await asyncio.to_thread(hand_off_lines, bench, held, scene)
    for line in lines:
        try:
            path = await bench.path_to(line[0], scene, "bringing the plate to the fixed gripper")
        except StepFailedError as error:
            fallen.append(str(error))
            continue
        await bench.motion.follow(path)
        return tuple(line)
    raise StepFailedError(
        fallen[0]
        if fallen
        else (
            "bringing the plate to the fixed gripper: no path there is free of contact; check "
            "the pose of the fixed gripper"
        )
    )


def hand_off_lines(bench: Bench, held: PlateInJaws, scene: Scene) -> list[FloatArray]:
    """Return straight lines (n, 6) to poses in which both grippers hold the plate, all free.

    Parameters
    ----------
    bench : bench of the step
    held : in the arm gripper, for where its far end is
    scene : scene with the plate in the arm gripper
    """
    layout = bench.layout
    if layout.fixed_gripper is None:
        return []
    box = held.plate.box
    far_mm = box.T[0, 3] + box.half_mm[0] - HANDED_MM
    pads = np.array([-layout.fixed_gripper.pad_centre_mm, 0.0, 0.0])
    backs = np.arange(OUT_MM, -0.5 * STEP_MM, -STEP_MM)
    found = []
    for turn_deg in TURNS_DEG:
        for flip in (1.0, -1.0):
            c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
            T = np.eye(4)
            T[:3, :3] = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ np.diag([-1.0, flip, -flip])
            T[:3, 3] = pads - T[:3, :3] @ np.array([far_mm - OVER_MM, 0.0, 0.0])
            T = layout.T_world_fixed_tcp @ T
            poses = np.repeat(T[None], len(backs), axis=0)
            poses[:, :3, 3] -= backs[:, None] * T[:3, 0]
            found += _branches(bench, poses, scene)
    return found


def _branches(bench: Bench, poses: FloatArray, scene: Scene) -> list[FloatArray]:
    """Return the configurations (n, 6) of poses (n, 4, 4), branch by branch, where all are free."""
    index, branch, q = inverse_rows(bench.layout, poses)
    found = []
    for one in np.unique(branch):
        rows, at = q[branch == one], index[branch == one]
        is_line = len(rows) == len(poses) and bool((np.diff(at) > 0).all())
        is_line = is_line and np.abs(np.diff(rows[:, TURNING], axis=0)).max() < LEAP_RAD
        if is_line and scene.free(rows, MARGIN_MM).all():
            found.append(rows)
    return found
