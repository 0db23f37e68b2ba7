"""Where the arm's tip and links are in the world, and which joints bring the tip to a pose."""

from __future__ import annotations

import numpy as np

from controller.arrays import FloatArray, IntArray
from controller.imaging import inverse_pose
from drivers.umi_scara.kinematics import forward, inverse_legal
from drivers.umi_scara.kinematics import link_frames as frames_in_arm

from ..geometry import stack
from ..model import CellLayout

HEADINGS_RAD = np.radians(np.arange(-180.0, 180.0, 30.0))  # tried where the hand points down
# a hand this close to straight down is taken as straight down: its heading would be noise
VERTICAL = 2e-3


def inverse_rows(
    layout: CellLayout, T_world_tip: FloatArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return all legal configurations of tip poses (n, 4, 4): index (m,), branch (m,), q (m, 6).

    The branch number means the same for all poses of one orientation (elbow sign, wrist branch or
    heading), so that a straight line keeps its branch.
    """
    T = inverse_pose(layout.T_world_arm) @ T_world_tip
    down = np.hypot(T[:, 0, 0], T[:, 1, 0]) < VERTICAL
    if down.any():
        T[down, :3, :3] = _straightened(T[down, :3, :3])
    return inverse_legal(T, layout.arm, heading_rad=HEADINGS_RAD)


def _straightened(R: FloatArray) -> FloatArray:
    out = np.zeros_like(R)
    out[:, 2, 0] = np.sign(R[:, 2, 0])
    y = R[:, :, 1].copy()
    y[:, 2] = 0.0
    out[:, :, 1] = y / np.linalg.norm(y, axis=1, keepdims=True)
    out[:, :, 2] = np.cross(out[:, :, 0], out[:, :, 1])
    return out


def tip_pose(layout: CellLayout, q: FloatArray) -> FloatArray:
    """Return T_world_tip (..., 4, 4) of configurations (..., 6)."""
    return np.asarray(layout.T_world_arm @ forward(q, layout.arm))


def link_frames(layout: CellLayout, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return rotations (n, k, 3, 3) and origins (n, k, 3) of the k links in the world."""
    R, origin_mm = frames_in_arm(q, layout.arm)
    T = layout.T_world_arm
    return T[:3, :3] @ R, origin_mm @ T[:3, :3].T + T[:3, 3]


def link_boxes(layout: CellLayout, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the links' boxes in the world of configurations (n, 6): (n, k, 4, 4), (n, k, 3)."""
    R, origin_mm = link_frames(layout, q)
    T_box, half_mm = stack([layout.carriage, layout.upper, layout.fore])
    T = np.zeros((*R.shape[:2], 4, 4))
    T[..., 3, 3] = 1.0
    T[..., :3, :3] = R @ T_box[:, :3, :3]
    T[..., :3, 3] = (R @ T_box[:, :3, 3, None])[..., 0] + origin_mm
    return T, np.broadcast_to(half_mm, (*R.shape[:2], 3))


def shown_pose(layout: CellLayout, q: FloatArray, T_part_hand: FloatArray) -> FloatArray:
    """Return T_world_part of a part held at `T_part_hand`, measured or planned, at joints (6,)."""
    T: FloatArray = tip_pose(layout, np.asarray(q)) @ inverse_pose(T_part_hand)
    return T
