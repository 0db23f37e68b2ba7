"""Circles and arcs: from the line pieces of their rims, then from edge points.

The paper's cells see an arc as short lines, and it left open that their normals meet in one point.
Circles parallel to the table stay circles in its plane, so circles are enough.
"""

from dataclasses import dataclass

import numpy as np

from controller.arrays import BoolArray, FloatArray, IntArray

from .._tolerances import GreyTolerances
from ._cells import Moments

MAX_PIECES = 140  # longest of the short lines whose normals are intersected in pairs
MAX_PAIRS = 4000
MAX_SEEDS = 32
SECTORS = 36
SEED_COVER = 0.6  # share of an arc's required turn that its pieces, with gaps between, must cover
VOTE_PX = 2.5  # bin of centre and radius: the error of a cell's line


@dataclass(frozen=True, eq=False, slots=True)
class Circles:
    """Circles, or arcs of them [px of the plane].

    Attributes
    ----------
    centres : (n, 2)
    radii : (n,)
    cover : (n,) share of the turn that edge points were seen on
    starts_rad, extents_rad : (n,) the seen arc: from its start, anticlockwise
    bright_inside : (n,) True for a boss or a disc, False for a hole
    """

    centres: FloatArray
    radii: FloatArray
    cover: FloatArray
    starts_rad: FloatArray
    extents_rad: FloatArray
    bright_inside: BoolArray


def find_circles(
    points: FloatArray,
    normals: FloatArray,
    pieces: Moments,
    owner: IntArray,
    bent: BoolArray,
    tol: GreyTolerances,
) -> tuple[Circles, IntArray]:
    """Return circles, best covered first, and each edge point's circle or -1.

    Parameters
    ----------
    points, normals : (n, 2) edge points [px of the plane] and which way it gets brighter
    pieces : lines of cells
    owner : (n,) piece each point is of, -1 if none
    bent : pieces that are of no long line
    tol : thresholds of an arc
    """
    circle_of = np.full(len(points), -1, dtype=np.int64)
    x, y = (np.ascontiguousarray(c) for c in points.T)
    nx, ny = (np.ascontiguousarray(c) for c in normals.T)
    seeds = _seeds(pieces, bent)
    on, sign, inliers = _inliers(seeds, pieces)
    free = np.ones(len(pieces.sums), dtype=bool)
    length = np.linalg.norm(pieces.ends[:, 1] - pieces.ends[:, 0], axis=1)
    found: list[tuple[float, ...]] = []
    for seed in np.argsort(-inliers, kind="stable").tolist():
        mine = on[seed] & free
        if mine @ length < SEED_COVER * tol.circle_cover * 2 * np.pi * seeds[seed, 2]:
            continue
        members = np.flatnonzero(np.append(mine, False)[owner])
        circle = _fit(x[members], y[members])
        if circle is None:
            continue
        cx, cy, r = circle
        # its pieces left out those with few points, and what other pieces have of it
        dx, dy = x - cx, y - cy
        distance = np.sqrt(dx * dx + dy * dy)
        near = np.abs(distance - r) < tol.circle_px
        near &= sign[seed] * (dx * nx + dy * ny) > 0.95 * distance
        near &= circle_of < 0
        inside = np.flatnonzero(near)
        circle = _fit(x[inside], y[inside])
        if circle is None:
            continue
        cx, cy, r = circle
        # a point for each pixel, a little less where the ridge steps diagonally
        if len(inside) < 0.4 * 2 * np.pi * r * tol.circle_cover:
            continue
        cover, start, extent = _cover(x[inside] - cx, y[inside] - cy, r)
        if cover < tol.circle_cover:
            continue
        circle_of[inside] = len(found)
        free[mine] = False
        found.append((cx, cy, r, cover, start, extent, sign[seed]))
    table = np.array(found, dtype=np.float64).reshape(-1, 7)
    order = np.argsort(-table[:, 3], kind="stable")
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    circle_of[circle_of >= 0] = place[circle_of[circle_of >= 0]]
    table = table[order]
    return (
        Circles(table[:, :2], table[:, 2], table[:, 3], table[:, 4], table[:, 5], table[:, 6] < 0),
        circle_of,
    )


