"""The goal of a jog: configurations near by, and reasons against one. Arrays in, arrays out."""

from math import radians
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from controller.arrays import FloatArray
from controller.calibration.reach import near_rows
from controller.cell.errors import CellError
from controller.planning.model import JOINT_COUNT, ArmModel, CellLayout
from controller.planning.motion import END_MARGIN_MM, Scene, path_free, slides, tcp_pose

# Largest distance of a joint move from the straight line ordered.
STRAY_MM: Final = 1.0
STRAY_SHARE: Final = 0.1
# From a place that is too near to something, the arm may go where its clearance does not shrink.
_LADDER_MM: Final = np.array([20, 15, 10, 8, 6, 5, 4, 3, 2.5, 2, 1.5, 1, 0.5, 0, -1, -2, -3.0])
_FINE: Final = 201  # points at which a move from outside the limits is checked
_LOOKS: Final = np.linspace(0.0, 1.0, 9)


class RefusedMotionError(CellError):
    """A refused motion: soft limit, contact, or no configuration near by."""


def turned_joint(arm: ArmModel, q: FloatArray, number: int, by: float) -> FloatArray:
    """Return configuration q (6,) with one joint moved.

    Parameters
    ----------
    arm : arm concerned
    q : (6,)
    number : number of the joint, from 1
    by : degrees, mm for a slide

    Raises
    ------
    RefusedMotionError : there is no such joint
    """
    if not 1 <= number <= JOINT_COUNT:
        raise RefusedMotionError(f"there is no joint {number}; joints are 1 to {JOINT_COUNT}")
    goal = q.copy()
    goal[number - 1] += by if slides(arm)[number - 1] else radians(by)
    return goal


def shifted(T_world_tcp: FloatArray, direction: str, by_mm: float) -> FloatArray:
    """Return a pose (4, 4) moved along an axis.

    Parameters
    ----------
    T_world_tcp : (4, 4)
    direction : `x`, `y` or `z` of the world, or `advance` for its approach
    by_mm : distance or angle of the move
    """
    T = T_world_tcp.copy()
    along = T[:3, 0] if direction == "advance" else np.eye(3)["xyz".index(direction)]
    T[:3, 3] += by_mm * along
    return T


def turned(T_world_tcp: FloatArray, axis: str, by_deg: float) -> FloatArray:
    """Return a pose (4, 4) turned about its own origin.

    Parameters
    ----------
    T_world_tcp : (4, 4)
    axis : `heading` about the world's z, `tilt` about the level line across the approach (above 0:
        the approach goes up), `spin` about the approach
    by_deg : degrees
    """
    T = T_world_tcp.copy()
    approach = T[:3, 0]
    if axis == "heading":
        about = np.array([0.0, 0.0, 1.0])
    elif axis == "spin":
        about = approach
    else:
        level = np.array([approach[1], -approach[0], 0.0])
        # where the approach is vertical, the jaws' axis is the level line
        about = level if np.linalg.norm(level) > 0.05 else T[:3, 1]
        about = about / np.linalg.norm(about)
    T[:3, :3] = Rotation.from_rotvec(about * radians(by_deg)).as_matrix() @ T[:3, :3]
    return T


def near_by(layout: CellLayout, q_from: FloatArray, T_world_tcp: FloatArray) -> FloatArray:
    """Return the configuration (6,) that brings the TCP to a pose, reached steadily from another.

    Parameters
    ----------
    layout : the cell
    q_from : (6,) present joints of the arm
    T_world_tcp : (4, 4), near to where the TCP is

    Raises
    ------
    RefusedMotionError : there is none, or the TCP would not go straight to it
    """
    q: FloatArray = near_rows(layout, q_from[None], T_world_tcp[None])[0]
    if np.isnan(q).any():
        raise RefusedMotionError(
            "no nearby configuration brings the TCP there: the arm is at the end of its "
            "reach, or cannot turn that way; move it by its joints"
        )
    _require_straight(layout, q_from, q)
    return q


def _require_straight(layout: CellLayout, q_from: FloatArray, q_to: FloatArray) -> None:
    p = tcp_pose(layout, q_from + _LOOKS[:, None] * (q_to - q_from))[:, :3, 3]
    line = p[0] + _LOOKS[:, None] * (p[-1] - p[0])
    stray = float(np.linalg.norm(p - line, axis=1).max())
    if stray > max(STRAY_MM, STRAY_SHARE * float(np.linalg.norm(p[-1] - p[0]))):
        raise RefusedMotionError(
            f"the TCP would leave the straight line by {stray:.1f} mm: the arm is near the end of "
            "its reach or its own axis; take a smaller step, or move it by its joints"
        )


def require_free(scene: Scene, q_from: FloatArray, q_to: FloatArray) -> None:
    """Check that the arm may go from one configuration to another in one joint move.

    Parameters
    ----------
    scene : obstacles of the arm
    q_from, q_to : (6,)

    Raises
    ------
    RefusedMotionError : a soft limit or something in the cell is in its way; the message names it
    """
    arm = scene.layout.arm
    if not arm.within_limits(q_to).all():
        raise RefusedMotionError(f"a soft limit of the arm: {arm.limit_report(q_to)}")
    if path_free(scene, (inside_limits(arm, q_from, q_to), q_to)):
        return
    rows = q_from + _LOOKS[:, None] * (q_to - q_from)
    clearances_mm = [clearance_mm(scene, q) for q in rows]
    is_near = clearances_mm[0] < END_MARGIN_MM
    if is_near and clearances_mm[-1] > clearances_mm[0] and np.all(np.diff(clearances_mm) >= 0):
        return
    raise RefusedMotionError(
        f"the arm would come too near to {_what_is_near(scene, rows)}"
        + ("; it is there already: move it away from there" if is_near else "")
    )


def inside_limits(arm: ArmModel, q_from: FloatArray, q_to: FloatArray) -> FloatArray:
    """Return the first configuration of a joint move that lies within the soft limits.

    Homing leaves an arm at its stops, and so perhaps a little outside.

    Parameters
    ----------
    arm : arm with the limits
    q_from, q_to : (6,) ends of the move; its end is within them
    """
    rows = q_from + np.linspace(0.0, 1.0, _FINE)[:, None] * (q_to - q_from)
    inside: FloatArray = rows[int(np.argmax(arm.within_limits(rows)))]
    return inside


def clearance_mm(scene: Scene, q: FloatArray) -> float:
    """Return the greatest rung of a ladder of clearances that configuration q (6,) keeps [mm].

    Minus infinity where it keeps none of them.
    """
    free = scene.free(np.tile(q, (len(_LADDER_MM), 1)), _LADDER_MM)
    return float(_LADDER_MM[free][0]) if free.any() else float("-inf")


def _what_is_near(scene: Scene, rows: FloatArray) -> str:
    for margin_mm in (END_MARGIN_MM, *_LADDER_MM[::-1]):
        found = scene.contacts(rows, margin_mm)
        if (found >= 0).any():
            return scene.names()[int(found[found >= 0][0])]
    return "an obstacle on its path"
