"""Panels of one object: grey edges, poses, other hypotheses."""

import cv2
import numpy as np
from scipy.spatial import cKDTree

from controller.arrays import FloatArray, Grey, Picture
from controller.imaging import Camera

from ..fitting import ModelEdgePoints
from ._facts import ObjectFacts
from .draw import (
    BLACK,
    GREEN,
    ORANGE,
    PAPER,
    PINK,
    RED,
    SKY,
    SOFT,
    WHITE,
    YELLOW,
    Colour,
    Sheet,
    tag,
    toned,
    write,
)

ELLIPSE_FACTOR = 50
RUNNER_UPS: tuple[Colour, ...] = (ORANGE, PINK, SKY)
ARROW_MM = 12.0
WIDER = 0.3  # largest margin on each side, as a share of the object's box
FILLED = 0.86  # share of a window's side filled by the object's box
INSIDE_PERCENTILES = (2.0, 98.0)


def window(picture: Grey, camera: Camera, facts: ObjectFacts, side: int) -> Sheet:
    """Return a square canvas with an object's box, as large as possible.

    Pixels that are not square are drawn in their proportions on the table. Where edges are
    predicted beyond the box, the window is wider, so that missing ones are visible as such.

    Parameters
    ----------
    picture : (h, w) the whole one
    camera : camera of the picture; gives the shape of a pixel
    facts : facts of the object
    side : length of the canvas's sides, in its pixels
    """
    low, high = np.array(facts.trace.region.box_px, dtype=np.float64).reshape(2, 2)
    if facts.shown >= 0:
        pixels = facts.trace.hypotheses[facts.shown].fit.edges.pixels
        most = WIDER * (high - low)
        low = np.clip(pixels.min(axis=0), low - most, low)
        high = np.clip(pixels.max(axis=0), high, high + most)
    (x0, y0), (x1, y1) = low.tolist(), high.tolist()
    aspect = float(camera.K[1, 1] / camera.K[0, 0])
    zoom = FILLED * side / max((x1 - x0) * aspect, y1 - y0, 1.0)
    scale = np.array([zoom * aspect, zoom])
    origin = np.array([(x0 + x1), (y0 + y1)]) / 2 - side / scale / 2
    # from the canvas to the picture, pixels' middles to middles
    back = np.array(
        [
            [1 / scale[0], 0.0, origin[0] - 0.5 + 0.5 / scale[0]],
            [0.0, 1 / scale[1], origin[1] - 0.5 + 0.5 / scale[1]],
        ]
    )
    # pixels are left as squares where there is room: a reader sees what the camera saw
    how = cv2.INTER_NEAREST if zoom >= 2 else cv2.INTER_LINEAR
    shown = cv2.warpAffine(
        toned(picture),
        back,
        (side, side),
        flags=how | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=BLACK,
    )
    return Sheet(np.ascontiguousarray(shown, dtype=np.uint8), origin, scale)


def draw_contour(sheet: Sheet, facts: ObjectFacts, width: int = 1) -> None:
    """Draw the observed outline and holes of an object.

    Parameters
    ----------
    sheet : over the object
    facts : facts of the object
    width : width of the lines, in pixels of the canvas
    """
    for loop in facts.trace.region.loops_px:
        sheet.line(loop, YELLOW, width, is_closed=True)


def on_picture(points_mm: FloatArray, camera: Camera) -> FloatArray:
    """Return the pixels (n, 2) of points (n, 2) of the table."""
    return camera.project(np.column_stack([points_mm, np.zeros(len(points_mm))]))


def draw_grey(sheet: Sheet, facts: ObjectFacts, camera: Camera) -> None:
    """Draw pieces of grey edges; nothing over a light table.

    Parameters
    ----------
    sheet : over the object
    facts : facts of the object
    camera : takes the table plane to the picture
    """
    e = facts.edgelets
    if e is None or len(e.points_mm) == 0:
        return
    along = np.column_stack([np.cos(e.directions_rad), np.sin(e.directions_rad)])
    half = 0.5 * e.lengths_mm[:, None] * along
    sheet.strokes(
        on_picture(e.points_mm - half, camera), on_picture(e.points_mm + half, camera), SKY, 2
    )


