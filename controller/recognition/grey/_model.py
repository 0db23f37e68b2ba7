"""A view's edgelets from the CAD line drawing, as flat arrays for thousands of views.

Two images of a part at two places of the table differ by more than a shift: higher points move
further. Each edgelet therefore holds its own rate, and those of one view, made below the camera,
are right at every place apart from hidden ones.
"""

from typing import Final

import numpy as np

from controller.arrays import Float32Array, FloatArray
from controller.cad import DrawnEdge, LineView

from ._edgelets import EDGELET_MM

MAX_EDGELETS: Final = 240  # edgelets of a view; more add nothing
OUTLINE_WEIGHT: Final = 1.5  # an outline surely shows before a table of another grey
SMOOTH_WEIGHT: Final = 0.3  # weight of a smooth join, which is visible under some lamps only
SHORTEST: Final = 0.3  # shortest run of a drawing that is an edgelet, in edgelets


def view_edgelets(
    view: LineView,
    T_world_part: FloatArray | None = None,
    eye_height_mm: float | None = None,
    *,
    v_down: bool = True,
) -> Float32Array:
    """Return edgelets (k, 5) of a line drawing in the table plane, up to `MAX_EDGELETS`.

    Parameters
    ----------
    view : in mm on the table, from a camera straight above the part's place
    T_world_part, eye_height_mm : (4, 4) pose it was drawn in, and the eye's height above the table;
        without them all of the view moves as one
    v_down : its second coordinate runs downwards, as a camera's does; False for `line_view`

    Returns
    -------
    x, y [mm], shift per unit shift of the part (1 on the table), direction (0..pi) and weight of
    each, evenly along the runs; any first part of the list is spread over the part
    """
    runs = [_run(edge, T_world_part, eye_height_mm, v_down) for edge in view.edges]
    total = sum(float(np.hypot(*np.diff(p, axis=0).T).sum()) for p, _, _ in runs)
    step = max(EDGELET_MM, total / MAX_EDGELETS)
    rows = []
    for points, spread, weight in runs:
        way = np.diff(points, axis=0)
        s = np.r_[0.0, np.cumsum(np.hypot(way[:, 0], way[:, 1]))]
        if s[-1] < SHORTEST * step:
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
    # the golden section spreads any first part of the list over the part: bounds close early
    table = table[np.argsort((np.arange(len(table)) * 0.6180339887) % 1.0, kind="stable")]
    return table[:MAX_EDGELETS].astype(np.float32)


def _run(
    edge: DrawnEdge,
    T_world_part: FloatArray | None,
    eye_height_mm: float | None,
    v_down: bool,
) -> tuple[FloatArray, FloatArray, float]:
    """Return a drawn edge's points, the rates at which they move, and its weight."""
    points = np.asarray(edge.points, dtype=np.float64) * np.array([1.0, -1.0 if v_down else 1.0])
    spread = np.ones(len(points))
    if T_world_part is not None and eye_height_mm is not None:
        height = edge.points_mm @ T_world_part[2, :3] + T_world_part[2, 3]
        spread = eye_height_mm / (eye_height_mm - height)
    weight = SMOOTH_WEIGHT if edge.kind == "smooth" else 1.0
    return points, spread, OUTLINE_WEIGHT if edge.on_outline else weight
