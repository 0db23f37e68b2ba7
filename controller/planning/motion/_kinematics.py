"""Kinematics in the world: poses of TCP and links, and joints for a pose of the TCP."""

from __future__ import annotations

import numpy as np

from controller.arrays import FloatArray, IntArray
from controller.imaging import inverse_pose

from ..geometry import stack
from ..model import ArmModel, CellLayout


def slides(arm: ArmModel) -> tuple[bool, ...]:
    """Return, per joint, whether it is linear [mm] by its name; the others turn [rad]."""
    return tuple(name.endswith("_mm") for name in arm.joint_names)


def inverse_rows(
    layout: CellLayout, T_world_tcp: FloatArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return all legal configurations of TCP poses (n, 4, 4): index (m,), branch (m,), q (m, 6).

    A straight line of the TCP keeps its branch.
    """
    return layout.arm.inverse(inverse_pose(layout.T_world_arm) @ T_world_tcp)


def passed_limit(layout: CellLayout, T_world_tcp: FloatArray) -> str:
    """Return the joint limit that TCP poses (n, 4, 4) pass, in words; empty without a branch."""
    q = layout.arm.branches(np.linalg.inv(layout.T_world_arm) @ T_world_tcp).reshape(-1, 6)
    q = q[np.isfinite(q).all(axis=1)]
    return layout.arm.limit_report(q[0]) if len(q) else ""


def tcp_pose(layout: CellLayout, q: FloatArray) -> FloatArray:
    """Return T_world_tip (..., 4, 4) of configurations (..., 6)."""
    return np.asarray(layout.T_world_arm @ layout.arm.forward(q))


def link_frames(layout: CellLayout, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return rotations (n, k, 3, 3) and origins (n, k, 3) of the k links in the world."""
    R, origin_mm = layout.arm.link_frames(q)
    T = layout.T_world_arm
    return T[:3, :3] @ R, origin_mm @ T[:3, :3].T + T[:3, 3]


def link_boxes(layout: CellLayout, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the links' boxes in the world of configurations (n, 6): (n, k, 4, 4), (n, k, 3)."""
    R, origin_mm = link_frames(layout, q)
    T_box, half_mm = stack(layout.arm.links)
    T = np.zeros((*R.shape[:2], 4, 4))
    T[..., 3, 3] = 1.0
    T[..., :3, :3], T[..., :3, 3] = placed_boxes(R, origin_mm, T_box)
    return T, np.broadcast_to(half_mm, (*R.shape[:2], 3))


def placed_boxes(
    R: FloatArray, origin_mm: FloatArray, T_box: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return rotations (n, k, 3, 3) and centres (n, k, 3) in the world of boxes in moving frames.

    Parameters
    ----------
    R, origin_mm : (n, k, 3, 3), (n, k, 3) of the frames; k is 1 where all boxes are in one
    T_box : (k, 4, 4) or (n, k, 4, 4) of the boxes in their frames
    """
    return R @ T_box[..., :3, :3], (R @ T_box[..., :3, 3, None])[..., 0] + origin_mm


def shown_pose(layout: CellLayout, q: FloatArray, T_part_tcp: FloatArray) -> FloatArray:
    """Return T_world_part (4, 4) of a part that the arm holds.

    Parameters
    ----------
    layout : the cell
    q : (6,) row of joints
    T_part_tcp : (4, 4) T_part_tcp, as planned or as measured
    """
    T: FloatArray = tcp_pose(layout, np.asarray(q)) @ inverse_pose(T_part_tcp)
    return T
