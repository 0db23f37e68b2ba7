"""A smooth run of a boundary as the fewest straight lines and circular arcs.

All runs between two knots are fitted at once from running sums: the line by the smaller principal
moment, the arc by the algebraic fit of Kasa, whose residuals are divided by 2 R to be distances.
The best partition is found by dynamic programming over the knots (Bellman 1961; for plane curves
Perez and Vidal 1994), with a cost for each primitive, so that neighbours which are one primitive
are never left apart.
"""

from dataclasses import dataclass

import numpy as np

from controller.arrays import BoolArray, FloatArray, IntArray

from ._tolerances import BinaryTolerances

BAND = 10  # largest number of knots in a primitive at first
SHORTEST_RUN = 6  # samples between knots, a millimetre and a half; an arc needs twice as many
STRAY = 0.7  # rms residual, in noises, up to which a run is one primitive
STRAIGHTEST_MM = 500.0  # an arc of a larger radius is a line


@dataclass(frozen=True, eq=False, slots=True)
class PrimitiveFit:
    """Primitives of the runs of a loop, in order.

    Attributes
    ----------
    of_run : (r,) the first primitive of each run
    is_arc : (k,)
    middle, direction : (k, 2) middle and direction of lines, along the run
    """

    of_run: IntArray
    is_arc: BoolArray
    middle: FloatArray
    direction: FloatArray


