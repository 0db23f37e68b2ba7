"""Congruent bodies at different poses, found by points that belong to the body.

The search is for a turn and a shift that take every point of one body to a point of the same type
and size of the other. Mirror images are not the same: a mirror is no turn. Two bodies of one shape
with different faces come out as two, which costs time but is no error.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from controller.arrays import FloatArray, IntArray

SAME_MM: Final = 2e-3  # files state lengths to six digits or so
SAME_SHARE: Final = 1e-5
MAX_TURN_COUNT: Final = 20_000  # turns tried for one pair
MAX_CHOSEN_FROM: Final = 500  # points among which a rare one is sought


@dataclass(frozen=True, eq=False, slots=True)
class Marks:
    """Properties that distinguish one body from another, n points.

    Attributes
    ----------
    volume_mm3, area_mm2 : volume and area of the body
    centroid_mm : (3,)
    moments_mm5 : (3,) principal moments, of density 1
    points_mm : (n, 3) centres of faces, points along edges, corners
    sizes : (n, 2) kind, and size of what the point belongs to [mm]
    """

    volume_mm3: float
    area_mm2: float
    centroid_mm: FloatArray
    moments_mm5: FloatArray
    points_mm: FloatArray
    sizes: FloatArray


def placing(one: Marks, other: Marks) -> FloatArray | None:
    """Return the pose (4, 4) that takes one body to the other, None where there is none.

    Parameters
    ----------
    one, other : two bodies, each in coordinates of its own [mm]
    """
    if not _may_be_one(one, other):
        return None
    points, others = one.points_mm - one.centroid_mm, other.points_mm - other.centroid_mm
    tree = cKDTree(np.column_stack([others, _spread(other.sizes)]))
    sizes = _spread(one.sizes)
    for R in _turns(points, one.sizes, others, other.sizes):
        turned = np.column_stack([points @ R.T, sizes])
        distance, nearest = map(np.asarray, tree.query(turned))
        if distance.max() <= 2 * SAME_MM and len(np.unique(nearest)) == len(points):
            T = np.eye(4)
            T[:3, :3], T[:3, 3] = R, other.centroid_mm - R @ one.centroid_mm
            return T
    return None


def _may_be_one(one: Marks, other: Marks) -> bool:
    if one.points_mm.shape != other.points_mm.shape or not len(one.points_mm):
        return False
    measures: tuple[tuple[FloatArray, FloatArray], ...] = (
        (np.array([one.volume_mm3]), np.array([other.volume_mm3])),
        (np.array([one.area_mm2]), np.array([other.area_mm2])),
        (one.moments_mm5, other.moments_mm5),
    )
    for a, b in measures:
        if np.abs(a - b).max() > SAME_SHARE * np.abs(a).max():
            return False
    order, other_order = (np.lexsort(marks.sizes.T[::-1]) for marks in (one, other))
    return bool(np.allclose(one.sizes[order], other.sizes[other_order], rtol=0, atol=SAME_MM))


def _spread(sizes: FloatArray) -> FloatArray:
    """Return sizes (n, 2) with kinds separated by more than any distance that counts."""
    return np.column_stack([1e3 * sizes[:, 0], sizes[:, 1]])


def _turns(
    points: FloatArray, sizes: FloatArray, others: FloatArray, other_sizes: FloatArray
) -> list[FloatArray]:
    """Return the rotations that take two distant, rare points to similar points."""
    reach, other_reach = np.linalg.norm(points, axis=1), np.linalg.norm(others, axis=1)

    def like(i: int) -> IntArray:
        same = np.abs(other_sizes - sizes[i]).max(axis=1) <= SAME_MM
        return np.flatnonzero(same & (np.abs(other_reach - reach[i]) <= SAME_MM))

    def rarest(candidates: IntArray) -> int:
        some = candidates[:: 1 + len(candidates) // MAX_CHOSEN_FROM]
        return int(some[np.argmin([len(like(int(i))) for i in some])])

    if reach.max() < SAME_MM:
        return [np.eye(3)]
    first = rarest(np.flatnonzero(reach > 0.3 * reach.max()))
    along = points[first] / reach[first]
    beside = np.linalg.norm(points - np.outer(points @ along, along), axis=1)
    if beside.max() < SAME_MM:  # all on a line: whatever turns the line over does
        return [_between(along, others[i] / reach[first]) for i in like(first)]
    second = rarest(np.flatnonzero(beside > 0.3 * beside.max()))
    product = float(points[first] @ points[second])
    slack = 4 * SAME_MM * float(reach.max())
    found: list[FloatArray] = []
    frame = _frame(points[first], points[second])
    seconds = like(second)
    for i in like(first):
        for j in seconds[np.abs(others[seconds] @ others[i] - product) <= slack]:
            if len(found) < MAX_TURN_COUNT:
                found.append(_frame(others[i], others[j]) @ frame.T)
    return found


def _frame(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the right-handed frame (3, 3) with its first axis along a, b in its first plane."""
    x = a / np.linalg.norm(a)
    y = b - (b @ x) * x
    y /= np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)])


def _between(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a rotation that takes one direction to another."""
    aside = np.eye(3)[int(np.argmin(np.abs(a)))]
    frame = _frame(a, aside)
    to = _frame(b, np.eye(3)[int(np.argmin(np.abs(b)))])
    return np.asarray(to @ frame.T)
