"""A model view's features from the CAD line drawing, as flat arrays for thousands of views.

Two images of a part at two places of the table differ by more than a shift: higher points move
further. Each end of a line therefore holds its own rate, and the features of one view, made below
the camera, are right at every place apart from hidden ones.
"""

from dataclasses import dataclass

import numpy as np
import shapely

from controller.arrays import Float32Array, FloatArray, IntArray
from controller.cad import DrawnEdge, LineView

from .._tolerances import GreyTolerances
from ..features.corners import Corners, find_corners
from ..features.extract import EDGELET_MM

BEND_MM = 0.15  # a drawn edge that stays this near to a chord is straight in a picture
ROUND_MM = 0.12  # misfit up to which a drawn edge is a circle, as tessellated rims are
MEET_MM = 0.6  # distance of edges that meet in one corner, chamfers between them left out
MAX_EDGELETS = 240  # edgelets of a view; more add nothing
MIN_LINE_MM = 2.5
MIN_ARC_RAD = 1.0
OUTLINE_WEIGHT = 1.5  # weight of an outline, which shows surely before a table of another grey


@dataclass(frozen=True, eq=False, slots=True)
class ModelFeatures:
    """Features that a part would show, in mm on the table; the origin is that of its shifts.

    Attributes
    ----------
    lines_mm : (n, 4) x0 y0 x1 y1
    line_spread : (n, 2) shift of each end per unit shift of the part: 1 on the table
    line_weights : (n,)
    corners : corners of those lines
    circles_mm : (m, 3) centre and radius
    circle_spread : (m,) as of lines
    circle_extents_rad, circle_weights : (m,)
    edgelets : (k, 5) x, y, spread, direction (0..pi) and weight, longest pieces evenly
    """

    lines_mm: FloatArray
    line_spread: FloatArray
    line_weights: FloatArray
    corners: Corners
    circles_mm: FloatArray
    circle_spread: FloatArray
    circle_extents_rad: FloatArray
    circle_weights: FloatArray
    edgelets: Float32Array


def model_features(
    view: LineView,
    T_world_part: FloatArray | None = None,
    eye_height_mm: float | None = None,
    *,
    v_down: bool = True,
    tol: GreyTolerances | None = None,
) -> ModelFeatures:
    """Return the features of a line drawing in the table plane.

    Parameters
    ----------
    view : in mm on the table, from a camera straight above the part's place
    T_world_part, eye_height_mm : (4, 4) pose it was drawn in, and the eye's height above the table;
        without them all of the view moves as one
    v_down : its second coordinate runs downwards, as a camera's does; False for `line_view`
    tol : thresholds of lines and arcs; None for the defaults
    """
    tol = tol or GreyTolerances()
    runs = [_run(edge, T_world_part, eye_height_mm, v_down, tol) for edge in view.edges]
    circles = _circles(runs)
    lines: list[tuple[float, ...]] = []
    for points, spread, weight, arc in runs:
        if arc is not None:
            continue
        keep = _bends(points)
        for a, b in zip(keep[:-1].tolist(), keep[1:].tolist(), strict=True):
            lines.append((*points[a], *points[b], spread[a], spread[b], weight))
    table = np.array(lines, dtype=np.float64).reshape(-1, 7)
    length = np.hypot(table[:, 2] - table[:, 0], table[:, 3] - table[:, 1])
    table = table[length >= MIN_LINE_MM]
    length = length[length >= MIN_LINE_MM]
    table = table[np.argsort(-length, kind="stable")]
    return ModelFeatures(
        table[:, :4],
        table[:, 4:6],
        table[:, 6],
        find_corners(table[:, :4], MEET_MM, tol.corner_min_rad),
        circles[:, :3],
        circles[:, 3],
        circles[:, 4],
        circles[:, 5],
        _edgelets(runs),
    )


Run = tuple[FloatArray, FloatArray, float, tuple[float, float, float, float] | None]


def _run(
    edge: DrawnEdge,
    T_world_part: FloatArray | None,
    eye_height_mm: float | None,
    v_down: bool,
    tol: GreyTolerances,
) -> Run:
    """Return a drawn edge's points, their spread, its weight, and its circle and turn or None."""
    points = np.asarray(edge.points, dtype=np.float64) * np.array([1.0, -1.0 if v_down else 1.0])
    spread = np.ones(len(points))
    if T_world_part is not None and eye_height_mm is not None:
        height = edge.points_mm @ T_world_part[2, :3] + T_world_part[2, 3]
        spread = eye_height_mm / (eye_height_mm - height)
    weight = tol.smooth_weight if edge.kind == "smooth" else 1.0
    if edge.on_outline:
        weight = OUTLINE_WEIGHT
    return points, spread, weight, _round(points)