class RunningSums:
    """Running sums of powers of a loop's points, so that any run is fitted at once."""

    def __init__(self, points: FloatArray) -> None:
        self.middle = points.mean(axis=0)
        x, y = (points - self.middle).T
        z = x * x + y * y
        powers = np.stack([np.ones_like(x), x, y, z, x * x, x * y, y * y, z * x, z * y, z * z])
        self.sums = np.concatenate([np.zeros((10, 1)), np.cumsum(powers, axis=1)], axis=1)

    def residuals(
        self, first: IntArray, last: IntArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return squared residuals of runs as lines and as arcs, and the squares of the radii."""
        (_, x, y, z), (xx, xy, yy), (zx, zy, zz) = self._moments(first, last)
        half = 0.5 * (xx - yy)
        line = np.maximum(0.5 * (xx + yy) - np.sqrt(half * half + xy * xy), 0.0)
        a, b, square = _circle(x, y, z, (xx, xy, yy), (zx, zy))
        arc = np.maximum(zz - a * zx - b * zy, 0.0) / (4 * square)
        return line, arc, square

    def directions(self, first: IntArray, last: IntArray) -> FloatArray:
        """Return the directions (k, 2) of runs as lines."""
        _, (xx, xy, yy), _ = self._moments(first, last)
        angle = 0.5 * np.arctan2(xy, 0.5 * (xx - yy))
        return np.stack([np.cos(angle), np.sin(angle)], axis=-1)

    def _moments(
        self, first: IntArray, last: IntArray
    ) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...], tuple[FloatArray, ...]]:
        """Return count and means, then sums about the means of products: plain, and with z."""
        n, x, y, z, xx, xy, yy, zx, zy, zz = self.sums[:, last + 1] - self.sums[:, first]
        x, y, z = x / n, y / n, z / n
        nx, ny, nz = n * x, n * y, n * z
        return (
            (n, x, y, z),
            (xx - nx * x, xy - nx * y, yy - ny * y),
            (zx - nz * x, zy - nz * y, zz - nz * z),
        )

    def middles(self, first: IntArray, last: IntArray) -> FloatArray:
        """Return the mean points (k, 2) of runs."""
        sums = self.sums[:3, last + 1] - self.sums[:3, first]
        middles: FloatArray = (sums[1:] / sums[0]).T + self.middle
        return middles


def _circle(
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
    plain: tuple[FloatArray, ...],
    mixed: tuple[FloatArray, ...],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return twice the centre of Kasa's circles, and the squares of their radii."""
    (xx, xy, yy), (zx, zy) = plain, mixed
    per_det = 1.0 / np.maximum(xx * yy - xy * xy, 1e-12)
    a, b = (zx * yy - zy * xy) * per_det, (zy * xx - zx * xy) * per_det
    return a, b, np.maximum(0.25 * (a * a + b * b) + z - a * x - b * y, 1e-12)


def fit_runs(
    sums: RunningSums, closed: FloatArray, runs: IntArray, limits: BinaryTolerances
) -> PrimitiveFit:
    """Return the primitives of runs of points.

    Parameters
    ----------
    sums : of ``closed``
    closed : (n + 1, 2) points of a loop, the first one repeated at the end
    runs : (r, 2) first and last sample of each run, both included
    limits : costs of a primitive, an arc and a stray point
    """
    cost, is_arc = _cost(sums, runs[:, 0], runs[:, 1], limits)
    # most runs are one line: what is as near to one primitive as points stray is not parted
    length = runs[:, 1] - runs[:, 0]
    stray = cost - limits.primitive_cost - np.where(is_arc, limits.arc_cost, 0.0)
    simple = (stray <= STRAY**2 * length) | (length < 2 * SHORTEST_RUN)
    first, last, arcs, count = [], [], [], []
    for i, (a, b) in enumerate(runs.tolist()):
        if simple[i]:
            cuts, curved = np.array([a, b]), is_arc[i : i + 1]
        else:
            cuts, curved = _best_cuts(sums, a, b, limits)
        first.append(cuts[:-1])
        last.append(cuts[1:])
        arcs.append(curved)
        count.append(len(curved))
    begin, end = np.concatenate(first), np.concatenate(last)
    direction = sums.directions(begin, end)
    backward = (direction * (closed[end] - closed[begin])).sum(axis=1) < 0
    return PrimitiveFit(
        of_run=np.cumsum(count, dtype=np.int64) - np.array(count),
        is_arc=np.concatenate(arcs),
        middle=sums.middles(begin, end),
        direction=np.where(backward[:, None], -direction, direction),
    )


def is_circle(sums: RunningSums, count: int, limits: BinaryTolerances) -> bool:
    """Return True if all points of a loop are one arc.

    Parameters
    ----------
    sums : of the loop's points, the first one repeated at the end
    count : number of those points
    limits : largest distance of points from a primitive
    """
    _, arc, _ = sums.residuals(np.zeros(1, dtype=np.int64), np.array([count - 1]))
    return float(arc[0]) < count * (STRAY * limits.line_noise_mm) ** 2


def _cost(
    sums: RunningSums, first: IntArray, last: IntArray, limits: BinaryTolerances
) -> tuple[FloatArray, BoolArray]:
    """Return the cost of runs as one primitive each, and a mask of those cheaper as an arc."""
    line, arc, square = sums.residuals(first, last)
    per_noise = 1.0 / limits.line_noise_mm**2
    bend = arc * per_noise + limits.arc_cost
    bend[(last - first < 2 * SHORTEST_RUN) | (square > STRAIGHTEST_MM**2)] = np.inf
    line *= per_noise
    return limits.primitive_cost + np.minimum(line, bend), bend < line


def _best_cuts(
    sums: RunningSums, a: int, b: int, limits: BinaryTolerances
) -> tuple[IntArray, BoolArray]:
    """Return the best cuts of a run, its ends included, and a mask of the parts that are arcs."""
    count = (b - a) // SHORTEST_RUN + 1
    knots = np.round(np.linspace(a, b, count)).astype(np.int64)
    # primitives of up to BAND knots; longer ones come in pieces, which are joined afterwards
    span = np.arange(min(BAND, count - 1), 0, -1)
    i = np.arange(count)[:, None] - span
    j = np.broadcast_to(np.arange(count)[:, None], i.shape)
    is_there = i >= 0
    cost = np.full(i.shape, np.inf)
    cost[is_there], _ = _cost(sums, knots[i[is_there]], knots[j[is_there]], limits)
    best = np.full(count + len(span), np.inf)  # shifted, so that before the first there is room
    best[len(span)] = 0.0
    before = np.zeros(count, dtype=np.int64)
    for k in range(1, count):
        total = best[k : k + len(span)] + cost[k]
        at = int(total.argmin())
        before[k] = k - int(span[at])
        best[k + len(span)] = total[at]
    path = [count - 1]
    while path[-1] > 0:
        path.append(int(before[path[-1]]))
    return _joined(sums, knots[path[::-1]], limits)


def _joined(
    sums: RunningSums, cuts: IntArray, limits: BinaryTolerances
) -> tuple[IntArray, BoolArray]:
    """Return cuts without those whose neighbours cost less as one, and a mask of arcs."""
    cost, is_arc = _cost(sums, cuts[:-1], cuts[1:], limits)
    while len(cuts) > 2:
        together, _ = _cost(sums, cuts[:-2], cuts[2:], limits)
        gain = cost[:-1] + cost[1:] - together
        # of cuts side by side only the one that gains most
        peak = gain > 0
        peak[1:] &= gain[1:] >= gain[:-1]
        peak[:-1] &= gain[:-1] > gain[1:]
        if not peak.any():
            break
        cuts = np.delete(cuts, 1 + np.flatnonzero(peak))
        cost, is_arc = _cost(sums, cuts[:-1], cuts[1:], limits)
    return cuts, is_arc