def draw_pose(sheet: Sheet, facts: ObjectFacts, camera: Camera, width: int = 2) -> None:
    """Draw the shown pose's predicted edges: found, missed, and those that need not show.

    Parameters
    ----------
    sheet : over the object
    facts : facts of the object; ``edges`` is what became of the predicted ones
    camera : takes the table plane to the picture
    width : width of what was found, in pixels of the canvas; what is missed is drawn wider by 1
    """
    for state in facts.edges:
        begin, end = _pieces(state.edges, camera)
        idle = ~state.found & state.need_not_show
        missed = ~state.found & ~state.need_not_show
        for these, colour, wide in (
            (idle, SOFT, 1),
            (state.found, GREEN, width),
            (missed, RED, width + 1),
        ):
            sheet.strokes(begin[these & state.which], end[these & state.which], colour, wide)


def _pieces(edges: ModelEdgePoints, camera: Camera) -> tuple[FloatArray, FloatArray]:
    """Return samples of edges as pieces that touch each other: begin and end (n, 2)."""
    along = np.column_stack([-edges.normals[:, 1], edges.normals[:, 0]])
    depth = (edges.points_mm - camera.position_mm) @ camera.T_world_cam[:3, 2]
    mm_per_px = depth * np.linalg.norm(along / np.diag(camera.K)[:2], axis=1)
    half = 0.5 * edges.step_mm / mm_per_px
    if len(half) >= 3:
        # an edge seen nearly end-on has its samples closer together
        near = np.asarray(cKDTree(edges.pixels).query(edges.pixels, k=3)[0])[:, 2]
        half = np.minimum(half, 0.75 * near + 0.5)
    return edges.pixels - half[:, None] * along, edges.pixels + half[:, None] * along


def draw_place(sheet: Sheet, facts: ObjectFacts, camera: Camera) -> None:
    """Draw the planar pose: position, direction, and the position's uncertainty, magnified.

    Nothing is drawn for an object that is none of the parts.

    Parameters
    ----------
    sheet : over the object
    facts : facts of the object
    camera : takes the table plane to the picture
    """
    s = facts.sighting
    at = np.array([s.x_mm, s.y_mm])
    if s.part is None:
        return
    if s.covariance is not None:
        values, vectors = np.linalg.eigh(s.covariance[:2, :2])
        angle = np.linspace(0, 2 * np.pi, 49)
        round_ = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        ellipse = at + ELLIPSE_FACTOR * (round_ * np.sqrt(np.maximum(values, 0))) @ vectors.T
        pixels = on_picture(ellipse, camera)
        sheet.line(pixels, BLACK, 3, is_closed=True)
        sheet.line(pixels, WHITE, 1, is_closed=True)
    tip = at + ARROW_MM * np.array([np.cos(s.theta_rad), np.sin(s.theta_rad)])
    ends = on_picture(np.stack([at, tip]), camera)
    for colour, width in ((BLACK, 4), (WHITE, 1)):
        a, b = np.round(sheet.at(ends)).astype(int).tolist()
        cv2.arrowedLine(sheet.canvas, a, b, colour, width, cv2.LINE_AA, 0, 0.2)
    sheet.dot(ends[0], WHITE, 2)


def draw_others(sheet: Sheet, facts: ObjectFacts, camera: Camera) -> None:
    """Draw the outlines of the rejected hypotheses, each with its score.

    Parameters
    ----------
    sheet : over the object
    facts : facts of the object; of ``others`` the best few are drawn
    camera : camera that took the picture
    """
    draw_contour(sheet, facts)
    others = list(zip(facts.others, RUNNER_UPS, strict=False))[::-1]  # the best on top
    for other, colour in others:
        begin, end = _pieces(other.edges, camera)
        on = other.edges.on_outline
        sheet.strokes(begin[on], end[on], colour, 1)
    y = sheet.canvas.shape[0] - 20
    for other, colour in others:
        tag(sheet.canvas, other.caption, (0, y), colour)
        y -= 20
    if not facts.others:
        tag(sheet.canvas, "nothing else was near", (0, y), WHITE)


def brightened_inside(picture: Grey, facts: ObjectFacts) -> Grey:
    """Return the picture with the levels inside an object stretched, to show a dark inside."""
    x0, y0, x1, y1 = facts.trace.region.box_px
    mask = cv2.erode(facts.trace.region.mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    inside = picture[y0:y1, x0:x1][mask]
    if inside.size == 0:
        return picture
    low, high = np.percentile(inside, INSIDE_PERCENTILES)
    spread = (picture.astype(np.float32) - low) * (255.0 / max(high - low, 4.0))
    return np.asarray(np.clip(spread, 0, 255).astype(np.uint8), dtype=np.uint8)


def titled(canvas: Picture, title: str) -> Picture:
    """Return a canvas with a line of words above it."""
    head = np.full((22, canvas.shape[1], 3), PAPER, dtype=np.uint8)
    write(head, title, (4, 15), WHITE)
    return np.vstack([head, canvas])