def _round(points: FloatArray) -> tuple[float, float, float, float] | None:
    """Return centre, radius and turn of points on a circle, None of others."""
    if len(points) < 4:
        return None
    middle = points.mean(axis=0)
    p = points - middle
    a = np.column_stack([2 * p, np.ones(len(p))])
    solution, *_ = np.linalg.lstsq(a, (p * p).sum(axis=1), rcond=None)
    radius = float(np.sqrt(max(solution[2] + solution[:2] @ solution[:2], 0.0)))
    ray = p - solution[:2]
    if not 0.4 < radius < 400 or np.abs(np.linalg.norm(ray, axis=1) - radius).max() > ROUND_MM:
        return None
    angle = np.unwrap(np.arctan2(ray[:, 1], ray[:, 0]))
    turn = float(abs(angle[-1] - angle[0]))
    if turn < 0.3 or radius * (1 - np.cos(turn / 2)) < BEND_MM:
        return None
    return float(middle[0] + solution[0]), float(middle[1] + solution[1]), radius, turn


def _circles(runs: list[Run]) -> FloatArray:
    """Return (m, 6) centre, radius, spread, turn and weight: a rim in pieces is one circle."""
    found: list[list[float]] = []
    for _, spread, weight, arc in runs:
        if arc is None:
            continue
        x, y, radius, turn = arc
        for other in found:
            if max(abs(other[0] - x), abs(other[1] - y), abs(other[2] - radius)) < 2 * ROUND_MM:
                other[4] = min(other[4] + turn, 2 * np.pi)
                other[5] = max(other[5], weight)
                break
        else:
            found.append([x, y, radius, float(spread.mean()), turn, weight])
    table = np.array(found, dtype=np.float64).reshape(-1, 6)
    table = table[table[:, 4] >= MIN_ARC_RAD]
    return table[np.argsort(-table[:, 4] * table[:, 2], kind="stable")]


def _bends(points: FloatArray) -> IntArray:
    """Return the indices of a run's corners."""
    if len(points) == 2:
        return np.array([0, 1])
    line = shapely.simplify(shapely.LineString(points), BEND_MM, preserve_topology=False)
    kept = shapely.get_coordinates(line)
    at = [0]
    for corner in kept[1:]:
        rest = np.flatnonzero((points[at[-1] + 1 :] == corner).all(axis=1))
        at.append(at[-1] + 1 + int(rest[0]))
    return np.array(at)


def _edgelets(runs: list[Run]) -> Float32Array:
    """Return up to `MAX_EDGELETS` pieces of the runs, evenly along them."""
    total = sum(float(np.hypot(*np.diff(p, axis=0).T).sum()) for p, _, _, _ in runs)
    step = max(EDGELET_MM, total / MAX_EDGELETS)
    rows = []
    for points, spread, weight, _ in runs:
        way = np.diff(points, axis=0)
        length = np.hypot(way[:, 0], way[:, 1])
        s = np.r_[0.0, np.cumsum(length)]
        if s[-1] < 0.3 * step:
            continue
        pieces = max(round(float(s[-1]) / step), 1)
        at = (np.arange(pieces) + 0.5) * s[-1] / pieces
        x, y, k = (np.interp(at, s, c) for c in (points[:, 0], points[:, 1], spread))
        # the direction of the chord over the piece, not of the one facet at its middle
        low, high = np.maximum(at - step / 2, 0), np.minimum(at + step / 2, s[-1])
        dx = np.interp(high, s, points[:, 0]) - np.interp(low, s, points[:, 0])
        dy = np.interp(high, s, points[:, 1]) - np.interp(low, s, points[:, 1])
        share = np.full(pieces, weight * s[-1] / pieces)
        rows.append(np.stack([x, y, k, np.arctan2(dy, dx) % np.pi, share], axis=1))
    if not rows:
        return np.zeros((0, 5), dtype=np.float32)
    table = np.concatenate(rows)
    # any first part of the list is spread over the part: bounds close early
    table = table[np.argsort((np.arange(len(table)) * 0.6180339887) % 1.0, kind="stable")]
    return table[:MAX_EDGELETS].astype(np.float32)
