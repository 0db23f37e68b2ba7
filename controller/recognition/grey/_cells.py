"""Lines in small cells: a radius-theta Hough transform in each, all cells at once.

Paper, section 3.2. The direction of the gradient says which few angles a point can vote for, and
on which side of a line it is bright. Maxima are taken one a round; points of a line found do not
vote again, which keeps maxima apart.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ._edges import EdgePoints
from ._tolerances import GreyTolerances

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

ANGLES = 48  # bins of 7.5 deg over the full turn; a point votes for its own and both beside
ROUNDS = 4  # lines of a cell


@dataclass(frozen=True, eq=False, slots=True)
class Moments:
    """Sums over the points of lines: lines merge by adding them.

    Attributes
    ----------
    sums : (n, 6) of 1, x, y, x x, x y, y y
    ends : (n, 2, 2) first and last point along the line, on it
    normals : (n, 2) unit, towards the brighter side
    """

    sums: Array
    ends: Array
    normals: Array


def cell_lines(edges: EdgePoints, tol: GreyTolerances) -> tuple[Moments, Ints]:
    """Return the lines of all cells [px of the plane], and of each edge point its line or -1."""
    points = edges.points_mm / edges.pitch_mm
    owner = np.full(len(points), -1, dtype=np.int64)
    if len(points) < tol.cell_points:
        return _none(), owner
    cell, centres = _cells(points, tol.cell_px)
    at = points - centres[cell]
    turn = np.arctan2(edges.normals[:, 1], edges.normals[:, 0])
    found: list[Moments] = []
    count = 0
    for _ in range(ROUNDS):
        free = np.flatnonzero(owner < 0)
        busy = np.bincount(cell[free], minlength=len(centres)) >= tol.cell_points
        free = free[busy[cell[free]]]
        if len(free) == 0:
            break
        theta, rho = _maxima(cell[free], at[free], turn[free], tol)
        c = cell[free]
        away = at[free, 0] * np.cos(theta[c]) + at[free, 1] * np.sin(theta[c]) - rho[c]
        lean = np.abs((turn[free] - theta[c] + np.pi) % (2 * np.pi) - np.pi)
        near = (np.abs(away) < 1.8 * tol.band_px) & (lean < tol.vote_rad)
        mine, of = free[near], c[near]
        if len(mine) == 0:
            break
        lines = _fit(points, edges.normals, mine, of)
        # once more with the points of the fitted line, whichever bin's edge they had been beyond
        label = np.full(len(centres), -1, dtype=np.int64)
        label[np.unique(of)] = np.arange(len(lines.sums))
        line = label[c]
        has = line >= 0
        free, line = free[has], line[has]
        gap = np.einsum("ni,ni->n", points[free] - lines.ends[line, 0], lines.normals[line])
        lean_cos = np.einsum("ni,ni->n", edges.normals[free], lines.normals[line])
        near = (np.abs(gap) < tol.band_px) & (lean_cos > np.cos(tol.vote_rad))
        free, line = free[near], line[near]
        enough = np.bincount(line, minlength=len(lines.sums)) >= tol.cell_points
        free, line = free[enough[line]], line[enough[line]]
        if len(free) == 0:
            break
        lines = _fit(points, edges.normals, free, line)
        owner[free] = count + np.unique(line, return_inverse=True)[1].ravel()
        found.append(lines)
        count += len(lines.sums)
    if not found:
        return _none(), owner
    parts = ([getattr(lines, name) for lines in found] for name in ("sums", "ends", "normals"))
    return Moments(*(np.concatenate(part) for part in parts)), owner


def _none() -> Moments:
    return Moments(np.zeros((0, 6)), np.zeros((0, 2, 2)), np.zeros((0, 2)))


def _cells(points: Array, side_px: float) -> tuple[Ints, Array]:
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


def _maxima(cell: Ints, at: Array, turn: Array, tol: GreyTolerances) -> tuple[Array, Array]:
    """Return theta and rho of each cell's highest maximum; cells without points get any."""
    reach = int(np.ceil(tol.cell_px * 0.75)) + 1
    radii = 2 * reach
    own = np.round(turn * ANGLES / (2 * np.pi)).astype(np.int64)
    bins = (own[:, None] + np.array([-1, 0, 1])) % ANGLES
    theta = np.arange(ANGLES) * (2 * np.pi / ANGLES)
    cos, sin = np.cos(theta), np.sin(theta)
    rho = at[:, :1] * cos[bins] + at[:, 1:] * sin[bins] + reach
    low = np.clip(np.floor(rho - 0.5).astype(np.int64), 0, radii - 2)
    cells = int(cell.max()) + 1
    key = ((cell[:, None] * ANGLES + bins) * radii + low).ravel()
    # each vote is shared by the two bins beside it, or a line between bins would count half
    share = np.clip(rho - 0.5 - low, 0.0, 1.0).ravel()
    size = cells * ANGLES * radii
    votes = np.bincount(key, weights=1 - share, minlength=size)
    votes[1:] += np.bincount(key, weights=share, minlength=size)[:-1]
    best = votes.reshape(cells, -1).argmax(axis=1)
    angle, low_bin = np.divmod(best, radii)
    return theta[angle], low_bin + 0.5 - reach


def _fit(points: Array, normals: Array, members: Ints, of: Ints) -> Moments:
    """Return the least squares lines of points grouped by ``of``, in its order."""
    order = np.argsort(of, kind="stable")
    members, of = members[order], of[order]
    starts = np.flatnonzero(np.r_[True, of[1:] != of[:-1]])
    lengths = np.diff(np.r_[starts, len(of)])
    x, y = points[members].T
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    # squares about the first point of each line: about a far origin they would lose digits
    first = np.repeat(points[members[starts]], lengths, axis=0)
    local = _about(terms, first)
    sums = np.add.reduceat(local, starts, axis=0)
    bright = np.add.reduceat(normals[members], starts, axis=0)
    mean, normal, _ = line_of(sums, bright)
    along = np.column_stack([-normal[:, 1], normal[:, 0]])
    mean = mean + points[members[starts]]
    t = np.einsum(
        "ni,ni->n", points[members] - np.repeat(mean, lengths, 0), np.repeat(along, lengths, 0)
    )
    low, high = np.minimum.reduceat(t, starts), np.maximum.reduceat(t, starts)
    ends = np.stack([mean + low[:, None] * along, mean + high[:, None] * along], axis=1)
    return Moments(_about(sums, -points[members[starts]]), ends, normal)


def _about(sums: Array, origin: Array) -> Array:
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


def line_of(sums: Array, bright: Array) -> tuple[Array, Array, Array]:
    """Return mean (n, 2), unit normal (n, 2) on the bright side and rms distance (n,) of lines."""
    n, x, y, xx, xy, yy = sums.T
    mean = np.stack([x / n, y / n], axis=1)
    a = xx / n - mean[:, 0] ** 2
    b = xy / n - mean[:, 0] * mean[:, 1]
    c = yy / n - mean[:, 1] ** 2
    half = 0.5 * np.arctan2(2 * b, a - c)
    normal = np.stack([-np.sin(half), np.cos(half)], axis=1)
    normal *= np.where(np.einsum("ni,ni->n", normal, bright) < 0, -1.0, 1.0)[:, None]
    spread = (a + c) / 2 - np.hypot((a - c) / 2, b)
    return mean, normal, np.sqrt(np.maximum(spread, 0.0))