def _inliers(seeds: FloatArray, pieces: Moments) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Return a mask (s, n) of the pieces on each seed, its sign, and their share of its turn.

    The sign is 1 where it is bright outside.
    """
    middle = pieces.ends.mean(axis=1)
    length = np.linalg.norm(pieces.ends[:, 1] - pieces.ends[:, 0], axis=1)
    dx = middle[None, :, 0] - seeds[:, :1]
    dy = middle[None, :, 1] - seeds[:, 1:2]
    distance = np.sqrt(dx * dx + dy * dy)
    r = seeds[:, 2:]
    # a chord's middle is inside of its arc
    sag = length**2 / (12 * np.maximum(r, 2.0))
    radial = (dx * pieces.normals[:, 0] + dy * pieces.normals[:, 1]) / np.maximum(distance, 1e-9)
    on = (np.abs(distance + sag - r) < 1.2 + 0.03 * r) & (np.abs(radial) > 0.95)
    sign = np.where(((on * length) * radial).sum(axis=1) < 0, -1.0, 1.0)
    on &= radial * sign[:, None] > 0
    return on, sign, (on @ length) / (2 * np.pi * np.maximum(seeds[:, 2], 1.0))


def _fit(x: FloatArray, y: FloatArray) -> tuple[float, float, float] | None:
    """Return centre and radius of the least squares circle, None where there is none."""
    count = len(x)
    if count < 8:
        return None
    mx, my = float(x.sum()) / count, float(y.sum()) / count
    u, v = x - mx, y - my
    uu, uv, vv = float(u @ u), float(u @ v), float(v @ v)
    w = u * u + v * v
    a, b = float(w @ u) / 2, float(w @ v) / 2
    det = uu * vv - uv * uv
    if det < 1e-6 * uu * vv or det <= 0:
        return None
    cx, cy = (a * vv - b * uv) / det, (b * uu - a * uv) / det
    return mx + cx, my + cy, float(np.sqrt(cx * cx + cy * cy + (uu + vv) / count))


def _seeds(pieces: Moments, bent: BoolArray) -> FloatArray:
    """Return (n, 3) centres and radii supported by most pairs of pieces."""
    length = np.linalg.norm(pieces.ends[:, 1] - pieces.ends[:, 0], axis=1)
    pick = np.flatnonzero(bent)
    pick = pick[np.argsort(-length[pick], kind="stable")[:MAX_PIECES]]
    middle, normal, weight = pieces.ends[pick].mean(axis=1), pieces.normals[pick], length[pick]
    (mx, my), (nx, ny) = middle.T.astype(np.float32), normal.T.astype(np.float32)
    cross = nx[:, None] * ny - ny[:, None] * nx
    # 15 deg: normals nearer to parallel meet anywhere
    apart = np.triu(np.abs(cross) > 0.26, 1)
    cross[~apart] = 1.0
    dx, dy = mx - mx[:, None], my - my[:, None]
    s = (dx * ny - dy * nx) / cross  # along i's normal
    t = (dx * ny[:, None] - dy * nx[:, None]) / cross  # along j's
    long = np.abs(s)
    apart &= (np.abs(s - t) < 1.5 + 0.03 * long) & (long > 2.0)
    i, j = np.nonzero(apart)
    s, t = s[i, j].astype(np.float64), t[i, j].astype(np.float64)
    if len(i) == 0:
        return np.zeros((0, 3))
    if len(i) > MAX_PAIRS:
        keep = np.argsort(-(weight[i] * weight[j]), kind="stable")[:MAX_PAIRS]
        i, j, s, t = i[keep], j[keep], s[keep], t[keep]
    centre = (middle[i] + s[:, None] * normal[i] + middle[j] + t[:, None] * normal[j]) / 2
    radius = (s + t) / 2  # negative where it is bright outside: a hole
    votes = np.minimum(weight[i], weight[j]) / np.sqrt(np.abs(radius))
    # bins about a third of the radius' share wider for large circles, whose centres are less sure
    scale = VOTE_PX * (1 + np.abs(radius) / 60.0)
    octave = np.round(np.log2(scale) * 2).astype(np.int64)
    wide = 2.0 ** (octave / 2)
    cells = np.floor(np.column_stack([centre, radius]) / wide[:, None]).astype(np.int64)
    cells = np.column_stack([cells, octave])
    low = cells.min(axis=0)
    span = np.ptp(cells, axis=0) + 1
    key = np.ravel_multi_index(tuple((cells - low).T), tuple(span))
    _, inverse = np.unique(key, return_inverse=True)
    total = np.bincount(inverse.ravel(), weights=votes)
    mean = np.stack(
        [
            np.bincount(inverse.ravel(), weights=votes * column) / total
            for column in (centre[:, 0], centre[:, 1], np.abs(radius))
        ],
        axis=1,
    )
    best = mean[np.argsort(-total, kind="stable")[: 3 * MAX_SEEDS]]
    same = np.ones((len(best), len(best)), dtype=np.bool_)
    for column in best.T:
        same &= np.abs(column[:, None] - column) <= VOTE_PX
    kept: list[int] = []
    is_taken = np.zeros(len(best), dtype=np.bool_)
    for b in range(len(best)):
        if not is_taken[b]:
            kept.append(b)
            is_taken |= same[b]
        if len(kept) == MAX_SEEDS:
            break
    return best[kept]


def _cover(dx: FloatArray, dy: FloatArray, radius: float) -> tuple[float, float, float]:
    """Return the share of the turn with points, and start and extent of the visible arc."""
    sectors = int(np.clip(2 * np.pi * radius / 2.5, 8, SECTORS))
    angle = np.arctan2(dy, dx) % (2 * np.pi)
    of = np.minimum((angle * (sectors / (2 * np.pi))).astype(np.int64), sectors - 1)
    # a circle that only crosses edges has a point or two where an arc has one for each pixel
    filled = np.bincount(of, minlength=sectors) > 0.4 * 2 * np.pi * radius / sectors
    seen = np.flatnonzero(filled)
    if len(seen) in (0, sectors):
        return len(seen) / sectors, 0.0, 2 * np.pi
    # the seen arc is what the longest gap leaves
    gaps = np.diff(np.append(seen, seen[0] + sectors))
    longest = int(gaps.argmax())
    start = seen[(longest + 1) % len(seen)] * 2 * np.pi / sectors
    extent = (sectors + 1 - gaps[longest]) * 2 * np.pi / sectors
    return len(seen) / sectors, float(start), float(extent)
