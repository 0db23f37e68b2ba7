"""Page of an explanation: the whole table with all findings, then a row of details an object."""

from collections.abc import Sequence

import numpy as np

from controller.arrays import Grey, Picture
from controller.imaging import Camera
from messages import key

from ..library import Library
from ._facts import ObjectFacts, degrees_text
from ._panels import (
    ELLIPSE_FACTOR,
    brightened_inside,
    draw_contour,
    draw_grey,
    draw_others,
    draw_place,
    draw_pose,
    titled,
    window,
)
from .draw import (
    GREEN,
    LINE_PX,
    PAPER,
    RED,
    SKY,
    SOFT,
    WHITE,
    YELLOW,
    Colour,
    Sheet,
    polyline,
    toned,
    write,
)

SHOWN_PX = 1024  # height to which a small picture is enlarged
GAP_PX = 8
LEGEND_PX = 330  # width of an entry of the legend

LEGEND: tuple[tuple[Colour, str], ...] = (
    (YELLOW, "observed outline"),
    (SKY, "grey edge"),
    (GREEN, "predicted edge, found"),
    (RED, "predicted edge, missed"),
    (SOFT, "predicted edge that need not show"),
    (WHITE, f"place: sigma x {ELLIPSE_FACTOR}; arrow: turn"),
)


def draw_page(
    picture: Grey, camera: Camera, library: Library, facts: Sequence[ObjectFacts], title: str
) -> Picture:
    """Return the page, (h, w, 3) blue, green, red.

    Parameters
    ----------
    picture : (h, w) as it was recognised
    camera : camera that took it
    library : library used for the recognition; gives the parts' names
    facts : `object_facts` of what was recognised
    title : title of the page
    """
    names = tuple(entry.name for entry in library.entries)
    rows = [_overview(picture, camera, facts)]
    width = rows[0].shape[1]
    rows.append(_legend(title, width))
    for f in facts:
        rows += [_head(f, width), _details(picture, camera, f, names, width)]
    return np.vstack(rows)


def _overview(picture: Grey, camera: Camera, facts: Sequence[ObjectFacts]) -> Picture:
    """Return the whole picture with all findings, enlarged by whole numbers."""
    across, down = _enlarged(picture.shape[0], float(camera.K[1, 1] / camera.K[0, 0]))
    shown = np.repeat(np.repeat(toned(picture), down, axis=0), across, axis=1)
    sheet = Sheet(np.ascontiguousarray(shown), np.zeros(2), np.array([across, down], dtype=float))
    for f in facts:
        draw_contour(sheet, f, 3)
        if f.chosen >= 0:
            draw_pose(sheet, f, camera, 1)
        draw_place(sheet, f, camera)
    for f in facts:
        s = f.sighting
        x0, y0, x1, y1 = f.trace.region.box_px
        name = f"{s.part}, pose {s.pose_index}" if s.part else key("unknown object")
        name += f"  {s.score:.3f}"
        if f.trace.region.touches_edge:
            name = "cut by the edge"
            box = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], dtype=np.float64)
            sheet.line(box, RED, 2, is_closed=True)
        colour = WHITE if s.part else RED
        corner = np.array([x0, y0], dtype=np.float64)
        sheet.words(f"#{f.number} {name}", corner, colour, (0, -22))
    return sheet.canvas


def _enlarged(height: int, aspect: float) -> tuple[int, int]:
    """Return the whole factors by which a picture is enlarged, across and down.

    Parameters
    ----------
    aspect : width of a pixel over its height
    """
    wanted = SHOWN_PX / height
    # of sizes about right, the one that draws pixels as they are on the table
    tried = range(max(1, round(0.75 * wanted)), max(1, round(1.25 * wanted)) + 1)
    down = min(tried, key=lambda n: (_off(n, aspect) > 0.02, abs(n - wanted)))
    return max(1, round(down * aspect)), down


def _off(down: int, aspect: float) -> float:
    return abs(max(1, round(down * aspect)) / down / aspect - 1.0)


def _legend(title: str, width: int) -> Picture:
    """Return the title, and below it what the colours mean."""
    in_row = max(1, width // LEGEND_PX)
    height = LINE_PX * (2 - (-len(LEGEND) // in_row))
    canvas = np.full((height, width, 3), PAPER, dtype=np.uint8)
    write(canvas, title, (12, LINE_PX - 4), YELLOW)
    for k, (colour, words) in enumerate(LEGEND):
        row, column = divmod(k, in_row)
        x, y = 12 + column * LEGEND_PX, (row + 2) * LINE_PX - 4
        polyline(canvas, np.array([[x, y - 4.0], [x + 24.0, y - 4.0]]), colour, 2)
        write(canvas, words, (x + 36, y), SOFT)
    return canvas


def _head(f: ObjectFacts, width: int) -> Picture:
    head = np.full((30, width, 3), (70, 62, 56), dtype=np.uint8)
    s = f.sighting
    name = f"{s.part}, stable pose {s.pose_index}" if s.part else f"unknown: {s.reason}"
    write(head, f"#{f.number}  {name}   score {s.score:.3f}", (8, 20), WHITE, 0.55)
    return head


def _details(
    picture: Grey, camera: Camera, f: ObjectFacts, names: tuple[str, ...], width: int
) -> Picture:
    is_dark = f.edgelets is None
    count = 2 if is_dark else 3
    side = (width - (count - 1) * GAP_PX) // count
    panels = []
    if not is_dark:
        sheet = window(picture, camera, f, side)
        draw_grey(sheet, f, camera)
        panels.append(titled(sheet.canvas, "grey edges"))

    sheet = window(brightened_inside(picture, f) if is_dark else picture, camera, f, side)
    what = "no hypothesis came to be fitted"
    if f.shown >= 0:
        h = f.trace.hypotheses[f.shown]
        draw_pose(sheet, f, camera)
        draw_place(sheet, f, camera)
        what = "chosen pose" if f.chosen >= 0 else "nearest, not taken"
        what += f": {names[h.part]}, pose {h.pose}, {degrees_text(h.theta_rad, 1)} deg"
    panels.append(titled(sheet.canvas, what + (", brightened" if is_dark else "")))

    sheet = window(picture, camera, f, side)
    draw_others(sheet, f, camera)
    panels.append(titled(sheet.canvas, "other hypotheses, and their evidence"))
    return _row(panels, width)


def _row(panels: Sequence[Picture], width: int) -> Picture:
    row = np.full((len(panels[0]) + GAP_PX, width, 3), PAPER, dtype=np.uint8)
    x = 0
    for panel in panels:
        row[: len(panel), x : x + panel.shape[1]] = panel
        x += panel.shape[1] + GAP_PX
    return row
