"""How many pixels of two pictures differ, however the part may sit in the hand."""

from __future__ import annotations

import cv2
import numpy as np

from ..boxes import BoolArray
from ..layout import FloatArray
from ._pictures import Picture, Stance
from ._rules import Light

TURNS_N = 9
SHIFTS_N = 9
POINTS_N = 500  # of an outline are moved about in the search; all are counted in the end
FINISHED_N = 6  # placings that are looked at closely
ROUNDS_N = 4


def difference(a: Picture, b: Picture, stance: Stance, light: Light) -> float:
    """Return by how many pixels two pictures on one grid differ at least.

    One is moved over the other as far as the hold is uncertain, to where they agree best. Against
    the backlight the answer is the area of what one has and the other has not, farther from it
    than the tolerance; under the lamps the length of edges that have no edge of the other as near.
    What the hand covers in either does not count.

    Parameters
    ----------
    a, b : two predictions, or a measured picture and a prediction
    """
    step = a.step_px
    tolerance = stance.tolerance_px / step + 0.5  # half a cell is lost in drawing
    ignore = (a.behind | b.behind) if light == "backlight" else (a.before | b.before)
    lines = (_outline(a.mask), _outline(b.mask)) if light == "backlight" else (a.edges, b.edges)
    own = [_points(e & ~ignore) for e in lines]
    far = [_distance_to(e) for e in lines]
    pivot = stance.pivot_px / step
    best = _placings(own, far, pivot, stance, step, tolerance)
    if light == "front":
        return float(min(_count(own, far, pivot, p, tolerance) for p in best)) * step
    area = min(_area(a.mask, b.mask, ignore, pivot, p, tolerance) for p in best)
    return float(area) * step**2


def _placings(
    own: list[FloatArray],
    far: list[FloatArray],
    pivot: FloatArray,
    stance: Stance,
    step: int,
    tolerance: float,
) -> list[FloatArray]:
    """Return the best few (turn, dx, dy) in radians and cells, by lines that find no partner."""
    few = [_thinned(p) for p in own]
    shift = stance.shift_px / step
    shifts_n = min(SHIFTS_N, 2 * int(np.ceil(shift / max(tolerance, 0.5))) + 1)
    turns = np.linspace(-stance.turn_rad, stance.turn_rad, TURNS_N)
    line = np.linspace(-shift, shift, shifts_n) if shifts_n > 1 else np.zeros(1)
    moves = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
    grid = np.array([[t, *m] for t in turns for m in moves])
    scores = np.concatenate(
        [_costs(few, far, pivot, turn, moves, tolerance) for turn in turns.tolist()]
    )
    # the middle first among equals
    order = np.lexsort(
        (np.abs(grid / [stance.turn_rad or 1, shift or 1, shift or 1]).max(1), scores)
    )
    limit = np.array([stance.turn_rad, shift, shift])
    width = np.array(
        [2 * stance.turn_rad / (TURNS_N - 1), *([2 * shift / max(shifts_n - 1, 1)] * 2)]
    )
    return [_settled(few, far, pivot, grid[k], width, limit, tolerance) for k in order[:FINISHED_N]]


def _settled(
    points: list[FloatArray],
    far: list[FloatArray],
    pivot: FloatArray,
    start: FloatArray,
    width: FloatArray,
    limit: FloatArray,
    tolerance: float,
) -> FloatArray:
    """Return a placing from which no step of a shrinking pattern leads to a better one."""
    here, cost = start, _cost_at(points, far, pivot, start, tolerance)
    for _ in range(ROUNDS_N):
        width = width / 2
        for axis in range(3):
            for sign in (-1.0, 1.0):
                there = here.copy()
                there[axis] = np.clip(here[axis] + sign * width[axis], -limit[axis], limit[axis])
                value = _cost_at(points, far, pivot, there, tolerance)
                if value < cost - 1e-9:
                    here, cost = there, value
    return here


def _cost_at(
    points: list[FloatArray], far: list[FloatArray], pivot: FloatArray, p: FloatArray, tol: float
) -> float:
    return float(_costs(points, far, pivot, float(p[0]), p[None, 1:], tol)[0])


def _costs(
    points: list[FloatArray],
    far: list[FloatArray],
    pivot: FloatArray,
    turn: float,
    moves: FloatArray,
    tolerance: float,
) -> FloatArray:
    """Return the cost of moving the first lines by a turn and each of the moves (m, 2): (m,).

    Points without partner count one, and a little more the farther off they are, so that the
    search finds its way down.
    """
    total = np.zeros(len(moves))
    for k, sign in ((0, 1.0), (1, -1.0)):
        if len(points[k]) == 0:
            continue
        away = _look_up(far[1 - k], _moved(points[k], pivot, turn, moves, sign))
        total += (away > tolerance).mean(axis=1) * _LENGTH + np.minimum(away, _FAR).mean(axis=1)
    return total


_LENGTH, _FAR = 20.0, 20.0


def _moved(
    points: FloatArray, pivot: FloatArray, turn: float, moves: FloatArray, sign: float
) -> FloatArray:
    """Return points (n, 2) turned about the pivot and shifted (m, n, 2); or the way back."""
    c, s = np.cos(sign * turn), np.sin(sign * turn)
    R = np.array([[c, -s], [s, c]])
    if sign > 0:
        return np.asarray((points - pivot) @ R.T + pivot + moves[:, None])
    return np.asarray((points - pivot - moves[:, None]) @ R.T + pivot)


def _count(
    own: list[FloatArray], far: list[FloatArray], pivot: FloatArray, p: FloatArray, tol: float
) -> int:
    """Return how many points of both have no partner at one placing."""
    count = 0
    for k, sign in ((0, 1.0), (1, -1.0)):
        if len(own[k]):
            moved = _moved(own[k], pivot, float(p[0]), p[None, 1:], sign)
            count += int((_look_up(far[1 - k], moved) > tol).sum())
    return count


def _area(
    a: BoolArray, b: BoolArray, ignore: BoolArray, pivot: FloatArray, p: FloatArray, tol: float
) -> int:
    """Return how many cells only one of both covers, farther than the tolerance from the other."""
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


def _look_up(far: FloatArray, points: FloatArray) -> FloatArray:
    height, width = far.shape
    x = np.clip(np.rint(points[..., 0]).astype(np.intp), 0, width - 1)
    y = np.clip(np.rint(points[..., 1]).astype(np.intp), 0, height - 1)
    return np.asarray(far[y, x])


def _distance_to(mask: BoolArray) -> FloatArray:
    """Return the distance of every cell to the nearest one of a mask (h, w)."""
    if not mask.any():
        return np.full(mask.shape, 1e3)
    return np.asarray(cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5), np.float64)


def _outline(mask: BoolArray) -> BoolArray:
    inner = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0)
    return np.asarray(mask & (inner == 0))


def _points(mask: BoolArray) -> FloatArray:
    y, x = np.nonzero(mask)
    return np.column_stack([x, y]).astype(np.float64)


def _thinned(points: FloatArray) -> FloatArray:
    return points[:: max(1, len(points) // POINTS_N)]
