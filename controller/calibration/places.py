"""Poses of trays and table, from points touched by the arm's finger tips.

The arm that places parts in a tray touches its corners: an error of the arm there shifts both
alike, and a part is placed where the corner was felt.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees, radians
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.planning.model import CellLayout
from controller.planning.motion import tcp_pose

Corner = tuple[int, int]
CORNERS: Final[tuple[Corner, ...]] = ((1, -1), (-1, -1), (1, 1), (-1, 1))
# standard deviation of an even distribution of width 1, and of half the radius that holds 95 % in a
# plane
_EVEN: Final = 1.0 / np.sqrt(12.0)
_HALF_95: Final = 1.2239


@dataclass(frozen=True, slots=True, eq=False)
class CornerTouch:
    """Finger tips in a tray's corner.

    Attributes
    ----------
    corner : -1 or 1 along x and y, from the tray's middle
    at_mm : (3,) positions of the touches
    """

    corner: Corner
    at_mm: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class TrayFit:
    """A tray as touched.

    Attributes
    ----------
    centre_mm : (2,)
    off_mm : the farthest corner from where centre and size have it
    height_mm : height of its floor, the mean of all touches
    """

    centre_mm: FloatArray
    off_mm: float
    height_mm: float


@dataclass(frozen=True, slots=True)
class PlaneFit:
    """A plane through touches.

    Attributes
    ----------
    height_mm : height at their middle
    tilt_deg : against the world's table plane
    rms_mm : rms distance of the touches from it
    """

    height_mm: float
    tilt_deg: float
    rms_mm: float


def opposite(corner: Corner) -> Corner:
    """Return the corner across the tray."""
    return (-corner[0], -corner[1])


def locate_tray(size_mm: Sequence[float], touches: Sequence[CornerTouch]) -> TrayFit:
    """Return the tray whose corners are nearest to those touched, its sides along x and y.

    Two opposite corners give its middle even if it is turned a little.

    Parameters
    ----------
    size_mm : along x and y, of its floor
    touches : touches of one or more corners

    Raises
    ------
    ValueError : nothing was touched
    """
    if not touches:
        raise ValueError("no corner was touched")
    half = np.asarray(size_mm, dtype=float) / 2.0
    centres = np.array([one.at_mm[:2] - np.array(one.corner) * half for one in touches])
    centre = centres.mean(axis=0)
    off = np.linalg.norm(centres - centre, axis=1)
    return TrayFit(centre, float(off.max()), float(np.mean([one.at_mm[2] for one in touches])))


def fit_plane(points_mm: FloatArray) -> PlaneFit:
    """Return the plane through points (n, 3), none above another.

    Raises
    ------
    ValueError : fewer than three, or all on a line
    """
    points = np.asarray(points_mm, dtype=float)
    middle = points.mean(axis=0)
    p = points - middle
    across = np.linalg.svd(p[:, :2], compute_uv=False)
    if len(points) < 3 or across[-1] < 1e-3 * across[0]:
        raise ValueError("a plane needs three points that are not on a line")
    slope = np.linalg.lstsq(p[:, :2], p[:, 2], rcond=None)[0]
    left = p[:, 2] - p[:, :2] @ slope
    return PlaneFit(
        float(middle[2]),
        degrees(float(np.arctan(np.linalg.norm(slope)))),
        float(np.sqrt(np.mean(left**2))),
    )


def play_uncertainty_mm(
    layout: CellLayout,
    q: FloatArray,
    play_deg: Mapping[str, float],
    motors: Mapping[str, FloatArray],
) -> float:
    """Return the error of finger tips caused by gear play in a guided arm.

    A person leads the joint and the motor follows: the flank of each gear is unknown.

    Parameters
    ----------
    layout : layout of the calibrated cell
    q : (6,) joints that were read
    play_deg : play of the gears of each motor
    motors : turn of the joints (6,) with each motor, per rad of it
    """
    here = tcp_pose(layout, q)[:2, 3]
    total = 0.0
    for motor, turn in motors.items():
        turned = np.asarray(q) + turn * radians(play_deg.get(motor, 0.0)) * _EVEN
        total += float(np.sum((tcp_pose(layout, turned)[:2, 3] - here) ** 2))
    return float(np.sqrt(total))


def aim_uncertainty(guided_mm: float, count: int) -> float:
    """Return the uncertainty of a place that a person set by eye, in the plane.

    Parameters
    ----------
    guided_mm : standard uncertainty of one touch along either axis
    count : touches that were averaged
    """
    return float(_HALF_95 * guided_mm / np.sqrt(count))
