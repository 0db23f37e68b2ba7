"""Collision check of one joint move all the way, for the path the arm really takes.

The move is cut into pieces. A piece is free if the arm, at its middle, has more clearance than any
of its points travels to either end; else the piece is cut into four. So no contact between two
checked configurations is missed, and open space takes few checks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controller.arrays import BoolArray, FloatArray

from ..model import CellLayout
from ._kinematics import tcp_pose
from .scene import Scene
from .timing import segment_tube, tube_bound_mm

# margin beside the tube: calibration, backlash, the part's position in the arm gripper
MARGIN_MM = 5.0
# margin next to a hold or the fixed gripper, which the straight paths keep as well
END_MARGIN_MM = 2.0
END_LENGTH_MM = 60.0
PIECE_MM = 64.0  # length of the first pieces; each further cut makes a quarter
MIN_PIECE_MM = 4.0  # half of it is the end margin
BROAD_PHASE_MM = 30.0
BROAD_PHASE_TUBE_MM = 4.0  # usual radius of the tube of a short move
_TUBE_AT = np.linspace(0.0, 1.0, 49)


@dataclass(frozen=True, slots=True, eq=False)
class PathEnds:
    """TCP positions [mm] at both ends of a path, near which the margin is the thin one."""

    tcps_mm: FloatArray

    @classmethod
    def of(cls, layout: CellLayout, q_from: FloatArray, q_to: FloatArray) -> PathEnds:
        """Return the ends of a joint move.

        Parameters
        ----------
        layout : the cell
        q_from, q_to : (6,) rows of joints, where the whole path begins and ends
        """
        return cls(tcp_pose(layout, np.stack([q_from, q_to]))[:, :3, 3])

    def near(self, tcps_mm: FloatArray) -> BoolArray:
        """Return a mask (n,) of the TCP positions (n, 3) near one of the ends."""
        away = np.linalg.norm(tcps_mm[:, None] - self.tcps_mm[None], axis=2)
        return np.asarray(away.min(axis=1) < END_LENGTH_MM)


def segment_free(scene: Scene, q_from: FloatArray, q_to: FloatArray, ends: PathEnds) -> bool:
    """Return True if one joint move keeps the margins all the way, between its states as well.

    Parameters
    ----------
    scene : load on the arm, and the obstacles
    q_from, q_to : (6,) rows of joints
    ends : ends of the whole path that the move is part of; near them the margin is the smaller one
    """
    layout, step = scene.layout, q_to - q_from
    # linear, so all between are as well
    if not layout.arm.within_limits(np.stack([q_from, q_to])).all():
        return False
    radii = radii_mm(scene, q_from, q_to)
    travel_mm = float(np.abs(step) @ radii)
    bound_mm = tube_bound_mm(layout, step, radii)
    pieces = max(1, int(np.ceil(travel_mm / PIECE_MM)))
    middles = (np.arange(pieces) + 0.5) / pieces
    # most segments do without: they are free with its bound, or hit something at once
    tube_mm = None
    while True:
        q = q_from + middles[:, None] * step
        half_mm = travel_mm / pieces / 2
        near = ends.near(tcp_pose(layout, q)[:, :3, 3])
        margin = np.where(near, END_MARGIN_MM, MARGIN_MM)
        if tube_mm is None:
            tight = np.flatnonzero(~scene.free(q, margin + bound_mm + half_mm))
            if len(tight) == 0:
                return True
            if not scene.free(q[tight], margin[tight]).all():
                return False
            tube_mm = segment_tube(layout, q_from, q_to, _TUBE_AT)
            q, margin, middles = q[tight], margin[tight], middles[tight]
        margin = margin + np.interp(middles, _TUBE_AT, tube_mm)
        tight = np.flatnonzero(~scene.free(q, margin + half_mm))
        if len(tight) == 0:
            return True
        if not scene.free(q[tight], margin[tight]).all():
            return False
        if 2 * half_mm <= MIN_PIECE_MM:
            return True
        middles = (middles[tight, None] + (np.arange(4) - 1.5) / (4 * pieces)).ravel()
        pieces *= 4


def segment_seems_free(
    scene: Scene, q_from: FloatArray, q_to: FloatArray, ends: PathEnds, tube_mm: float = 0.0
) -> bool:
    """Return True if sampled states of a move are free; `segment_free` must follow.

    Parameters
    ----------
    scene : load on the arm, and the obstacles
    q_from, q_to : (6,) rows of joints
    ends : ends of the whole path that the move is part of
    tube_mm : added to the margin away from the ends
    """
    if not scene.layout.arm.within_limits(np.stack([q_from, q_to])).all():
        return False
    travel_mm = float(np.abs(q_to - q_from) @ radii_mm(scene, q_from, q_to))
    states = max(1, int(np.ceil(travel_mm / BROAD_PHASE_MM)))
    share = np.arange(1, states + 1)[:, None] / states
    q = q_from + share * (q_to - q_from)
    near = ends.near(tcp_pose(scene.layout, q)[:, :3, 3])
    margin = np.where(near, END_MARGIN_MM, MARGIN_MM + tube_mm)
    return bool(scene.free(q, margin).all())


def radii_mm(scene: Scene, q_from: FloatArray, q_to: FloatArray) -> FloatArray:
    """Return a bound on how far any point of arm, gripper or part moves with each joint (6,).

    In units of `ArmModel.radii_mm`, for the load of the arm in a scene.

    Parameters
    ----------
    scene : load on the arm
    q_from, q_to : (6,) rows of joints, of one move
    """
    return scene.layout.arm.radii_mm(q_from, q_to, *scene.reach_mm())
