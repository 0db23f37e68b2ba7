"""Whether the arm gripper holds a plate without slip: looked at before and after a shake."""

from math import degrees
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.calibration.kinematics import KinematicsError, board_pose, plate_faces
from controller.calibration.showing import ShowingRegion
from controller.imaging import inverse_pose, rotation_angle
from controller.planning.model import JOINT_COUNT
from controller.planning.motion import slides
from messages import key, say

from ..bench import Bench
from ..boards import PlateInJaws
from ..errors import StepFailedError

REGION: Final = ShowingRegion(550.0, 850.0)  # distance from the inspection camera [mm]
MARGIN_MM: Final = 25.0
CHOICES: Final = 12  # number of places tried to show the plate at
SEED: Final = 4
SHAKES: Final = 3
SWUNG: Final = (4, 5, 3)  # joints that are swung one after the other: near the gripper
SWING_RAD: Final = np.radians(6.0)
SWING_MM: Final = 12.0
SLIP_MM: Final = 0.5
SLIP_DEG: Final = 0.3


async def shake(bench: Bench, held: PlateInJaws) -> None:
    """Show a held plate, shake it at the arm's usual speed, show it again; record the shift.

    Parameters
    ----------
    bench : bench of the step
    held : the plate, between the arm's jaws

    Raises
    ------
    StepFailedError : the plate cannot be shown, or is not found
    DeviceError : a device does not answer or does not get there
    """
    q, swings = _where(bench, held)
    before = await _pose(bench, held, q, "held_before")
    for _ in range(SHAKES):
        for step in swings:
            await bench.motion.follow((q + step, q - step, q))
    after = await _pose(bench, held, q, "held_after")
    height_mm = held.plate.board.plate_mm[1]
    middle = np.array([height_mm / 2.0, 0.0, 0.0])
    moved_mm = float(np.linalg.norm((after - before)[:3, :3] @ middle + (after - before)[:3, 3]))
    turned_deg = degrees(rotation_angle(before[:3, :3].T @ after[:3, :3]))
    bench.evidence.measure("slip of the plate in the arm's jaws", moved_mm, "mm", high=SLIP_MM)
    bench.evidence.measure("turn of the plate in the arm's jaws", turned_deg, "deg", high=SLIP_DEG)


def _where(bench: Bench, held: PlateInJaws) -> tuple[FloatArray, list[FloatArray]]:
    """Return the joints (6,) for showing the plate, and the swings free of contact there."""
    rng = np.random.default_rng(SEED)
    rows = held.configurations(
        "inspection", REGION, CHOICES, rng, is_front=True, margin_mm=MARGIN_MM
    )
    limits = bench.layout.arm.within_limits
    sizes = np.where(slides(bench.layout.arm), SWING_MM, SWING_RAD)
    swings = [np.eye(JOINT_COUNT)[joint] * sizes for joint in SWUNG]
    for q in rows:
        ends = np.stack([q + sign * step for step in swings for sign in (1, -1)])
        if held.within_reach(q) and limits(ends).all() and held.scene.free(ends, MARGIN_MM).all():
            return q, swings
    raise StepFailedError(
        key(
            "no place was found where the inspection camera sees the plate and the arm may "
            "shake it; check the camera's pose and the obstacles in the cell file"
        )
    )


async def _pose(bench: Bench, held: PlateInJaws, q: FloatArray, name: str) -> FloatArray:
    """Return T_cam_body (4, 4) of the plate at a configuration (6,)."""
    found = await held.shown("inspection", q, name, from_below=None)
    if found is None:
        raise StepFailedError(
            say(
                "the plate was not found in the picture {name}; {findings}",
                name=name,
                findings=bench.evidence.findings[-1],
            )
        )
    faces = dict(zip(("front", "back"), plate_faces(held.plate.board), strict=True))
    try:
        T_cam_board = board_pose(bench.layout.inspection, found.board)
    except KinematicsError as error:
        raise StepFailedError(f"{name}: {error}") from error
    return np.asarray(T_cam_board @ inverse_pose(faces[found.face].T_body_board))
