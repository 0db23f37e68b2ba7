"""Lines in small cells: a radius-theta Hough transform in each, all cells at once.

references.md P3.2. The direction of the gradient says which few angles a point can vote for, and
on which side of a line it is bright. Maxima are taken one a round; points of a line found do not
vote again, which keeps maxima apart.
"""

from dataclasses import dataclass

import numpy as np

from controller.arrays import Float32Array, FloatArray, IntArray

from .._tolerances import GreyTolerances
from ._edges import EdgePoints

ANGLES = 36  # bins of 10 deg over the full turn; a point votes for its own and both beside
ROUNDS = 3  # lines sought in a cell; where more cross, the cells beside it separate them


@dataclass(frozen=True, eq=False, slots=True)
class Moments:
    """Sums over the points of lines: lines merge by adding them.

    Attributes
    ----------
    sums : (n, 6) of 1, x, y, x x, x y, y y
    ends : (n, 2, 2) first and last point along the line, on it
    normals : (n, 2) unit, towards the brighter side
    """

    sums: FloatArray
    ends: FloatArray
    normals: FloatArray


def cell_lines(edges: EdgePoints, tol: GreyTolerances) -> tuple[Moments, IntArray]:
    """Return the lines of all cells [px of the plane], and each edge point's line or -1."""
    points = edges.points_mm / edges.pitch_mm
    owner = np.full(len(points), -1, dtype=np.int64)
    if len(points) < tol.cell_points:
        return _none(), owner
    cell, centres = _cells(points, tol.cell_px)
    local = points - centres[cell]
    bins, shares = _ballots(local, np.arctan2(edges.normals[:, 1], edges.normals[:, 0]), tol)
    free = np.arange(len(points))
    found: list[Moments] = []
    count = 0
    for _ in range(ROUNDS):
        # cells with points enough, numbered without gaps
        busy = np.bincount(cell[free], minlength=len(centres)) >= tol.cell_points
        free = free[busy[cell[free]]]
        if len(free) == 0:
            break
        number = np.cumsum(busy) - 1
        of, at, bright = number[cell[free]], local[free], edges.normals[free]
        theta, rho = _maxima(of, bins[free], shares[free], tol)
        (x, y), (bx, by) = (np.ascontiguousarray(c.T) for c in (at, bright))
        cos, sin = np.cos(theta)[of], np.sin(theta)[of]
        near = np.abs(x * cos + y * sin - rho[of]) < 1.8 * tol.band_px
        near &= bx * cos + by * sin > np.cos(tol.vote_rad)
        mean, normal, _ = line_of(*_sums(at[near], bright[near], of[near], len(theta)))
        # once more with the points of the fitted line, whichever bin's edge they had been beyond
        nx, ny = normal[:, 0][of], normal[:, 1][of]
        offset = (mean[:, 0] * normal[:, 0] + mean[:, 1] * normal[:, 1])[of]
        near = np.abs(x * nx + y * ny - offset) < tol.band_px
        near &= bx * nx + by * ny > np.cos(tol.vote_rad)
        enough = np.bincount(of[near], minlength=len(theta)) >= tol.cell_points
        near &= enough[of]
        if not near.any():
            break
        line = (np.cumsum(enough) - 1)[of[near]]
        owner[free[near]] = count + line
        lines = _fitted(at[near], bright[near], line, centres[busy][enough])
        found.append(lines)
        count += len(lines.sums)
        # a cell whose best line is none has no other
        free = free[~near & enough[of]]
    if not found:
        return _none(), owner
    parts = ([getattr(lines, name) for lines in found] for name in ("sums", "ends", "normals"))
    return Moments(*(np.concatenate(part) for part in parts)), owner


def _none() -> Moments:
    return Moments(np.zeros((0, 6)), np.zeros((0, 2, 2)), np.zeros((0, 2)))


