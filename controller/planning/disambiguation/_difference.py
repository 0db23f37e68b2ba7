"""Least number of pixels by which two pictures differ, for any seat of the part in the gripper."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from controller.arrays import BoolArray, Float32Array, FloatArray
from controller.imaging import mask_rim

from ..model import Light
from ._pictures import EdgePicture, Stance

TURN_COUNT = 9
SHIFT_COUNT = 9
POINT_COUNT = 300  # points of a line that the search moves; all are counted in the end
FINISHED_COUNT = 4  # placings that are evaluated fully
ROUND_COUNT = 4
FAR_CELLS = 20.0
NEARER_COUNTS = 20.0  # a point without a partner counts this much more than one far from it
_NEAR = np.stack(np.meshgrid(*[[0.0, -1.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)


def difference(a: EdgePicture, b: EdgePicture, stance: Stance, light: Light) -> float:
    """Return the least number of pixels by which two pictures on one grid differ.

    One picture is moved over the other, within the uncertainty of the hold, to the best agreement.
    Against the backlight the result is the area covered in only one of them, farther from the other
    than the tolerance; under the lamps it is the length of edges without an equally near edge in
    the other. Areas covered by the arm gripper in either do not count.

    Parameters
    ----------
    a, b : two predictions, or a measured picture and a prediction
    stance : uncertainty of the part's pose
    light : against the backlight or under the lamps
    """
    step = a.step_px
    tolerance = stance.tolerance_px / step + 0.5  # half a cell is lost in drawing
    ignore = (a.behind | b.behind) if light == "backlight" else (a.before | b.before)
    lines = (mask_rim(a.mask), mask_rim(b.mask)) if light == "backlight" else (a.edges, b.edges)
    own = (_points(lines[0] & ~ignore), _points(lines[1] & ~ignore))
    pair = _Pair(own, (_distance_to(lines[0]), _distance_to(lines[1])), stance.pivot_px / step)

    def pixels(placing: FloatArray) -> float:
        if light == "front":
            return float(_count(pair, placing, tolerance)) * step
        return float(_area(a.mask, b.mask, ignore, pair.pivot, placing, tolerance)) * step**2

    least = pixels(np.zeros(3))
    if least == 0.0:  # as most pairs are, from most sides
        return least
    for placing in _placings(pair, stance, step, tolerance):
        least = min(least, pixels(placing))
    return least


@dataclass(frozen=True, slots=True, eq=False)
class _Pair:
    """The lines of two pictures as points (n, 2) in cells, with distance maps."""

    points: tuple[FloatArray, FloatArray]
    far: tuple[Float32Array, Float32Array]
    pivot: FloatArray

    def thinned(self) -> _Pair:
        """Return the pair with no more points than a search needs."""
        first, second = (p[:: max(1, len(p) // POINT_COUNT)] for p in self.points)
        return _Pair((first, second), self.far, self.pivot)


def _placings(pair: _Pair, stance: Stance, step: int, tolerance: float) -> FloatArray:
    """Return the best few placings (turn, dx, dy), in radians and cells (k, 3).

    A grid no coarser than the tolerance, then finer ones about its best places.
    """
    few = pair.thinned()
    shift = stance.shift_px / step
    shift_count = min(SHIFT_COUNT, 2 * int(np.ceil(shift / tolerance)) + 1)
    turns = np.linspace(-stance.turn_rad, stance.turn_rad, TURN_COUNT)
    line = np.linspace(-shift, shift, shift_count)
    grid = np.stack(np.meshgrid(turns, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    limit = np.array([stance.turn_rad, shift, shift])
    width = np.array([turns[1] - turns[0], *([2 * shift / max(shift_count - 1, 1)] * 2)])
    best = grid[np.argsort(_costs(few, grid, tolerance), kind="stable")[:FINISHED_COUNT]]
    for _ in range(ROUND_COUNT):
        width = width / 2
        near = best[:, None] + _NEAR * width
        near = np.clip(near, -limit, limit)
        cost = _costs(few, near.reshape(-1, 3), tolerance).reshape(len(best), -1)
        best = near[np.arange(len(best)), np.argmin(cost, axis=1)]
    return best


def _costs(pair: _Pair, placings: FloatArray, tolerance: float) -> FloatArray:
    """Return the cost of placings (m, 3): (m,).

    The share of points without a partner, plus a small term for the distance of all, which guides
    the search.
    """
    total = np.zeros(len(placings))
    for k in (0, 1):
        if len(pair.points[k]):
            away = _look_up(pair.far[1 - k], _moved(pair.points[k], pair.pivot, placings, k == 1))
            total += (away > tolerance).mean(axis=1)
            total += np.minimum(away, FAR_CELLS).mean(axis=1) / (FAR_CELLS * NEARER_COUNTS)
    return total


def _moved(
    points: FloatArray, pivot: FloatArray, placings: FloatArray, is_back: bool
) -> Float32Array:
    """Return points (n, 2) turned about the pivot and shifted (m, n, 2); or moved back."""
    p = (points - pivot).astype(np.float32)
    turn = -placings[:, 0] if is_back else placings[:, 0]
    c, s = np.cos(turn).astype(np.float32)[:, None], np.sin(turn).astype(np.float32)[:, None]
    shift = placings[:, 1:].astype(np.float32)
    x, y = p[:, 0], p[:, 1]
    out = np.empty((len(placings), len(points), 2), np.float32)
    if is_back:
        x, y = x - shift[:, :1], y - shift[:, 1:]
        out[..., 0], out[..., 1] = c * x - s * y, s * x + c * y
    else:
        out[..., 0] = c * x - s * y + shift[:, :1]
        out[..., 1] = s * x + c * y + shift[:, 1:]
    out += pivot.astype(np.float32)
    return out


def _count(pair: _Pair, placing: FloatArray, tolerance: float) -> int:
    """Return the number of points of both without a partner at one placing (3,)."""
    count = 0
    for k in (0, 1):
        moved = _moved(pair.points[k], pair.pivot, placing[None], k == 1)
        count += int((_look_up(pair.far[1 - k], moved) > tolerance).sum())
    return count


def _area(
    a: BoolArray, b: BoolArray, ignore: BoolArray, pivot: FloatArray, p: FloatArray, tol: float
) -> int:
    """Return the number of cells that only one of both covers, beyond the tolerance."""
    c, s = np.cos(p[0]), np.sin(p[0])
    R = np.array([[c, -s], [s, c]])
    motion = np.column_stack([R, pivot + p[1:] - R @ pivot])
    height, width = a.shape
    moved = cv2.warpAffine(a.astype(np.uint8), motion, (width, height), flags=cv2.INTER_NEAREST) > 0
    hidden = cv2.warpAffine(ignore.astype(np.uint8), motion, (width, height)) > 0
    counts = ~(ignore | hidden)
    only_a = moved & (_distance_to(b) > tol)
    only_b = b & (_distance_to(moved) > tol)
    return int(((only_a | only_b) & counts).sum())


def _look_up(far: Float32Array, points: Float32Array) -> Float32Array:
    """Return the distance (...) at the cells nearest to points (..., 2), clamped to the grid."""
    height, width = far.shape
    x = np.minimum(np.maximum((points[..., 0] + 0.5).astype(np.int32), 0), width - 1)
    y = np.minimum(np.maximum((points[..., 1] + 0.5).astype(np.int32), 0), height - 1)
    return np.asarray(np.take(far, y * width + x))


def _distance_to(mask: BoolArray) -> Float32Array:
    """Return the distance of every cell to the nearest one of a mask (h, w)."""
    if not mask.any():
        return np.full(mask.shape, 1e3, np.float32)
    return np.asarray(cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5))


def _points(mask: BoolArray) -> FloatArray:
    y, x = np.nonzero(mask)
    return np.column_stack([x, y]).astype(np.float64)
