"""Cut-outs of a characteristic's edge, with the rays, the points and the fitted shape."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from controller.cell.journal.rows import CharacteristicFields, LookFields

from ...run import Box, Points, ViewReport
from ..pictures import Pictures, Shot, bounds, outline_path, window_round

MARGIN: Final = 0.35
MIN_PX: Final = 60
RAY_PX: Final = 5.0  # length of the ray drawn to either side of an edge point
# Length of a step, in median steps, from which it leads from one fitted shape to the next.
WIDE_STEP: Final = 5.0
AROUND_PX: Final = 8
# Largest distance of a drawn shape from the fitted one, a tenth of its stroke.
SHAPE_OFF_PX: Final = 0.05
BACKLIT: Final = "backlit"


@dataclass(frozen=True, slots=True)
class LookPanel:
    """One look at a characteristic; all paths are SVG paths in picture coordinates.

    Attributes
    ----------
    rays : lines across the edge through the points found
    used, refused : dots at the points that count, crosses at the others
    shape : fitted shape
    nominal : outline of the part predicted from the CAD; may be empty
    bar_px : length of a millimetre in the picture; None if unknown
    """

    c: CharacteristicFields
    look: LookFields
    lamp: str
    shot: Shot
    rays: str
    used: str
    refused: str
    shape: str
    nominal: str
    used_count: int
    point_count: int
    bar_px: float | None


def look_panel(
    c: CharacteristicFields,
    look: LookFields,
    views: Mapping[str, ViewReport],
    pictures: Pictures,
    lamp: str,
) -> LookPanel | None:
    """Return a look with its cut-out; None if it has nothing to draw.

    Parameters
    ----------
    c, look : characteristic, and the look at it
    views : views by id
    pictures : pictures of the part
    lamp : common name of the lamp
    """
    view = views.get(look.view)
    name = picture_of(view, look.lamp) if view else None
    around = bounds((*look.shape_px, *look.points_px))
    if view is None or name is None or around is None:
        return None
    size = pictures.size_px(name)
    window = window_round([around], size, MARGIN, MIN_PX) if size else around
    accepted = look.accepted or (1,) * len(look.points_px)
    pairs = list(zip(look.points_px, accepted, strict=False))
    return LookPanel(
        c,
        look,
        lamp,
        pictures.crop(name, window),
        _rays(look.points_px, look.shape_px),
        _dots([p for p, is_used in pairs if is_used]),
        _crosses([p for p, is_used in pairs if not is_used], 2.2),
        _path(look.shape_px, is_closed=c.rim_radius_mm is not None),
        outline_path(_near(view.outline_px, window)),
        sum(1 for a in accepted if a),
        len(look.points_px),
        _mm_px(c, look.shape_px),
    )


def picture_of(view: ViewReport, lamp: str) -> str | None:
    """Return a view's picture under a lamp; ``backlit`` for that before the backlight panel."""
    if lamp in view.pictures:
        return view.pictures[lamp]
    for name, file in view.pictures.items():
        if name.endswith("backlight") if lamp == BACKLIT else name.endswith(f"_{lamp}"):
            return file
    return None


def _mm_px(c: CharacteristicFields, shape: Points) -> float | None:
    """Return the pixels per millimetre, from the size of the rim."""
    if c.rim_radius_mm is None or len(shape) < 8:
        return None
    points = np.array(shape)
    extent = float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())
    return extent / c.rim_radius_mm


def _rays(points: Points, shape: Points) -> str:
    if len(shape) < 3 or not points:
        return ""
    fitted, found = np.array(shape), np.array(points)
    tangent = np.roll(fitted, -1, axis=0) - np.roll(fitted, 1, axis=0)
    tangent[0], tangent[-1] = fitted[1] - fitted[0], fitted[-1] - fitted[-2]
    nearest = np.argmin(np.linalg.norm(found[:, None] - fitted[None], axis=2), axis=1)
    along = tangent[nearest]
    length = np.linalg.norm(along, axis=1)
    keep = length > 0
    across = np.column_stack([-along[:, 1], along[:, 0]])[keep] / length[keep, None] * RAY_PX
    centre = fitted[nearest][keep] + 0.5
    return "".join(
        f"M{a:.1f} {b:.1f}l{2 * p:.1f} {2 * q:.1f}"
        for (a, b), (p, q) in zip(centre - across, across, strict=True)
    )


def _near(points: Points, window: Box) -> Points:
    """Return the points in a window and slightly beyond it."""
    x0, y0, x1, y1 = window
    return tuple(
        (x, y)
        for x, y in points
        if x0 - AROUND_PX < x < x1 + AROUND_PX and y0 - AROUND_PX < y < y1 + AROUND_PX
    )


def _dots(points: list[tuple[float, float]]) -> str:
    return "".join(f"M{x + 0.5:.1f} {y + 0.5:.1f}h.1" for x, y in points)


def _crosses(points: list[tuple[float, float]], half: float) -> str:
    return "".join(
        f"M{x + 0.5 - half:.1f} {y + 0.5 - half:.1f}l{2 * half:g} {2 * half:g}"
        f"m0 {-2 * half:g}l{-2 * half:g} {2 * half:g}"
        for x, y in points
    )


def _path(points: Points, *, is_closed: bool) -> str:
    """Return the paths of the fitted shapes; a wide step starts the next shape."""
    if not points:
        return ""
    steps = np.linalg.norm(np.diff(np.array(points), axis=0), axis=1)
    if len(points) == 4 and not is_closed:  # two lines, each given by its ends
        breaks = [2]
    elif len(points) > 5:
        breaks = [int(i) + 1 for i in np.flatnonzero(steps > WIDE_STEP * np.median(steps))]
    else:
        breaks = []
    path = ""
    for start, end in zip([0, *breaks], [*breaks, len(points)], strict=True):
        shape = np.array(points[start:end], dtype=np.float32)
        bends = cv2.approxPolyDP(shape, SHAPE_OFF_PX, closed=False).reshape(-1, 2)
        line = "L".join(f"{x + 0.5:.2f} {y + 0.5:.2f}" for x, y in bends)
        path += f"M{line}{'Z' if is_closed and not breaks else ''}"
    return path
