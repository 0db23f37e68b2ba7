"""Agreement of placed views with a picture's edges: many at once, coarse and fine.

The picture's edgelets are written once into a map over place and direction, each with its number,
out to the tolerance; a model's edgelet is then looked up, not searched for.
"""

from dataclasses import dataclass

import numpy as np

from controller.arrays import Float32Array, FloatArray, Int32Array, IntArray

from ._edgelets import Edgelets
from ._index import ASKED, EdgeletIndex

CELL_MM = 0.8
DIRECTIONS = 16
FIRST_ASKED = 24  # edgelets of a view in its first score
FIT_ROUNDS = 3
REACH_MM = 1.6  # distance of edges from a coarse placement: 3 deg on 30 mm
# The same of a fitted one, and the angle between edges: walls that the view at the table's centre
# does not show, and doubled lines, move edges by that much.
MATCH_MM, MATCH_RAD = 0.7, np.radians(9.0)


@dataclass(frozen=True, eq=False, slots=True)
class EdgeMap:
    """A picture's edgelets by place and direction.

    Attributes
    ----------
    nearest : (height x width x directions,) number of the nearest edgelet in reach, -1 if none;
        its last entry is for what is outside
    shape : (height, width)
    low_mm : (2,) its corner
    x_mm, y_mm, normal_x, normal_y, weights : (n + 1,) of the edgelets, about the camera's foot; a
        last one of no weight, so that -1 can be asked for
    """

    nearest: Int32Array
    shape: tuple[int, int]
    low_mm: Float32Array
    x_mm: Float32Array
    y_mm: Float32Array
    normal_x: Float32Array
    normal_y: Float32Array
    weights: Float32Array


def edge_map(edgelets: Edgelets, foot_mm: FloatArray) -> EdgeMap:
    """Return the map of a picture's edgelets.

    Parameters
    ----------
    edgelets : edgelets of the picture, table plane [mm]; at least one
    foot_mm : (2,) point of the table below the camera, which the map is about
    """
    points = edgelets.points_mm - foot_mm
    reach = int(np.ceil(REACH_MM / CELL_MM))
    low = points.min(axis=0) - (reach + 1.5) * CELL_MM
    cell = np.floor((points - low) / CELL_MM).astype(np.int64)
    width, height = (cell.max(axis=0) + reach + 2).tolist()
    direction = np.round(edgelets.directions_rad * (DIRECTIONS / np.pi)).astype(np.int64)
    steps = np.stack(
        [g.ravel() for g in np.meshgrid(*[np.arange(-reach, reach + 1)] * 2, [-1, 0, 1])], axis=1
    )
    away = steps[:, 0] ** 2 + steps[:, 1] ** 2
    steps, away = steps[away <= (reach + 0.5) ** 2], away[away <= (reach + 0.5) ** 2]
    # the farthest are written first, so that nearer ones overwrite them
    steps = steps[np.argsort(-away - 0.5 * steps[:, 2] ** 2, kind="stable")]
    nearest = np.full(height * width * DIRECTIONS + 1, -1, dtype=np.int32)
    base = (cell[:, 1] * width + cell[:, 0]) * DIRECTIONS
    planes = (direction[None] + np.array([-1, 0, 1])[:, None]) % DIRECTIONS
    away_by = (steps[:, 1] * width + steps[:, 0]) * DIRECTIONS
    # of places named twice the last one named holds
    nearest[base + away_by[:, None] + planes[steps[:, 2] + 1]] = np.arange(
        len(points), dtype=np.int32
    )
    angle = edgelets.directions_rad
    columns = (
        points[:, 0],
        points[:, 1],
        -np.sin(angle),
        np.cos(angle),
        edgelets.lengths_mm * edgelets.strengths,
    )
    return EdgeMap(
        nearest,
        (height, width),
        low.astype(np.float32),
        *(np.append(c, 0.0).astype(np.float32) for c in columns),
    )


def _look_up(
    seen: EdgeMap, pieces: Float32Array, poses: Float32Array
) -> tuple[Int32Array, Float32Array, Float32Array, Float32Array]:
    """Return the edgelets met by pieces (5, h, k) under poses (h, 4), with x, y and directions."""
    cos, sin = np.cos(poses[:, 1:2]), np.sin(poses[:, 1:2])
    x, y, k = pieces[:3]
    px = cos * x - sin * y + k * poses[:, 2:3]
    py = sin * x + cos * y + k * poses[:, 3:4]
    angle = pieces[3] + poses[:, 1:2]
    height, width = seen.shape
    per_mm = np.float32(1 / CELL_MM)
    # a little to the left of the map is column 0: nothing is within reach of the map's rim
    column = ((px - seen.low_mm[0]) * per_mm).astype(np.int32)
    row = ((py - seen.low_mm[1]) * per_mm).astype(np.int32)
    plane = np.rint(angle * np.float32(DIRECTIONS / np.pi)).astype(np.int32) & (DIRECTIONS - 1)
    # as unsigned numbers, what is below 0 is beyond the width as well
    outside = (column.view(np.uint32) >= width) | (row.view(np.uint32) >= height)
    key = (row * width + column) * DIRECTIONS + plane
    key[outside] = -1
    return seen.nearest[key], px, py, angle