def _cells(points: FloatArray, side_px: float) -> tuple[IntArray, FloatArray]:
    """Return the cell of each point, numbered without gaps, and the cells' centres (c, 2)."""
    grid = np.floor(points / side_px).astype(np.int64)
    low = grid.min(axis=0)
    columns = int(np.ptp(grid[:, 0])) + 1
    key = (grid[:, 1] - low[1]) * columns + grid[:, 0] - low[0]
    taken = np.flatnonzero(np.bincount(key))
    number = np.zeros(int(key.max()) + 1, dtype=np.int64)
    number[taken] = np.arange(len(taken))
    corner = np.column_stack([taken % columns, taken // columns]) + low
    return number[key], (corner + 0.5) * side_px


def _radii(tol: GreyTolerances) -> int:
    """Return the number of radius bins of a cell."""
    return 2 * (int(np.ceil(tol.cell_px * 0.75)) + 1)


def _ballots(
    at: FloatArray, turn: FloatArray, tol: GreyTolerances
) -> tuple[IntArray, Float32Array]:
    """Return the bins (n, 3) for which points in cells vote, and the share of the next one.

    Each vote is shared by the two bins beside it, or a line between bins would count half.
    """
    radii = _radii(tol)
    own = np.rint(turn * (ANGLES / (2 * np.pi))).astype(np.int64)
    bins = (own[:, None] + np.array([-1, 0, 1])) % ANGLES
    theta = np.arange(ANGLES) * (2 * np.pi / ANGLES)
    cos, sin = np.cos(theta), np.sin(theta)
    rho = at[:, :1] * cos[bins] + at[:, 1:] * sin[bins] + (0.5 * radii - 0.5)
    low = np.clip(rho.astype(np.int64), 0, radii - 2)
    share = np.clip(rho - low, 0.0, 1.0)
    return bins * radii + low, share.astype(np.float32)


def _maxima(
    cell: IntArray, bins: IntArray, shares: Float32Array, tol: GreyTolerances
) -> tuple[FloatArray, FloatArray]:
    """Return theta and rho of each cell's highest maximum; any for a cell without points."""
    radii = _radii(tol)
    cells = int(cell.max()) + 1
    size = cells * ANGLES * radii
    key = (cell[:, None] * (ANGLES * radii) + bins).ravel()
    share = shares.ravel()
    votes = np.bincount(key, weights=1 - share, minlength=size)
    votes[1:] += np.bincount(key, weights=share, minlength=size)[:-1]
    best = votes.reshape(cells, -1).argmax(axis=1)
    angle, low_bin = np.divmod(best, radii)
    return angle * (2 * np.pi / ANGLES), low_bin + 0.5 - radii / 2


def _sums(
    at: FloatArray, bright: FloatArray, of: IntArray, count: int
) -> tuple[FloatArray, FloatArray]:
    """Return sums (count, 6) of `Moments` over points by group, and of their normals (count, 2)."""
    x, y = at.T
    columns = [
        np.bincount(of, weights=w, minlength=count)
        for w in (None, x, y, x * x, x * y, y * y, bright[:, 0], bright[:, 1])
    ]
    table = np.array(columns, dtype=np.float64).T
    return table[:, :6], table[:, 6:]


def _fitted(at: FloatArray, bright: FloatArray, of: IntArray, origin: FloatArray) -> Moments:
    """Return the least squares lines of points by group, each about its origin (n, 2)."""
    count = len(origin)
    sums, side = _sums(at, bright, of, count)
    mean, normal, _ = line_of(sums, side)
    along = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    t = at[:, 0] * along[:, 0][of] + at[:, 1] * along[:, 1][of]
    t -= (mean[:, 0] * along[:, 0] + mean[:, 1] * along[:, 1])[of]
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, of, t)
    np.maximum.at(high, of, t)
    mean = mean + origin
    ends = np.stack([mean + low[:, None] * along, mean + high[:, None] * along], axis=1)
    return Moments(_about(sums, -origin), ends, normal)


def _about(sums: FloatArray, origin: FloatArray) -> FloatArray:
    """Return sums taken about another origin (n, 2)."""
    n, x, y, xx, xy, yy = sums.T
    a, b = origin.T
    return np.stack(
        [
            n,
            x - n * a,
            y - n * b,
            xx - 2 * a * x + n * a * a,
            xy - a * y - b * x + n * a * b,
            yy - 2 * b * y + n * b * b,
        ],
        axis=1,
    )


def line_of(sums: FloatArray, bright: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean (n, 2), unit normal (n, 2) on the bright side and rms distance (n,) of lines."""
    n, x, y, xx, xy, yy = sums.T
    n = np.maximum(n, 1.0)
    mx, my = x / n, y / n
    a = xx / n - mx * mx
    b = xy / n - mx * my
    c = yy / n - my * my
    half = 0.5 * np.arctan2(2 * b, a - c)
    nx, ny = -np.sin(half), np.cos(half)
    side = np.where(nx * bright[:, 0] + ny * bright[:, 1] < 0, -1.0, 1.0)
    mean, normal = np.array([mx, my]).T, np.array([nx * side, ny * side]).T
    return mean, normal, _rms(a, b, c)


def rms_of(sums: FloatArray) -> FloatArray:
    """Return the rms distance (n,) of the points of lines."""
    n, x, y, xx, xy, yy = sums.T
    mx, my = x / n, y / n
    return _rms(xx / n - mx * mx, xy / n - mx * my, yy / n - my * my)


def _rms(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    difference = (a - c) / 2
    spread = (a + c) / 2 - np.sqrt(difference * difference + b * b)
    return np.asarray(np.sqrt(np.maximum(spread, 0.0)))
