"""The plate as a reference part: calibrated lengths, measured in every picture of it.

The arm predicts the plane of a print, the camera's sight lines meet it, and the distances between
its corners are compared with the board's file. Every dimension of a part is measured in this way,
so bias and scatter here are the best that any dimension can have.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.calibration.kinematics import BoardPicture, plate_faces
from controller.calibration.target import BoardSection
from controller.imaging import Camera, inverse_pose
from controller.planning.model import CellLayout
from controller.planning.motion import tcp_pose
from messages import key, say

from ..errors import StepFailedError

_SPREAD_MIN: Final = 0.5  # least share of a print's length between the corners seen


@dataclass(frozen=True, slots=True, eq=False)
class LengthStudy:
    """The errors of a known length over all pictures and both cameras.

    Attributes
    ----------
    reference_mm : nominal lengths along x and y of the print, by its file
    off_mm : (n, 2) error of each picture, measured less known
    bias_mm : mean of all
    repeatability_mm : standard deviation within one camera's pictures
    setup_mm : standard deviation between cameras, beyond what scatter explains
    """

    reference_mm: tuple[float, float]
    off_mm: FloatArray
    bias_mm: float
    repeatability_mm: float
    setup_mm: float

    @property
    def grr_mm(self) -> float:
        """Standard deviation of the gauge: repeatability and set-up."""
        return float(np.hypot(self.repeatability_mm, self.setup_mm))


def length_study(
    layout: CellLayout,
    board: BoardSection,
    pictures: Sequence[BoardPicture],
    T_tcp_body: FloatArray,
) -> LengthStudy:
    """Return the measuring error of the print's sides over pictures of one hold.

    Parameters
    ----------
    layout : as calibrated
    board : board of the plate
    pictures : pictures of it in the arm gripper, two at least of each of two cameras
    T_tcp_body : (4, 4) pose of the board in the gripper

    Raises
    ------
    StepFailedError : too few pictures, or too little of the print in one
    """
    names = np.array([one.camera for one in pictures])
    counts = [int((names == name).sum()) for name in np.unique(names)]
    if len(counts) < 2 or min(counts) < 2:
        raise StepFailedError(key("lengths are compared in two pictures of each camera at least"))
    found = [_lengths(layout, board, one, T_tcp_body) for one in pictures]
    reference = found[0][1]
    off = np.array([measured - known for measured, known in found])
    # by analysis of variance: pictures within a camera, cameras between each other
    within, between = [], []
    for name in np.unique(names):
        own = off[names == name]
        within.append(((own - own.mean(axis=0)) ** 2).sum())
        between.append(own.mean(axis=0))
    freedom = off.size - 2 * len(counts)
    repeat = float(sum(within) / freedom)
    each = np.array(between)
    spread = float(np.mean(each.var(axis=0, ddof=1)))
    setup = max(0.0, spread - repeat / float(np.mean(counts)))
    return LengthStudy(
        (float(reference[0]), float(reference[1])),
        off,
        float(off.mean()),
        float(np.sqrt(repeat)),
        float(np.sqrt(setup)),
    )


def _lengths(
    layout: CellLayout, board: BoardSection, picture: BoardPicture, T_tcp_body: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the print's sides (2,) as measured in a picture, and as known."""
    if picture.q is None:
        raise StepFailedError(say("{name}: the joints were not read", name=picture.name))
    face = plate_faces(board)[0 if picture.face == "front" else 1]
    T = tcp_pose(layout, picture.q) @ T_tcp_body @ face.T_body_board
    camera: Camera = getattr(layout, picture.camera)
    back = inverse_pose(T)
    eye = back[:3, :3] @ camera.position_mm + back[:3, 3]
    rays = camera.sight_lines(picture.board.pixels) @ back[:3, :3].T
    on_print = (eye - eye[2] / rays[:, 2:] * rays)[:, :2]
    known = picture.board.board_mm[:, :2]
    spread = np.ptp(known, axis=0)
    if board.squares is None:
        raise StepFailedError(key("the plate needs a ChArUco board on each face"))
    side = board.square_mm * (np.array(board.squares, dtype=float) - 2.0)  # of its inner corners
    if (spread < _SPREAD_MIN * side).any():
        raise StepFailedError(
            say("{name}: too little of the print is in sight to measure it", name=picture.name)
        )
    # an affine fit: the scale along either axis, whatever shift and turn the arm's errors leave
    by = np.column_stack([known - known.mean(axis=0), np.ones(len(known))])
    axes = np.linalg.lstsq(by, on_print, rcond=None)[0][:2]
    return np.linalg.norm(axes, axis=1) * side, side