def quick_scores(seen: EdgeMap, index: EdgeletIndex, poses: FloatArray, most: int) -> IntArray:
    """Return the indices of the best hypotheses, best first, by the share of edges matched.

    A few edgelets of each are tested first: views that cannot reach the ``most``-th best even if
    all their others were found are dropped.

    Parameters
    ----------
    seen : the picture's edgelets
    index : the views
    poses : (n, 4) view, turn [rad] and shift [mm] about the camera's foot
    most : hypotheses returned
    """
    single = poses.astype(np.float32)
    model = poses[:, 0].astype(np.int64)
    total = index.asked_totals[model]
    pieces = index.edgelets(model, 0, FIRST_ASKED)
    first = pieces[4]
    met, *_ = _look_up(seen, pieces, single)
    score = (first * (met >= 0)).sum(axis=1) / total
    bound = score + 1 - first.sum(axis=1) / total
    if len(poses) > most:
        alive = np.flatnonzero(bound >= np.partition(score, -most)[-most])
    else:
        alive = np.arange(len(poses))
    pieces = index.edgelets(model[alive], FIRST_ASKED, ASKED)
    met, *_ = _look_up(seen, pieces, single[alive])
    full = score[alive] + (pieces[4] * (met >= 0)).sum(axis=1) / total[alive]
    return alive[np.argsort(-full, kind="stable")[:most]]


def fitted(seen: EdgeMap, index: EdgeletIndex, poses: FloatArray) -> FloatArray:
    """Return hypotheses (n, 4) moved so that their edgelets lie on those of the picture.

    Parameters
    ----------
    seen : the picture's edgelets
    index : the views
    poses : (n, 4) view, turn [rad] and shift [mm] about the camera's foot; left as they are
    """
    poses = poses.copy()
    pieces = index.edgelets(poses[:, 0].astype(np.int64), 0, ASKED)
    k = pieces[2]
    narrow = np.float32(1 / (0.5 * REACH_MM) ** 2)
    for _ in range(FIT_ROUNDS):
        single = poses.astype(np.float32)
        met, x, y, _ = _look_up(seen, pieces, single)
        nx, ny = seen.normal_x[met], seen.normal_y[met]
        gap = (seen.x_mm[met] - x) * nx + (seen.y_mm[met] - y) * ny
        slopes = np.stack(
            [(x - k * single[:, 2:3]) * ny - (y - k * single[:, 3:4]) * nx, k * nx, k * ny], axis=1
        )
        # far ones may belong to another line: they count less
        weight = pieces[4] * (met >= 0) / (1 + gap * gap * narrow)
        weighted = slopes * weight[:, None]
        system = (weighted @ slopes.transpose(0, 2, 1)).astype(np.float64)
        side = (weighted @ gap[..., None])[..., 0].astype(np.float64)
        # a view that is round about its origin leaves the turn as it is
        system[:, [0, 1, 2], [0, 1, 2]] += np.array([4.0, 1e-2, 1e-2])
        poses[:, 1:] += np.linalg.solve(system, side[..., None])[..., 0]
    return poses


def rated(seen: EdgeMap, index: EdgeletIndex, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the shares (n,) of each view's edges found, and of the picture's edges explained.

    Parameters
    ----------
    seen : the picture's edgelets
    index : the views
    poses : (n, 4) view, turn [rad] and shift [mm] about the camera's foot, `fitted`
    """
    model = poses[:, 0].astype(np.int64)
    pieces = index.edgelets(model)
    single = poses.astype(np.float32)
    met, x, y, angle = _look_up(seen, pieces, single)
    nx, ny = seen.normal_x[met], seen.normal_y[met]
    gap = np.abs((seen.x_mm[met] - x) * nx + (seen.y_mm[met] - y) * ny)
    lean = np.abs(np.cos(angle) * nx + np.sin(angle) * ny)
    hit = (met >= 0) & (gap < MATCH_MM) & (lean < np.sin(MATCH_RAD))
    # of two that are all near, the one that lies better
    worth = 1 - gap * gap * np.float32(0.5 / MATCH_MM**2)
    found = (pieces[4] * worth * hit).sum(axis=1) / np.maximum(index.totals[model], 1e-9)
    # of the picture's edgelets, those as near to the view's origin as it reaches
    count = len(seen.weights)
    used = np.zeros((len(poses), count), dtype=bool)
    row = np.broadcast_to(np.arange(len(poses))[:, None], met.shape)
    used[row[hit], met[hit]] = True
    # a long view's edgelets are sparser than the picture's: the next of the line is met as well
    used[:, 1:-1] |= used[:, :-2]
    dx = seen.x_mm - single[:, 2:3]
    dy = seen.y_mm - single[:, 3:4]
    reach = (1.1 * index.reach_mm[model] + 2.0).astype(np.float32)
    near = dx * dx + dy * dy < reach[:, None] ** 2
    explained = (used & near) @ seen.weights / np.maximum(near @ seen.weights, 1e-9)
    # a small view that explains all that is near it may be a detail of a large one: the picture's
    # other edges count as well, by half, as they may be another part's
    of_all = used @ seen.weights / max(float(seen.weights.sum()), 1e-9)
    explained = (explained + of_all) / 2
    return found.astype(np.float64), explained.astype(np.float64)
