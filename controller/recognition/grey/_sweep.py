"""Views tried all over a place, for things without a whole outline.

A dark side lies in the dark, a streak hides a corner: then only a piece is cut out. Every turn is
tried at places of a grid, and the share of a view's edges with a parallel edge near by is counted.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from controller.arrays import ByteArray, FloatArray, IntArray

from ._edgelets import Edgelets, join_edgelets
from ._index import EdgeletIndex
from ._score import edge_map, fitted, quick_scores, rated

CELL_MM = 1.0
DIRECTIONS = 16
NEAR_MM = 2.0  # an edge this far off counts no more: half a step of the grid, and of the turn
STEP_CELLS = 2
TURN_MM = 2.5  # distance between two turns, at a view's farthest edge
ASKED = 12  # edgelets tested for each placement
OFF_SHARE = 0.25  # distance of a piece from a thing's middle, as a share of the thing's extent
OFF_MM = 5.0  # distance added for a shadow
MAX_LOOKS = 40_000_000  # edgelets looked up in all: the views likest in size come first
MAX_KEPT, MAX_OF_VIEW = 3000, 120
MAX_FITTED = 60
SAME_RAD, SAME_MM = np.pi / 60, 1.5  # placements of a view nearer than this are one


@dataclass(frozen=True, eq=False, slots=True)
class PlacedView:
    """A view placed on the picture.

    Attributes
    ----------
    view : number of the view in the index
    turn_rad : anticlockwise from above
    shift_mm : (2,) shift of the view's origin, on the table
    score : 0..1, harmonic mean of the shares of edges on both sides that are found on the other
    """

    view: int
    turn_rad: float
    shift_mm: FloatArray
    score: float


def swept(
    shown: Sequence[Edgelets],
    clear: Edgelets,
    index: EdgeletIndex,
    turns_rad: FloatArray,
    box_mm: FloatArray,
    *,
    foot_mm: tuple[float, float],
    most: int,
) -> tuple[PlacedView, ...]:
    """Return the hypotheses for a thing by its edges alone, best first.

    Parameters
    ----------
    shown : edges of the thing and about it under each lamp, table plane [mm]: an edge of a view is
        there if one lamp shows it
    clear : mask of the edges that are no shadows, which a view has to explain
    index : the library's views
    turns_rad : (views,) smallest turn that leaves each unchanged; 0 for a round one
    box_mm : (2, 2) lowest and highest x and y of the thing, or of a piece of it
    foot_mm : the point of the table plane below the camera, which tall parts lean away from
    most : hypotheses returned
    """
    foot = np.asarray(foot_mm, dtype=np.float64)
    every = join_edgelets(list(shown))
    if len(index.sizes_mm) == 0 or len(every.points_mm) == 0 or len(clear.points_mm) == 0:
        return ()
    coarse = _placed(every, index, turns_rad, box_mm - foot, foot)
    if len(coarse) == 0:
        return ()
    seen = edge_map(every, foot)
    coarse = coarse[quick_scores(seen, index, coarse, MAX_FITTED)]
    poses = fitted(seen, index, coarse)
    found = rated(seen, index, poses)[0]
    explained = rated(edge_map(clear, foot), index, poses)[1]
    scores = 2 * found * explained / np.maximum(found + explained, 1e-9)
    return tuple(
        PlacedView(
            int(poses[i, 0]),
            float((poses[i, 1] + np.pi) % (2 * np.pi) - np.pi),
            poses[i, 2:] + foot,
            float(scores[i]),
        )
        for i in _distinct(poses, scores, most).tolist()
    )


def _distinct(poses: FloatArray, scores: FloatArray, most: int) -> IntArray:
    """Return the ``most`` best poses (n, 4), without near duplicates of better ones."""
    order = np.argsort(-scores, kind="stable")
    p = poses[order]
    turn = np.abs((p[:, None, 1] - p[None, :, 1] + np.pi) % (2 * np.pi) - np.pi)
    same = (p[:, None, 0] == p[None, :, 0]) & (turn < SAME_RAD)
    for axis in (2, 3):
        same &= np.abs(p[:, None, axis] - p[None, :, axis]) < SAME_MM
    kept: list[int] = []
    is_taken = np.zeros(len(p), dtype=np.bool_)
    for i in range(len(p)):
        if not is_taken[i]:
            kept.append(i)
            is_taken |= same[i]
        if len(kept) == most:
            break
    return order[kept]


def _placed(
    every: Edgelets,
    index: EdgeletIndex,
    turns_rad: FloatArray,
    box: FloatArray,
    foot: FloatArray,
) -> FloatArray:
    """Return (n, 4) view, turn and shift of placements on a grid that meet the most edges."""
    extent = box[1] - box[0]
    half = OFF_SHARE * extent + OFF_MM
    low, high = box.mean(axis=0) - half, box.mean(axis=0) + half
    able = np.flatnonzero(index.sizes_mm > 0)
    size = np.sqrt(np.prod(extent) * np.pi / 4)
    able = able[np.argsort(np.abs(np.log(index.sizes_mm[able] / size)), kind="stable")]
    turn_count = np.maximum(np.ceil(turns_rad * index.reach_mm / TURN_MM), 1).astype(np.int64)
    nx, ny = (np.ceil((high - low) / (STEP_CELLS * CELL_MM)).astype(int) + 1).tolist()
    looks = np.cumsum(turn_count[able]) * nx * ny * ASKED
    able = able[: max(int(np.searchsorted(looks, MAX_LOOKS)), 1)]
    if len(able) == 0:
        return np.zeros((0, 4))
    reach = 1.5 * float(index.reach_mm[able].max()) + 2 * NEAR_MM
    corner = low - reach
    near = _near_map(every, foot, corner, high + reach)
    width = near.shape[2]
    flat = near.ravel()
    step = STEP_CELLS * (np.arange(ny)[:, None] * width + np.arange(nx)).ravel()
    rows, scores = [], []
    for view in able.tolist():
        turns = np.arange(turn_count[view]) * (turns_rad[view] / turn_count[view])
        at, weight = _cells(index, view, turns, box.mean(axis=0), low - corner, near.shape)
        at = np.clip(at, 0, flat.size - 1 - int(step[-1]))
        value = np.zeros((len(turns), len(step)), dtype=np.float32)
        for of_each, share in zip(at.T, weight.astype(np.float32), strict=True):
            value += share * flat[of_each[:, None] + step]
        best = np.argpartition(-value.ravel(), min(MAX_OF_VIEW, value.size - 1))[:MAX_OF_VIEW]
        turn, place = np.divmod(best, len(step))
        down, right = np.divmod(place, nx)
        middle = low + STEP_CELLS * CELL_MM * np.column_stack([right, down])
        angle = turns[turn]
        shift = (middle - _turned(index.middles_mm[view], angle)) / index.spreads[view]
        rows.append(np.column_stack([np.full(len(best), float(view)), angle, shift]))
        scores.append(value.ravel()[best])
    found, score = np.concatenate(rows), np.concatenate(scores)
    return found[np.argsort(-score, kind="stable")[:MAX_KEPT]]


def _near_map(every: Edgelets, foot: FloatArray, low: FloatArray, high: FloatArray) -> ByteArray:
    """Return a map of the nearness (directions, h, w) of an edge, 0 for far to 255."""
    width, height = (np.ceil((high - low) / CELL_MM).astype(int) + 2).tolist()
    cell = np.floor((every.points_mm - foot - low) / CELL_MM).astype(np.int64)
    is_in = ((cell >= 0) & (cell < np.array([width, height]))).all(axis=1)
    x, y = cell[is_in].T
    plane = np.round(every.directions_rad[is_in] * (DIRECTIONS / np.pi)).astype(np.int64)
    free = np.ones((DIRECTIONS, height, width), dtype=np.uint8)
    for beside in (-1, 0, 1):
        free[(plane + beside) % DIRECTIONS, y, x] = 0
    out = np.empty_like(free)
    for number, one in enumerate(free):
        far = np.minimum(cv2.distanceTransform(one, cv2.DIST_L2, 3) * (CELL_MM / NEAR_MM), 1.0)
        out[number] = 255.0 * (1.0 - far * far)
    return out


def _cells(
    index: EdgeletIndex,
    view: int,
    turns: FloatArray,
    middle: FloatArray,
    begin: FloatArray,
    shape: tuple[int, ...],
) -> tuple[IntArray, FloatArray]:
    """Return the map cells (t, k) of edgelets, and their weights (k,).

    Parameters
    ----------
    turns : (t,) turns of the view
    middle : (2,) middle of the thing, from the camera's foot
    begin : (2,) in the map, where the middle of the view's hull is
    shape : shape of the map
    """
    x, y, spread, direction, weight = index.edgelets(np.array([view]), 0, ASKED)[:, 0].astype(float)
    own, own_spread = index.middles_mm[view], float(index.spreads[view])
    cos, sin = np.cos(turns)[:, None], np.sin(turns)[:, None]
    # what stands higher moves further from the foot; across the grid the difference is small
    shift = middle - _turned(own, turns)
    lean = spread / own_spread - 1.0
    px = cos * (x - own[0]) - sin * (y - own[1]) + begin[0] + lean * shift[:, :1]
    py = sin * (x - own[0]) + cos * (y - own[1]) + begin[1] + lean * shift[:, 1:]
    plane = np.rint((direction + turns[:, None]) * (DIRECTIONS / np.pi)).astype(np.int64)
    _, height, width = shape
    column = (px / CELL_MM).astype(np.int64)
    row = (py / CELL_MM).astype(np.int64)
    at = ((plane % DIRECTIONS) * height + row) * width + column
    return at, weight / max(float(weight.sum()), 1e-9)


def _turned(point: FloatArray, angle: FloatArray) -> FloatArray:
    """Return a point (2,) turned by angles (n,), (n, 2)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.column_stack([c * point[0] - s * point[1], s * point[0] + c * point[1]])
