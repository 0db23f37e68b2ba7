"""Depths where sight lines enter and leave parts, and how much of them two parts share.

The same before a light table and under lamps; only the grid of sight lines and the depths where
they enter come from elsewhere.
"""

from typing import Final

import numpy as np

from controller.arrays import FloatArray, IntArray
from controller.imaging import inverse_pose, transform

from ..fitting import EdgeModel

GOES_ON_MM: Final = 8.0  # depth below the table from which lines of sight are traced back
BURIED_MM: Final = 1.5  # overlap along a line of sight from which two parts are in one place
BURIED_SHARE: Final = 0.02  # least share of the smaller shadow
BURIED_CELLS: Final = 6

Depths = tuple[FloatArray, FloatArray]  # where lines enter a part (n,), and where they leave it


def leaving_depths(
    model: EdgeModel,
    T_world_part: FloatArray,
    eye_mm: FloatArray,
    lines: FloatArray,
    enter: FloatArray,
) -> FloatArray:
    """Return the depths (n,) at which sight lines leave a part for good.

    Parameters
    ----------
    model : model of the part
    T_world_part : (4, 4) its pose
    eye_mm : (3,) start of the lines, in the world
    lines : (n, 3) directions in the world, scaled to depth 1, that meet the part
    enter : (n,) depths where they do; the answer for a line that grazes it
    """
    T_part_world = inverse_pose(T_world_part)
    # from below the table back to the eye, where the line leaves is met first
    whole = (eye_mm[2] + GOES_ON_MM) / -lines[:, 2]
    begin, way = transform(T_part_world, eye_mm[None])[0], lines @ T_part_world[:3, :3].T
    triangle, back = model.caster.first_hit(begin + whole[:, None] * way, -way)
    return np.where(triangle >= 0, whole - back, enter)


def lines_in_both(a: Depths, b: Depths) -> tuple[IntArray, float]:
    """Return the lines (k,) along which two parts overlap, and the number of them that is chance.

    Parameters
    ----------
    a, b : depths along the same lines; not finite where a line misses the part
    """
    (enter_a, leave_a), (enter_b, leave_b) = a, b
    is_a, is_b = np.isfinite(enter_a), np.isfinite(enter_b)
    with np.errstate(invalid="ignore"):
        shared = np.minimum(leave_a, leave_b) - np.maximum(enter_a, enter_b)
        at = np.flatnonzero(is_a & is_b & (shared > BURIED_MM))
    return at, BURIED_CELLS + BURIED_SHARE * min(int(is_a.sum()), int(is_b.sum()))
