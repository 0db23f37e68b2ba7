"""A grey picture's features in the plane: lines, corners, junctions, circles, and texture."""

from dataclasses import dataclass

import numpy as np

from controller.arrays import FloatArray, Grey, IntArray

from .._tolerances import GreyTolerances
from ._cells import cell_lines
from ._edges import ToPlane, edge_points
from ._lines import extended, merge_lines
from .arcs import Circles, find_circles
from .corners import Corners, Junctions, find_corners, find_junctions

EDGELET_MM = 1.5  # a piece of edge that counts as one: shorter than the smallest feature wanted
PLAIN = 0.4  # share of a plain edge's strength from which an edge counts as plain
FAINTEST = 0.15  # weight of the weakest edge


@dataclass(frozen=True, eq=False, slots=True)
class Edgelets:
    """Short pieces of edges, by which hypotheses are scored.

    Attributes
    ----------
    points_mm : (n, 2) their middles
    directions_rad : (n,) directions along the edge, 0..pi
    lengths_mm : (n,)
    strengths : (n,) 0..1, 1 for plain edges of this picture
    bends_rad : (n,) deviation of the edge's direction at its ends from that of its middle
    """

    points_mm: FloatArray
    directions_rad: FloatArray
    lengths_mm: FloatArray
    strengths: FloatArray
    bends_rad: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class ImageFeatures:
    """Features of a picture, in the table plane [mm], x right and y up as in the world.

    Attributes
    ----------
    lines_mm : (n, 4) x0 y0 x1 y1, longest first, the brighter side to the right of that way
    corners, junctions : corners and junctions of those lines
    circles : and arcs, best covered first
    edgelets : edgelets of all that is seen, the short and bent included
    pitch_mm : a mean pixel
    """

    lines_mm: FloatArray
    corners: Corners
    junctions: Junctions
    circles: Circles
    edgelets: Edgelets
    pitch_mm: float


def image_features(
    grey: Grey, to_plane: ToPlane, tol: GreyTolerances | None = None
) -> ImageFeatures:
    """Return the features of a grey picture; references.md P3.2.

    Parameters
    ----------
    grey : (height, width) uint8, an object's box or a whole picture
    to_plane : takes pixels (n, 2) of this picture, x before y, to the table plane (n, 2 or more)
    tol : thresholds of edges, lines and arcs; None for the defaults

    Raises
    ------
    ValueError : not a grey picture of uint8
    """
    tol = tol or GreyTolerances()
    edges = edge_points(grey, to_plane, tol)
    pitch = edges.pitch_mm
    pieces, piece_of = cell_lines(edges, tol)
    merged, line_of_piece = merge_lines(pieces, tol)
    points = edges.points_mm / pitch
    length = np.hypot(*(merged.ends[:, 1] - merged.ends[:, 0]).T)
    circles, circle_of = find_circles(
        points, edges.normals, pieces, piece_of, length[line_of_piece] < tol.arc_px, tol
    )
    line_of = np.where(piece_of >= 0, line_of_piece[piece_of], -1) if len(pieces.sums) else piece_of
    # a line most of whose points are of a circle is a chord of it
    on_line = np.bincount(line_of[line_of >= 0], minlength=len(merged.sums))
    on_both = np.bincount(line_of[(line_of >= 0) & (circle_of >= 0)], minlength=len(merged.sums))
    is_chord = on_both > 0.5 * on_line
    rest = np.flatnonzero(~is_chord)
    rest = rest[np.argsort(-length[rest], kind="stable")]
    loose = (line_of < 0) & (circle_of < 0)
    drawn_out = extended(merged, points[loose], edges.normals[loose], tol)
    ends = drawn_out[rest] * pitch
    normals = merged.normals[rest]
    way = ends[:, 1] - ends[:, 0]
    # so that the brighter side is to the right: normal = (way_y, -way_x)
    flip = way[:, 1] * normals[:, 0] - way[:, 0] * normals[:, 1] < 0
    ends[flip] = ends[flip][:, ::-1]
    segments = ends.reshape(-1, 4)
    lines = segments[length[rest] >= tol.line_px]
    corners = find_corners(lines, tol.corner_px * pitch, tol.corner_min_rad)
    junctions = find_junctions(lines, corners, 0.7 * tol.corner_px * pitch)
    round_mm = Circles(
        circles.centres * pitch,
        circles.radii * pitch,
        circles.cover,
        circles.starts_rad,
        circles.extents_rad,
        circles.bright_inside,
    )
    relative = np.clip(edges.strength / (PLAIN * edges.plain), FAINTEST, 1.0)
    edgelets = join_edgelets(
        [
            segment_edgelets(segments, _mean(relative, line_of, len(merged.sums))[rest]),
            arc_edgelets(round_mm, _mean(relative, circle_of, len(circles.radii))),
        ]
    )
    return ImageFeatures(lines, corners, junctions, round_mm, edgelets, pitch)


def _mean(values: FloatArray, of: IntArray, count: int) -> FloatArray:
    """Return the means of values by group; -1 is no group."""
    total = np.bincount(of + 1, weights=values, minlength=count + 1)[1:]
    return np.asarray(total / np.maximum(np.bincount(of + 1, minlength=count + 1)[1:], 1))


def segment_edgelets(segments: FloatArray, strengths: FloatArray) -> Edgelets:
    """Return straight lines (n, 4) cut into edgelets."""
    way = segments[:, 2:] - segments[:, :2]
    length = np.linalg.norm(way, axis=1)
    pieces = np.maximum(np.round(length / EDGELET_MM), 1).astype(np.int64)
    of = np.repeat(np.arange(len(segments)), pieces)
    within = np.arange(len(of)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    t = (within + 0.5) / pieces[of]
    points = segments[of, :2] + t[:, None] * way[of]
    direction = np.arctan2(way[:, 1], way[:, 0]) % np.pi
    return Edgelets(points, direction[of], (length / pieces)[of], strengths[of], np.zeros(len(of)))


def arc_edgelets(circles: Circles, strengths: FloatArray) -> Edgelets:
    """Return arcs [mm] cut into edgelets, shortened where a part of the arc was not seen."""
    length = circles.radii * circles.extents_rad
    pieces = np.maximum(np.round(length / EDGELET_MM), 4).astype(np.int64)
    of = np.repeat(np.arange(len(length)), pieces)
    within = np.arange(len(of)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    angle = circles.starts_rad[of] + circles.extents_rad[of] * (within + 0.5) / pieces[of]
    ray = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = circles.centres[of] + circles.radii[of, None] * ray
    seen = np.minimum(circles.cover * 2 * np.pi / circles.extents_rad, 1.0)
    return Edgelets(
        points,
        (angle + np.pi / 2) % np.pi,
        (length / pieces * seen)[of],
        strengths[of],
        (circles.extents_rad / pieces / 2)[of],
    )


def join_edgelets(parts: list[Edgelets]) -> Edgelets:
    """Return edgelets of several kinds as one."""
    return Edgelets(
        np.concatenate([p.points_mm for p in parts]),
        np.concatenate([p.directions_rad for p in parts]),
        np.concatenate([p.lengths_mm for p in parts]),
        np.concatenate([p.strengths for p in parts]),
        np.concatenate([p.bends_rad for p in parts]),
    )
