"""Matches of a picture's features with a placed view's: one to one, the nearest first."""

from dataclasses import dataclass

import numpy as np

from controller.arrays import FloatArray, IntArray

from .._tolerances import GreyTolerances
from ..features.extract import ImageFeatures
from .model import ModelFeatures

MAX_FEATURE_COUNT = 60  # largest features of either side that are matched


@dataclass(frozen=True, eq=False, slots=True)
class Matches:
    """Pairs (n, 2) of numbers in picture and view, one to one, the nearest first."""

    lines: IntArray
    corners: IntArray
    circles: IntArray


def matches(
    image: ImageFeatures,
    model: ModelFeatures,
    turn_rad: float,
    shift_mm: FloatArray,
    *,
    foot_mm: tuple[float, float] = (0.0, 0.0),
    tol: GreyTolerances | None = None,
) -> Matches:
    """Return the pairs of features of a picture and a view placed on it; references.md P3.2.

    Parameters
    ----------
    image : features in the table plane
    model : the view that is placed on them
    turn_rad, shift_mm : as of a `Hypothesis`, on the table
    foot_mm : the point of the table plane below the camera
    tol : tolerances on features that match; None for the defaults
    """
    tol = tol or GreyTolerances()
    foot = np.asarray(foot_mm, dtype=np.float64)
    away = np.asarray(shift_mm, dtype=np.float64) - foot
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    R = np.array([[cos, -sin], [sin, cos]])

    def aligned(points: FloatArray, spread: FloatArray) -> FloatArray:
        return np.asarray(points @ R.T + spread[:, None] * away + foot)

    reach = 2 * tol.match_mm
    ends = aligned(
        model.lines_mm[:MAX_FEATURE_COUNT].reshape(-1, 2),
        model.line_spread[:MAX_FEATURE_COUNT].ravel(),
    )
    lines = nearest_pairs(_beside(image.lines_mm[:MAX_FEATURE_COUNT], ends.reshape(-1, 4)), reach)
    at = model.corners
    k = model.line_spread[at.lines[:MAX_FEATURE_COUNT, 0], at.ends[:MAX_FEATURE_COUNT, 0]]
    corners = nearest_pairs(
        _gaps(
            image.corners.positions[:MAX_FEATURE_COUNT],
            aligned(at.positions[:MAX_FEATURE_COUNT], k),
        ),
        2 * reach,
    )
    centres = aligned(
        model.circles_mm[:MAX_FEATURE_COUNT, :2], model.circle_spread[:MAX_FEATURE_COUNT]
    )
    circles = nearest_pairs(
        _gaps(image.circles.centres[:MAX_FEATURE_COUNT], centres)
        + np.abs(
            image.circles.radii[:MAX_FEATURE_COUNT, None]
            - model.circles_mm[None, :MAX_FEATURE_COUNT, 2]
        ),
        reach,
    )
    return Matches(lines, corners, circles)


def _gaps(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.hypot(a[:, :1] - b[:, 0], a[:, 1:] - b[:, 1]))


def _beside(seen: FloatArray, model: FloatArray) -> FloatArray:
    """Return the offset (n, m) of the picture's lines beside those of the view, inf if apart."""
    wx, wy = model[:, 2] - model[:, 0], model[:, 3] - model[:, 1]
    length = np.maximum(np.hypot(wx, wy), 1e-9)
    wx, wy = wx / length, wy / length
    along, beside = [], []
    for end in (0, 2):
        dx = seen[:, end : end + 1] - model[:, 0]
        dy = seen[:, end + 1 : end + 2] - model[:, 1]
        along.append(dx * wx + dy * wy)
        beside.append(np.abs(dx * wy - dy * wx))
    gap = np.maximum(*beside)
    overlap = np.minimum(np.maximum(*along), length) - np.maximum(np.minimum(*along), 0.0)
    own = np.hypot(seen[:, 2] - seen[:, 0], seen[:, 3] - seen[:, 1])
    gap[overlap < 0.5 * np.minimum(own[:, None], length)] = np.inf
    return np.asarray(gap)


def nearest_pairs(cost: FloatArray, most: float) -> IntArray:
    """Return pairs (row, column), each once, the nearest first."""
    row, column = np.nonzero(cost < most)
    order = np.argsort(cost[row, column], kind="stable")
    rows: set[int] = set()
    columns: set[int] = set()
    pairs = []
    for i, j in zip(row[order].tolist(), column[order].tolist(), strict=True):
        if i not in rows and j not in columns:
            rows.add(i)
            columns.add(j)
            pairs.append((i, j))
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)
