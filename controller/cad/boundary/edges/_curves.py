"""The curve behind an edge's polyline: a line, a circle, or neither.

Vertices of a tessellation lie on the true curve, so the fit is judged at the vertices alone. The
axis of a neighbouring cylinder, cone or torus is a better axis than any fit to a short arc.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controller.arrays import BoolArray, FloatArray, IntArray

from .._normals import unit
from .._types import Curve, Face

TOLERANCE_MM = 0.005  # files round corners to 1e-4 mm and 7 digits; a real kink is far larger
TOLERANCE_SHARE = 0.01  # largest tolerance for a short edge, as a share of its length
STRAIGHT = 0.002  # a turn of 0.1 degrees: a circle of 3600 segments
MIN_FIT_POINTS = 6  # a circle fits three points always, and four or five too easily
PARALLEL = 1 - 1e-5  # cosine of 0.26 degrees
LARGEST_RADIUS = 50.0  # in lengths of the edge; a flatter arc cannot be told from a line


@dataclass(frozen=True, eq=False, slots=True)
class EdgeCurves:
    """`Curve` of each edge (e,), and centre (e, 3), axis (e, 3), radius (e,) of circles."""

    curve: NDArray[np.int8]
    centre_mm: FloatArray
    axis: FloatArray
    radius_mm: FloatArray


def fit_curves(
    vertices_mm: FloatArray,
    chain: IntArray,
    chain_start: IntArray,
    faces: Sequence[Face],
    face: IntArray,
) -> EdgeCurves:
    """Return the curves of edges.

    Parameters
    ----------
    vertices_mm : (n, 3) mesh vertices
    chain, chain_start : as in `Boundary`
    faces : all surfaces
    face : (2 e,) surface to the left of each half-edge
    """
    count = len(chain_start) - 1
    curves = EdgeCurves(
        np.full(count, Curve.OTHER, dtype=np.int8),
        np.full((count, 3), np.nan),
        np.full((count, 3), np.nan),
        np.full(count, np.nan),
    )
    if count == 0:
        return curves
    runs = _Runs(vertices_mm[chain], chain_start)
    tolerance = np.minimum(TOLERANCE_MM, TOLERANCE_SHARE * runs.lengths) + 1e-6
    axes = np.array([f.axis for f in faces])
    normals = np.array([f.normal for f in faces])
    centres = np.array([f.centre_mm for f in faces])
    is_plane = np.array([f.kind == "plane" for f in faces])
    todo = np.ones(count, dtype=bool)
    for side in (0, 1):
        mine, other = face[side::2], face[1 - side :: 2]
        axis = axes[mine]
        square = is_plane[other] & (np.abs((axis * normals[other]).sum(axis=1)) > PARALLEL)
        known = todo & (np.abs(axis).sum(axis=1) > 0) & (square | (runs.sizes > 3))
        middle, radius, error = runs.about(axis, centres[mine])
        good = known & (error <= tolerance) & (radius > tolerance)
        _keep(curves, good, middle, axis, radius)
        todo &= ~good
    straight = todo & (runs.off_line() <= tolerance)
    curves.curve[straight] = Curve.LINE
    todo &= ~straight & (runs.corner_counts >= MIN_FIT_POINTS)
    if todo.any():
        normal = runs.plane_normals()
        guess = runs.circle_centres(normal)
        middle, radius, error = runs.about(normal, guess)
        good = todo & (error <= tolerance) & (radius < LARGEST_RADIUS * runs.lengths)
        _keep(curves, good, middle, normal, radius)
    return curves


def _keep(
    curves: EdgeCurves, good: BoolArray, middle: FloatArray, axis: FloatArray, r: FloatArray
) -> None:
    curves.curve[good] = Curve.CIRCLE
    curves.centre_mm[good] = middle[good]
    curves.axis[good] = axis[good]
    curves.radius_mm[good] = r[good]


class _Runs:
    """Points of all edges in one array, and sums over each edge."""

    def __init__(self, points: FloatArray, chain_start: IntArray) -> None:
        self.points = points
        self.start = chain_start[:-1]
        self.sizes = np.diff(chain_start)
        self.run = np.repeat(np.arange(len(self.sizes)), self.sizes)
        steps = np.linalg.norm(np.diff(points, axis=0, append=points[-1:]), axis=1)
        steps[chain_start[1:] - 1] = 0.0
        self.lengths = np.add.reduceat(steps, self.start)
        self.closed = np.linalg.norm(points[self.start] - points[chain_start[1:] - 1], axis=1) == 0
        self.weights = self._turning(points, chain_start)
        # the shared point of a closed run counts once, or the centre leans towards it
        self.weights[(chain_start[1:] - 1)[self.closed]] = 0.0
        self.totals = np.add.reduceat(self.weights, self.start)
        self.means = self._mean(points)
        self.centred = points - self.means[self.run]

    def _turning(self, points: FloatArray, chain_start: IntArray) -> FloatArray:
        """Return 1 at the ends of a run and where it turns, 0 where it is straight.

        A point on the chord of an arc comes from a neighbour with other segments; it is not on
        the arc. A run that turns nowhere keeps all its points.
        """
        steps = unit(np.diff(points, axis=0))
        turns = np.ones(len(points), dtype=bool)
        turns[1:-1] = np.linalg.norm(np.diff(steps, axis=0), axis=1) > STRAIGHT
        turns[chain_start[:-1]] = turns[chain_start[1:] - 1] = True
        self.corner_counts = np.add.reduceat(turns.astype(np.int64), self.start)
        keep_all = (self.corner_counts < MIN_FIT_POINTS) & (self.sizes > self.corner_counts)
        return np.where(turns | keep_all[self.run], 1.0, 0.0)

    def _mean(self, values: FloatArray) -> FloatArray:
        weights = self.weights.reshape(-1, *[1] * (values.ndim - 1))
        totals = self.totals.reshape(-1, *[1] * (values.ndim - 1))
        return np.asarray(np.add.reduceat(values * weights, self.start, axis=0) / totals)

    def about(
        self, axis: FloatArray, centre: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return centre on the axis, radius, largest misfit of circles about given axes."""
        offset = self.points - centre[self.run]
        height = (offset * axis[self.run]).sum(axis=1)
        distance = np.linalg.norm(offset - height[:, None] * axis[self.run], axis=1)
        level, radius = self._mean(height), self._mean(distance)
        misfit = np.hypot(height - level[self.run], distance - radius[self.run])
        misfit = np.where(self.weights > 0, misfit, 0.0)
        return (
            centre + level[:, None] * axis,
            radius,
            np.asarray(np.maximum.reduceat(misfit, self.start)),
        )

    def off_line(self) -> FloatArray:
        """Return each run's largest distance from the line through its ends; infinite if closed."""
        last = self.start + self.sizes - 1
        along = self.points[last] - self.points[self.start]
        span = np.linalg.norm(along, axis=1, keepdims=True)
        along = np.divide(along, span, out=np.zeros_like(along), where=span > 0)
        offset = self.points - self.points[self.start][self.run]
        part = (offset * along[self.run]).sum(axis=1, keepdims=True)
        away = np.linalg.norm(offset - part * along[self.run], axis=1)
        # a run that turns back on its own line is none
        back = np.maximum(-part[:, 0], part[:, 0] - span[self.run, 0])
        off = np.maximum.reduceat(np.maximum(away, back), self.start)
        return np.where(self.closed, np.inf, off)

    def plane_normals(self) -> FloatArray:
        """Return the normals of the planes that fit best."""
        spread = self._mean(self.centred[:, :, None] * self.centred[:, None, :])
        return np.asarray(np.linalg.eigh(spread)[1][:, :, 0])

    def circle_centres(self, normal: FloatArray) -> FloatArray:
        """Return the centres of the circles that fit best in planes of given normals."""
        # least squares of 2 p.c + d = p.p; adding the normal's direction makes it square
        q = self.centred - (self.centred * normal[self.run]).sum(axis=1)[:, None] * normal[self.run]
        spread = self._mean(q[:, :, None] * q[:, None, :])
        third = self._mean(q * (q**2).sum(axis=1)[:, None]) / 2
        scale = np.trace(spread, axis1=1, axis2=2)[:, None, None]
        system = spread + scale * normal[:, :, None] * normal[:, None, :]
        well = np.linalg.cond(system) < 1e10
        system[~well] = np.eye(3)
        offset = np.linalg.solve(system, third[:, :, None])[:, :, 0]
        return np.asarray(self.means + np.where(well[:, None], offset, 0.0))
