"""Circles and arcs: from the pieces of lines their rims are seen as, then from edge points.

The paper's cells see an arc as short lines; that their normals meet in one point is what it left
open. Circles parallel to the table stay circles in its plane, so circles are enough.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ._cells import Moments
from ._tolerances import GreyTolerances

Array = NDArray[np.float64]

MOST_PIECES = 220  # short lines, the longest of them, whose normals are met pairwise
MOST_PAIRS = 6000
MOST_SEEDS = 28
SECTORS = 36
VOTE_PX = 2.5  # bin of centre and radius, the error of a cell's line


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

    centres: Array
    radii: Array
    cover: Array
    starts_rad: Array
    extents_rad: Array
    bright_inside: NDArray[np.bool_]


def find_circles(
    points: Array, normals: Array, pieces: Moments, lines: Moments, tol: GreyTolerances
) -> tuple[Circles, NDArray[np.int64]]:
    """Return circles, best covered first, and of each edge point the circle it is of or -1.

    Parameters
    ----------
    points, normals : (n, 2) edge points [px of the plane] and which way it gets brighter
    pieces : lines of cells
    lines : the same merged; long ones are no arcs
    """
    owner = np.full(len(points), -1, dtype=np.int64)
    seeds = _seeds(pieces, lines)
    found: list[tuple[float, ...]] = []
    for cx, cy, r in seeds.tolist():
        circle = _refined(points, normals, owner, np.array([cx, cy]), r, tol)
        if circle is None:
            continue
        centre, radius, inside, sign = circle
        cover, start, extent = _cover(points[inside] - centre, radius)
        if cover < tol.circle_cover:
            continue
        owner[inside] = len(found)
        found.append((centre[0], centre[1], radius, cover, start, extent, sign))
    table = np.array(found, dtype=np.float64).reshape(-1, 7)
    order = np.argsort(-table[:, 3], kind="stable")
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    owner[owner >= 0] = place[owner[owner >= 0]]
    table = table[order]
    return (
        Circles(table[:, :2], table[:, 2], table[:, 3], table[:, 4], table[:, 5], table[:, 6] < 0),
        owner,
    )


def _seeds(pieces: Moments, lines: Moments) -> Array:
    """Return (n, 3) centres and radii that most pairs of pieces agree on."""
    length = np.linalg.norm(pieces.ends[:, 1] - pieces.ends[:, 0], axis=1)
    pick = np.argsort(-length, kind="stable")[:MOST_PIECES]
    middle, normal, weight = pieces.ends[pick].mean(axis=1), pieces.normals[pick], length[pick]
    i, j = np.triu_indices(len(pick), 1)
    cross = normal[i, 0] * normal[j, 1] - normal[i, 1] * normal[j, 0]
    bent = np.abs(cross) > 0.26  # 15 deg: normals nearer to parallel meet anywhere
    i, j, cross = i[bent], j[bent], cross[bent]
    d = middle[j] - middle[i]
    s = (d[:, 0] * normal[j, 1] - d[:, 1] * normal[j, 0]) / cross  # along i's normal
    t = (d[:, 0] * normal[i, 1] - d[:, 1] * normal[i, 0]) / cross  # along j's
    ok = (np.abs(s - t) < 1.5 + 0.03 * np.abs(s)) & (np.abs(s) > 2.0)
    i, j, s, t = i[ok], j[ok], s[ok], t[ok]
    if len(i) == 0:
        return np.zeros((0, 3))
    if len(i) > MOST_PAIRS:
        keep = np.argsort(-(weight[i] * weight[j]), kind="stable")[:MOST_PAIRS]
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
    _, where, inverse = np.unique(key, return_index=True, return_inverse=True)
    total = np.bincount(inverse.ravel(), weights=votes)
    mean = np.stack(
        [
            np.bincount(inverse.ravel(), weights=votes * column) / total
            for column in (centre[:, 0], centre[:, 1], np.abs(radius))
        ],
        axis=1,
    )
    best = np.argsort(-total, kind="stable")[: 3 * MOST_SEEDS]
    kept: list[int] = []
    for b in best.tolist():
        if all(np.abs(mean[b] - mean[k]).max() > VOTE_PX for k in kept):
            kept.append(b)
        if len(kept) == MOST_SEEDS:
            break
    return mean[kept]


def _refined(
    points: Array,
    normals: Array,
    owner: NDArray[np.int64],
    centre: Array,
    radius: float,
    tol: GreyTolerances,
) -> tuple[Array, float, NDArray[np.int64], float] | None:
    """Return a circle fitted to its points: centre, radius, points, 1 where bright outside."""
    sign = 0.0
    inside = np.zeros(0, dtype=np.int64)
    near = np.flatnonzero(
        (np.abs(points - centre).max(axis=1) < radius + 4 + 0.05 * radius) & (owner < 0)
    )
    for band in (2.5 + 0.03 * radius, 1.5, tol.circle_px):
        offset = points[near] - centre
        distance = np.linalg.norm(offset, axis=1)
        radial = np.einsum("ni,ni->n", offset, normals[near]) / np.maximum(distance, 1e-6)
        on = (np.abs(distance - radius) < band) & (np.abs(radial) > 0.95)
        if sign == 0.0:
            sign = 1.0 if radial[on].sum() > 0 else -1.0
        on &= radial * sign > 0
        inside = near[on]
        if len(inside) < 8:
            return None
        p = points[inside] - centre
        a = np.column_stack([2 * p, np.ones(len(p))])
        # algebraic least squares is biased on short arcs; the bands close in on what is left
        solution, *_ = np.linalg.lstsq(a, (p * p).sum(axis=1), rcond=None)
        radius_new = float(np.sqrt(max(solution[2] + solution[:2] @ solution[:2], 0.0)))
        if not 0.7 * radius < radius_new < 1.4 * radius + 2:
            return None
        centre, radius = centre + solution[:2], radius_new
    # a point for each pixel, a little less where the ridge steps diagonally
    if len(inside) < 0.5 * 2 * np.pi * radius * 0.85 * tol.circle_cover:
        return None
    return centre, radius, inside, sign


def _cover(offset: Array, radius: float) -> tuple[float, float, float]:
    """Return the share of the turn with points, and start and extent of the seen arc."""
    sectors = int(np.clip(2 * np.pi * radius / 2.5, 8, SECTORS))
    angle = np.arctan2(offset[:, 1], offset[:, 0]) % (2 * np.pi)
    of = np.minimum((angle * (sectors / (2 * np.pi))).astype(np.int64), sectors - 1)
    filled = np.bincount(of, minlength=sectors) > 0
    cover = float(filled.mean())
    if filled.all():
        return cover, 0.0, 2 * np.pi
    # the seen arc is what the longest gap leaves
    empty = np.r_[~filled, ~filled]
    edge = np.flatnonzero(np.diff(np.r_[0, empty.astype(np.int8), 0]))
    begin, stop = edge[::2], edge[1::2]
    longest = int((stop - begin).argmax())
    gap = min(int(stop[longest] - begin[longest]), sectors)
    start = (stop[longest] % sectors) * 2 * np.pi / sectors
    return cover, float(start), float((sectors - gap) * 2 * np.pi / sectors)
