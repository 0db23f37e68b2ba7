"""How well views laid on a picture agree with its edges: many at once, coarse and fine.

The picture's edgelets are written once into a map over place and direction, each with its number,
out to the tolerance; a model's edgelet is then looked up, not searched for.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ._features import Edgelets
from ._index import FeatureIndex
from ._tolerances import GreyTolerances

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

CELL_MM = 0.8
DIRECTIONS = 16
FIRST_ASKED = 24  # edgelets of a view that its first score is of
ASKED = 96
FIT_ROUNDS = 2


@dataclass(frozen=True, eq=False, slots=True)
class EdgeMap:
    """A picture's edgelets by place and direction.

    Attributes
    ----------
    nearest : (height, width, directions) number of the nearest edgelet in reach, -1 if none
    low_mm : (2,) its corner
    points_mm, normals, weights : (n, 2), (n, 2), (n,) of the edgelets, about the camera's foot
    """

    nearest: NDArray[np.int32]
    low_mm: Array
    points_mm: Array
    normals: Array
    weights: Array


def edge_map(edgelets: Edgelets, foot_mm: Array, tol: GreyTolerances) -> EdgeMap:
    """Return the map of a picture's edgelets."""
    points = edgelets.points_mm - foot_mm
    reach = int(np.ceil(tol.reach_mm / CELL_MM))
    low = points.min(axis=0) - (reach + 1.5) * CELL_MM
    cell = np.floor((points - low) / CELL_MM).astype(np.int64)
    shape = (*(cell.max(axis=0) + reach + 2)[::-1].tolist(), DIRECTIONS)
    direction = np.round(edgelets.directions_rad * (DIRECTIONS / np.pi)).astype(np.int64)
    steps = np.stack(
        [g.ravel() for g in np.meshgrid(*[np.arange(-reach, reach + 1)] * 2, [-1, 0, 1])], axis=1
    )
    away = np.hypot(steps[:, 0], steps[:, 1])
    steps = steps[away <= reach + 0.5]
    # the farthest are written first, so that nearer ones overwrite them
    steps = steps[np.argsort(-(steps[:, :2] ** 2).sum(axis=1) - 0.5 * steps[:, 2] ** 2)][:, None]
    nearest = np.full(shape, -1, dtype=np.int32)
    column, row = cell[None, :, 0] + steps[..., 0], cell[None, :, 1] + steps[..., 1]
    plane = (direction[None] + steps[..., 2]) % DIRECTIONS
    key = (row * shape[1] + column) * DIRECTIONS + plane
    nearest.ravel()[key.ravel()] = np.tile(np.arange(len(points)), len(steps))
    angle = edgelets.directions_rad
    normals = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    return EdgeMap(nearest, low, points, normals, edgelets.lengths_mm * edgelets.strengths)


def _look_up(seen: EdgeMap, pieces: Array, poses: Array) -> tuple[Ints, Array, Array]:
    """Return for pieces (h, k, 5) under poses (h, 4) the edgelets met, places and directions."""
    cos, sin = np.cos(poses[:, 1])[:, None], np.sin(poses[:, 1])[:, None]
    x, y, k = pieces[..., 0], pieces[..., 1], pieces[..., 2]
    px = cos * x - sin * y + k * poses[:, 2:3]
    py = sin * x + cos * y + k * poses[:, 3:4]
    angle = pieces[..., 3] + poses[:, 1:2]
    height, width, _ = seen.nearest.shape
    column = np.floor((px - seen.low_mm[0]) / CELL_MM).astype(np.int64)
    row = np.floor((py - seen.low_mm[1]) / CELL_MM).astype(np.int64)
    plane = np.round(angle * (DIRECTIONS / np.pi)).astype(np.int64) % DIRECTIONS
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    key = (np.where(inside, row, 0) * width + np.where(inside, column, 0)) * DIRECTIONS + plane
    met = np.where(inside, seen.nearest.ravel()[key], -1)
    return met.astype(np.int64), np.stack([px, py], axis=2), angle


