"""Arrangement of balloons about the views of a drawing, so that no two leaders cross.

Balloons lie on a ring about each view, the convex hull of its outline plus a gap. They are assigned
to places for the least total leader length. Exchanging the balloons of two crossing leaders would
shorten them, so none cross: boundary labelling with straight leaders (Bekos, Kaufmann, Symvonis,
Wolff, 2007). This also holds for leaders that end at the nearest point of a shape. All lengths are
in millimetres of the paper.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from scipy.optimize import isotonic_regression, linear_sum_assignment
from shapely.geometry.base import BaseGeometry

from controller.arrays import FloatArray, IntArray

# Radius of a balloon, which holds three digits of the drawing's lettering, 2.2 mm high.
RADIUS_MM: Final = 2.2
# Least distance of neighbours on a ring, with room for a leader's stroke between them.
PITCH_MM: Final = 2 * RADIUS_MM + 0.5
# Distance of neighbours in a chain, which touch.
CHAIN_MM: Final = 2 * RADIUS_MM
# Distance from the outline to the centre of a balloon, so that one diameter of a leader is visible.
GAP_MM: Final = 3.0 * RADIUS_MM


@dataclass(frozen=True, slots=True, eq=False)
class BalloonRing:
    """Closed curve about a view on which the balloons lie."""

    line: shapely.LinearRing

    @classmethod
    def about(cls, points: FloatArray) -> "BalloonRing":
        """Return the ring about the points (n, 2) of a view."""
        around = shapely.MultiPoint(points).convex_hull.buffer(GAP_MM, quad_segs=16)
        return cls(shapely.LinearRing(shapely.get_coordinates(around)))

    def at(self, along: FloatArray) -> FloatArray:
        """Return the points (n, 2) at lengths along the ring."""
        lengths: FloatArray = np.mod(along, self.line.length)
        found: FloatArray = shapely.get_coordinates(
            shapely.line_interpolate_point(self.line, lengths)
        )
        return found

    def outward(self, along: FloatArray) -> FloatArray:
        """Return the unit normals (n, 2) that point away from the view."""
        step = self.at(along + 0.05) - self.at(along - 0.05)
        step /= np.linalg.norm(step, axis=1)[:, None]
        normal = np.column_stack([step[:, 1], -step[:, 0]])
        is_inward = np.sum(normal * (self.at(along) - self._middle), axis=1) < 0
        return np.asarray(np.where(is_inward[:, None], -normal, normal), dtype=np.float64)

    @property
    def slots(self) -> FloatArray:
        """Lengths along the ring at which balloons fit."""
        count = int(self.line.length / PITCH_MM)
        return np.linspace(0.0, float(self.line.length), count, endpoint=False)

    @property
    def _middle(self) -> FloatArray:
        middle: FloatArray = shapely.get_coordinates(self.line.centroid)[0]
        return middle


@dataclass(frozen=True, slots=True, eq=False)
class PlacedLeader:
    """Ends of a leader.

    Attributes
    ----------
    view : number of its view
    start, outward : centre of the balloon at its start, and the direction of a chain of balloons
    end : point of the target nearest to the start
    """

    view: int
    start: FloatArray
    outward: FloatArray
    end: FloatArray


def arrange(
    rings: Sequence[BalloonRing], targets: Sequence[Sequence[BaseGeometry | None]]
) -> tuple[PlacedLeader, ...] | None:
    """Return the shortest leaders that do not cross, one per target; None if they do not fit.

    Parameters
    ----------
    rings : rings of the views
    targets : target of each leader in each view; None where a view does not show it
    """
    along = np.concatenate([ring.slots for ring in rings])
    view_of = np.concatenate([np.full(len(r.slots), i) for i, r in enumerate(rings)])
    chosen = _assign(
        np.hstack([_lengths(ring, ring.slots, [row[i] for row in targets])
                   for i, ring in enumerate(rings)])
    )  # fmt: skip
    if chosen is None:
        return None
    placed: dict[int, PlacedLeader] = {}
    for i, ring in enumerate(rings):
        mine = np.flatnonzero(view_of[chosen] == i)
        shapes = [shape for k in mine if (shape := targets[int(k)][i]) is not None]
        starts_mm = _beside(ring, along[chosen[mine]], shapes)
        starts, outward = ring.at(starts_mm), ring.outward(starts_mm)
        ends = [_nearest(s, at) for s, at in zip(shapes, starts, strict=True)]
        placed |= {
            int(k): PlacedLeader(i, *three)
            for k, three in zip(mine, zip(starts, outward, ends, strict=True), strict=True)
        }
    return tuple(placed[k] for k in range(len(targets)))


def _lengths(
    ring: BalloonRing, along: FloatArray, shapes: Sequence[BaseGeometry | None]
) -> FloatArray:
    """Return the leader lengths (shapes, places); infinite where the view shows no shape."""
    places = np.asarray(shapely.points(ring.at(along)))
    found = [np.full(len(places), np.inf) if s is None else shapely.distance(s, places)
             for s in shapes]  # fmt: skip
    return np.array(found).reshape(len(shapes), len(places))


def _assign(lengths: FloatArray) -> IntArray | None:
    """Return the places of the shapes with the least total length; None if there are none."""
    try:
        _, chosen = linear_sum_assignment(lengths)
    except ValueError:  # infeasible: no view of some shape has a place for it
        return None
    return chosen if len(chosen) == len(lengths) else None


def _beside(ring: BalloonRing, along: FloatArray, shapes: Sequence[BaseGeometry]) -> FloatArray:
    """Return places off the raster of slots, nearer to the shapes but still a pitch apart."""
    if not shapes:
        return along
    length = float(ring.line.length)
    order = np.argsort(along)
    # Cut the ring open at its widest gap.
    cut = int(np.argmax(np.diff(along[order], append=along[order[0]] + length))) + 1
    order = np.roll(order, -cut)
    at = along[order] + np.where(np.arange(len(order)) >= len(order) - cut, length, 0.0)
    wanted = np.array([_nearest_along(ring, shapes[k]) for k in order])
    wanted = at + (wanted - at + length / 2) % length - length / 2
    steps = PITCH_MM * np.arange(len(at))
    moved = np.asarray(isotonic_regression(wanted - steps).x) + steps
    if moved[-1] - moved[0] > length - PITCH_MM:
        moved = at
    before, after = _lengths(ring, at, shapes), _lengths(ring, moved, shapes)
    old, new = _assign(before), _assign(after)
    if old is None or new is None:  # every shape has a place everywhere: not reached
        return along
    rows = np.arange(len(shapes))
    is_better = after[rows, new].sum() < before[rows, old].sum()
    return moved[new] if is_better else at[old]


def _nearest_along(ring: BalloonRing, shape: BaseGeometry) -> float:
    """Return the length along the ring of its point nearest to a shape."""
    line = shapely.shortest_line(ring.line, shape)
    start = shapely.Point(shapely.get_coordinates(line)[0])
    return float(shapely.line_locate_point(ring.line, start))


def _nearest(shape: BaseGeometry, start: FloatArray) -> FloatArray:
    """Return the point of a shape that is nearest to a leader's start."""
    found: FloatArray = shapely.get_coordinates(shapely.shortest_line(shape, shapely.Point(start)))[
        0
    ]
    return found
