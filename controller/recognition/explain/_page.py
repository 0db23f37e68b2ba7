"""Page of an explanation: the whole table with all findings, then a row of details an object."""

from collections.abc import Sequence

import cv2
import numpy as np

from controller.arrays import Grey, Picture
from controller.imaging import Camera
from messages import key

from ..identification.sighting import Recognition
from ..library import Library
from ._facts import ObjectFacts, degrees_text
from ._panels import (
    ELLIPSE_FACTOR,
    brightened_inside,
    draw_contour,
    draw_grey,
    draw_others,
    draw_outline,
    draw_place,
    draw_pose,
    titled,
    window,
)
from ._tables import turn_text
from .draw import (
    GREEN,
    LINE_PX,
    ORANGE,
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
    write_lines,
)

SHOWN_PX = 1024  # height to which a small picture is enlarged
SIDE_PX = 400  # width of the column beside it
GAP_PX = 8

LEGEND: tuple[tuple[str, Colour, str], ...] = (
    ("line", YELLOW, "observed outline"),
    ("line", SKY, "grey edge"),
    ("dot", ORANGE, "corner that juts out"),
    ("square", GREEN, "notched corner"),
    ("line", GREEN, "predicted edge, found"),
    ("line", RED, "predicted edge, missed"),
    ("line", SOFT, "predicted edge that need not show"),
    ("line", WHITE, f"place, x {ELLIPSE_FACTOR}: ellipse of 1 sigma; arrow: turn"),
)


def draw_page(
    picture: Grey,
    camera: Camera,
    library: Library,
    seen: Recognition,
    facts: Sequence[ObjectFacts],
    title: str,
) -> Picture:
    """Return the page, (h, w, 3) blue, green, red.

    Parameters
    ----------
    picture : (h, w) as it was recognised
    camera : camera that took it
    library : library used for the recognition; gives the parts' names
    seen : the result
    facts : `object_facts` of it
    title : title of the page
    """
    names = tuple(entry.name for entry in library.entries)
    main = _overview(picture, camera, facts)
    column = _column(main.shape[0], seen, facts, title)
    height = max(main.shape[0], column.shape[0])
    rows = [np.hstack([_padded(main, height), _padded(column, height)])]
    width = rows[0].shape[1]
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
        x0, y0, x1, _ = f.trace.region.box_px
        corner = np.array([x0, y0], dtype=np.float64)
        name = f"{s.part}, pose {s.pose_index}" if s.part else key("unknown object")
        name += f"  {s.score:.3f}"
        if f.trace.region.touches_edge:
            name = "cut by the edge"
            box = np.array([[x0, y0], [x1, y0], [x1, f.trace.region.box_px[3]],
                            [x0, f.trace.region.box_px[3]]], dtype=np.float64)  # fmt: skip
            sheet.line(box, RED, 2, is_closed=True)
        colour = WHITE if s.part else RED
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


def _column(height: int, seen: Recognition, facts: Sequence[ObjectFacts], title: str) -> Picture:
    """Return the column of text beside the picture."""
    s = seen.segmentation
    lines: list[tuple[str, Colour]] = []
    if title:
        lines.append((title, YELLOW))
    humps = "two humps" if s.is_bimodal else "one hump"
    lines.append((f"{s.lighting}, histogram: {humps}", WHITE))
    levels = f"table {s.levels.ground:.0f}"
    if s.lighting == "backlit":  # things under lamps are found by their borders
        levels += f", things {s.levels.object:.0f}, threshold {s.levels.threshold:.0f}"
    lines.append((f"{levels} of 255", SOFT))
    lines += [(f"remark: {remark}", ORANGE) for remark in s.remarks]
    if not facts:
        lines.append(("nothing on the table", WHITE))
    about: list[tuple[str, Colour]] = []
    for f in facts:
        about += [("", WHITE), *_told(f)]
    tall = 4000
    canvas = np.full((tall, SIDE_PX, 3), PAPER, dtype=np.uint8)
    wide = SIDE_PX - 24
    y = write_lines(canvas, lines, (12, 24), wide)
    y = _legend(canvas, (12, y + LINE_PX))
    y = write_lines(canvas, about, (12, y), wide)
    return canvas[: max(height, min(y, tall))]


def _told(f: ObjectFacts) -> list[tuple[str, Colour]]:
    s = f.sighting
    if s.part is None:
        return [
            (f"#{f.number} unknown object, score {s.score:.3f}", RED),
            (f"x {s.x_mm:.1f}, y {s.y_mm:.1f} mm", SOFT),
            (s.reason, WHITE),
        ]
    lines = [
        (f"#{f.number} {s.part}, pose {s.pose_index}, score {s.score:.3f}", WHITE),
        (f"x {s.x_mm:.2f}, y {s.y_mm:.2f} mm, +- {s.sigma_mm:.3f} mm", SOFT),
        (f"turn {turn_text(f)}", SOFT),
    ]
    if s.ambiguous_with:
        also = "; ".join(
            f"{a.part}, pose {a.pose_index}, {degrees_text(a.theta_rad, 1)} deg"
            for a in s.ambiguous_with
        )
        lines.append((f"could also be: {also}", ORANGE))
    return lines


def _legend(canvas: Picture, at: tuple[int, int]) -> int:
    x, y = at
    sheet = Sheet(canvas, np.zeros(2), np.ones(2))
    for kind, colour, words in LEGEND:
        middle = np.array([x + 12.0, y - 4.0])
        if kind == "line":
            polyline(canvas, middle + np.array([[-12.0, 0.0], [12.0, 0.0]]), colour, 2)
        elif kind == "dot":
            sheet.dot(middle, colour)
        else:
            sheet.square(middle, colour)
        write(canvas, words, (x + 36, y), SOFT)
        y += LINE_PX
    return y


def _head(f: ObjectFacts, width: int) -> Picture:
    head = np.full((30, width, 3), (70, 62, 56), dtype=np.uint8)
    s = f.sighting
    name = f"{s.part}, stable pose {s.pose_index}" if s.part else f"unknown: {s.reason}"
    write(head, f"#{f.number}  {name}   score {s.score:.3f}", (8, 20), WHITE, 0.55)
    return head


def _details(
    picture: Grey, camera: Camera, f: ObjectFacts, names: tuple[str, ...], width: int
) -> Picture:
    count = 3 if f.edgelets is None else 4
    side = (width - (count - 1) * GAP_PX) // count
    panels = []
    sheet = window(picture, camera, f, side)
    draw_outline(sheet, f, camera)
    panels.append(titled(sheet.canvas, "outline and its corners"))

    if f.edgelets is not None:
        sheet = window(picture, camera, f, side)
        draw_grey(sheet, f, camera)
        panels.append(titled(sheet.canvas, "grey edges"))

    is_dark = f.edgelets is None
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
    height = max(len(panel) for panel in panels)
    row = np.full((height + GAP_PX, width, 3), PAPER, dtype=np.uint8)
    x = 0
    for panel in panels:
        row[: len(panel), x : x + panel.shape[1]] = panel
        x += panel.shape[1] + GAP_PX
    return row


def _padded(canvas: Picture, height: int) -> Picture:
    return np.asarray(
        cv2.copyMakeBorder(
            canvas, 0, height - canvas.shape[0], 0, 0, cv2.BORDER_CONSTANT, value=PAPER
        ),
        np.uint8,
    )