def quick_scores(seen: EdgeMap, index: FeatureIndex, poses: Array, most: int) -> Ints:
    """Return which hypotheses (n, 4) are the best, by how much of the view has an edge near.

    A few edgelets of each first: those that cannot reach the ``most``-th best, were all the rest
    of theirs found, are not asked further.
    """
    model = poses[:, 0].astype(np.int64)
    pieces = index.edgelets[model, :ASKED]
    weights = pieces[..., 4]
    total = np.maximum(weights.sum(axis=1), 1e-9)
    first = weights[:, :FIRST_ASKED]
    met, _, _ = _look_up(seen, pieces[:, :FIRST_ASKED], poses)
    score = (first * (met >= 0)).sum(axis=1) / total
    bound = score + 1 - first.sum(axis=1) / total
    if len(poses) > most:
        alive = np.flatnonzero(bound >= np.partition(score, -most)[-most])
    else:
        alive = np.arange(len(poses))
    rest, _, _ = _look_up(seen, pieces[alive, FIRST_ASKED:], poses[alive])
    full = score[alive] + (weights[alive, FIRST_ASKED:] * (rest >= 0)).sum(axis=1) / total[alive]
    return alive[np.argsort(-full, kind="stable")[:most]]


def fitted(seen: EdgeMap, index: FeatureIndex, poses: Array, tol: GreyTolerances) -> Array:
    """Return hypotheses (n, 4) moved so that their edgelets lie on those of the picture."""
    poses = poses.copy()
    pieces = index.edgelets[poses[:, 0].astype(np.int64), :ASKED].astype(np.float64)
    for _ in range(FIT_ROUNDS):
        met, places, _ = _look_up(seen, pieces, poses)
        hit = met >= 0
        normal = seen.normals[met]
        gap = np.einsum("hki,hki->hk", seen.points_mm[met] - places, normal)
        k = pieces[..., 2]
        arm = places - k[..., None] * poses[:, None, 2:]
        slopes = np.stack(
            [
                -arm[..., 1] * normal[..., 0] + arm[..., 0] * normal[..., 1],
                k * normal[..., 0],
                k * normal[..., 1],
            ],
            axis=2,
        )
        # far ones may belong to another line: they count less
        weight = pieces[..., 4] * hit / (1 + (gap / (0.5 * tol.reach_mm)) ** 2)
        system = np.einsum("hki,hk,hkj->hij", slopes, weight, slopes)
        side = np.einsum("hki,hk->hi", slopes, weight * gap)
        # a view that is round about its origin leaves the turn as it is
        system[:, [0, 1, 2], [0, 1, 2]] += np.array([4.0, 1e-2, 1e-2])
        poses[:, 1:] += np.linalg.solve(system, side[..., None])[..., 0]
    return poses


def rated(seen: EdgeMap, index: FeatureIndex, poses: Array, tol: GreyTolerances) -> Array:
    """Return (n, 3) score, and the shares found of the view's and of the picture's edges."""
    model = poses[:, 0].astype(np.int64)
    pieces = index.edgelets[model].astype(np.float64)
    met, places, angle = _look_up(seen, pieces, poses)
    normal = seen.normals[met]
    gap = np.abs(np.einsum("hki,hki->hk", seen.points_mm[met] - places, normal))
    lean = np.abs(np.cos(angle) * normal[..., 0] + np.sin(angle) * normal[..., 1])
    hit = (met >= 0) & (gap < tol.match_mm) & (lean < np.sin(tol.match_rad))
    found = (pieces[..., 4] * hit).sum(axis=1) / np.maximum(index.totals[model], 1e-9)
    # the picture's edgelets that are near the view, as far as it reaches
    count = len(seen.weights)
    used = np.zeros((len(poses), count), dtype=bool)
    row = np.broadcast_to(np.arange(len(poses))[:, None], met.shape)
    used[row[hit], met[hit]] = True
    used[:, 1:] |= used[:, :-1]  # a view's edgelets are no denser than the picture's
    away = np.hypot(
        seen.points_mm[None, :, 0] - poses[:, 2:3], seen.points_mm[None, :, 1] - poses[:, 3:4]
    )
    near = away < 1.1 * index.reach_mm[model][:, None] + 2.0
    explained = (used & near) @ seen.weights / np.maximum(near @ seen.weights, 1e-9)
    score = 2 * found * explained / np.maximum(found + explained, 1e-9)
    return np.stack([score, found, explained], axis=1)
