"""Keys of features that do not change with place and turn.

Four kinds of key: a line between two corners (references.md P3.2), a corner with its two lines, two
circles, a circle and a line; and for views with little of these, a line alone. Keys are scaled so
that a tolerance is 1.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controller.arrays import FloatArray, IntArray

from .._tolerances import GreyTolerances
from ..features.corners import Corners

KINDS = ("edge", "corner", "pair", "flank", "line", "circle")
MAX_LINES = 40  # longest lines of a picture or view that are used
MAX_CIRCLES = 16
MAX_CORNERS = 60
ALONE_MM, MAX_ALONE = 6.0, 14  # lines that may fix a pose by their length alone
MIN_APART_MM = 4.0  # distance of two points that give a direction: 0.3 mm on it is 4 deg


@dataclass(frozen=True, eq=False, slots=True)
class Frames:
    """Features as places with a direction.

    Attributes
    ----------
    keys : (n, d) invariants, in tolerances
    points : (n, 2) positions of the points
    spread : (n,) rate at which that changes as the part moves
    turns_rad : (n,) directions
    weights : (n,) weight by distinctiveness
    model : (n,) model of which view
    """

    keys: NDArray[np.floating]
    points: NDArray[np.floating]
    spread: NDArray[np.floating]
    turns_rad: NDArray[np.floating]
    weights: NDArray[np.floating]
    model: NDArray[np.signedinteger]


def frames_of(
    lines: FloatArray,
    spread: FloatArray,
    line_weights: FloatArray,
    corners: Corners,
    circles: FloatArray,
    circle_spread: FloatArray,
    circle_weights: FloatArray,
    tol: GreyTolerances,
    *,
    both_directions: bool,
) -> dict[str, Frames]:
    """Return the keyed features of one view or picture, by kind.

    Parameters
    ----------
    lines : (n, 4) x0 y0 x1 y1 [mm], longest first
    spread : (n, 2) shift of each end per unit shift of the part
    line_weights : (n,)
    corners : corners of those lines
    circles : (m, 3) centre and radius [mm]
    circle_spread, circle_weights : (m,)
    tol : the unit of the keys
    both_directions : True to list features without a direction for both; one side of a comparison
        is enough
    """
    n = min(len(lines), MAX_LINES)
    lines, spread, line_weights = lines[:n], spread[:n], line_weights[:n]
    way = lines[:, 2:] - lines[:, :2]
    length = np.hypot(way[:, 0], way[:, 1])
    turn = np.arctan2(way[:, 1], way[:, 0])
    size = _scaled(length, tol.length_mm, tol.length_ratio)
    middle, k = (lines[:, :2] + lines[:, 2:]) / 2, spread.mean(axis=1) if n else np.zeros(0)
    c = min(len(circles), MAX_CIRCLES)
    circles, circle_spread, circle_weights = (
        circles[:c],
        circle_spread[:c],
        circle_weights[:c],
    )
    alone = np.flatnonzero(length >= ALONE_MM)[:MAX_ALONE]
    frames = {
        "line": _frames(
            [size[alone]], middle[alone], k[alone], turn[alone], (line_weights * length / 2)[alone]
        ),
        "circle": _frames(
            [_scaled(circles[:, 2], tol.radius_mm, tol.radius_ratio)],
            circles[:, :2],
            circle_spread,
            np.zeros(c),
            circle_weights * circles[:, 2],
        ),
        "pair": _pairs(circles, circle_spread, circle_weights, tol),
        "flank": _flanks(lines, turn, length, line_weights, circles, circle_spread, tol),
    }
    frames["edge"], frames["corner"] = _cornered(lines, spread, line_weights, corners, size, tol)
    if both_directions:
        frames["line"] = _turned(frames["line"])
    return frames


def _frames(
    keys: list[FloatArray],
    points: FloatArray,
    spread: FloatArray,
    turns: FloatArray,
    weights: FloatArray,
) -> Frames:
    stacked = np.stack(keys, axis=1)
    return Frames(stacked, points, spread, turns, weights, np.zeros(len(stacked), dtype=np.int64))


def _cornered(
    lines: FloatArray,
    spread: FloatArray,
    weights: FloatArray,
    corners: Corners,
    size: FloatArray,
    tol: GreyTolerances,
) -> tuple[Frames, Frames]:
    """Return lines between two corners, both ways, and corners with their lines, left one first."""
    n = len(lines)
    ok = (corners.lines < n).all(axis=1)
    at, line, end, angle = (
        corners.positions[ok][:MAX_CORNERS],
        corners.lines[ok][:MAX_CORNERS],
        corners.ends[ok][:MAX_CORNERS],
        corners.angles_rad[ok][:MAX_CORNERS],
    )
    ends = lines.reshape(-1, 2, 2) if n else np.zeros((0, 2, 2))
    # corner-line-corner: corners at end 0 of a line with those at its end 1
    flat_line, flat_end = line.ravel(), end.ravel()
    number = np.repeat(np.arange(len(at)), 2)
    mate = line[:, ::-1].ravel()
    mate_end = end[:, ::-1].ravel()
    i, j = np.nonzero(
        (flat_line[:, None] == flat_line[None]) & (flat_end[:, None] == 0) & (flat_end[None] == 1)
    )
    i, j = np.r_[i, j], np.r_[j, i]
    a, b = at[number[i]], at[number[j]]
    d = b - a
    long = np.hypot(d[:, 0], d[:, 1])
    far = long > MIN_APART_MM
    i, j, a, d, long = i[far], j[far], a[far], d[far], long[far]
    of = flat_line[i]

    def side(x: IntArray) -> FloatArray:  # signed turn from the line to the mate at that corner
        m, e = mate[x], mate_end[x]
        out = ends[m, 1 - e] - ends[m, e]
        cross = d[:, 0] * out[:, 1] - d[:, 1] * out[:, 0]
        return np.sign(cross) * angle[number[x]]

    edge = _frames(
        [
            _scaled(long, tol.length_mm, tol.length_ratio),
            side(i) / tol.angle_rad,
            side(j) / tol.angle_rad,
        ],
        a + d / 2,
        spread[of].mean(axis=1) if len(of) else np.zeros(0),
        np.arctan2(d[:, 1], d[:, 0]),
        weights[of] * (long + 10.0),
    )
    # a corner looks along its bisector; the line on the left is the first
    out = ends[line, 1 - end] - ends[line, end]
    out /= np.maximum(np.linalg.norm(out, axis=2, keepdims=True), 1e-9)
    cross = out[:, 0, 0] * out[:, 1, 1] - out[:, 0, 1] * out[:, 1, 0]
    left = np.where(cross > 0, 1, 0)
    row = np.arange(len(at))
    first, second = line[row, left], line[row, 1 - left]
    bisector = out.sum(axis=1)
    corner = _frames(
        [size[first], size[second], angle / tol.angle_rad],
        at,
        (spread[line[:, 0], end[:, 0]] + spread[line[:, 1], end[:, 1]]) / 2,
        np.arctan2(bisector[:, 1], bisector[:, 0]),
        np.minimum(weights[first], weights[second]) * 8.0,
    )
    return edge, corner


def _pairs(
    circles: FloatArray, spread: FloatArray, weights: FloatArray, tol: GreyTolerances
) -> Frames:
    """Return pairs of circles, the larger first, both ways where they are nearly equal."""
    i, j = np.nonzero(~np.eye(len(circles), dtype=bool))
    r = circles[:, 2]
    alike = tol.radius_mm + tol.radius_ratio * r[i]
    ok = r[i] > r[j] - 2 * alike
    i, j = i[ok], j[ok]
    d = circles[j, :2] - circles[i, :2]
    apart = np.hypot(d[:, 0], d[:, 1])
    far = apart > MIN_APART_MM
    i, j, d, apart = i[far], j[far], d[far], apart[far]
    return _frames(
        [
            _scaled(apart, tol.length_mm * 0.75, tol.length_ratio / 2),
            _scaled(r[i], tol.radius_mm, tol.radius_ratio),
            _scaled(r[j], tol.radius_mm, tol.radius_ratio),
        ],
        (circles[i, :2] + circles[j, :2]) / 2,
        (spread[i] + spread[j]) / 2,
        np.arctan2(d[:, 1], d[:, 0]),
        np.minimum(weights[i], weights[j]) * (10.0 + r[i] + r[j]),
    )


def _flanks(
    lines: FloatArray,
    turn: FloatArray,
    length: FloatArray,
    weights: FloatArray,
    circles: FloatArray,
    circle_spread: FloatArray,
    tol: GreyTolerances,
) -> Frames:
    """Return circles beside lines, directed so that the circle is on the line's left."""
    i, j = (g.ravel() for g in np.indices((len(circles), len(lines))))
    ok = length[j] > 2 * MIN_APART_MM
    i, j = i[ok], j[ok]
    d = circles[i, :2] - (lines[j, :2] + lines[j, 2:]) / 2
    cos, sin = np.cos(turn[j]), np.sin(turn[j])
    left = cos * d[:, 1] - sin * d[:, 0]
    right = left < 0
    direction = turn[j] + np.where(right, np.pi, 0.0)
    frames = _frames(
        [
            _scaled(np.abs(left), tol.length_mm, tol.length_ratio),
            _scaled(circles[i, 2], tol.radius_mm, tol.radius_ratio),
            _scaled(length[j], 3 * tol.length_mm, 5 * tol.length_ratio),
        ],
        circles[i, :2],
        circle_spread[i],
        direction,
        weights[j] * np.minimum(length[j], 20.0) / 2,
    )
    through = np.abs(left) < tol.length_mm  # then either way is the one
    if not through.any():
        return frames
    return joined([frames, taken(_turned(frames), np.r_[np.zeros(len(left), bool), through])])


def _turned(f: Frames) -> Frames:
    """Return frames, followed by the same frames turned by half."""
    return joined([f, Frames(f.keys, f.points, f.spread, f.turns_rad + np.pi, f.weights, f.model)])


def taken(f: Frames, rows: NDArray[np.generic]) -> Frames:
    """Return the frames with the given numbers, or of a mask."""
    return Frames(
        f.keys[rows],
        f.points[rows],
        f.spread[rows],
        f.turns_rad[rows],
        f.weights[rows],
        f.model[rows],
    )


def joined(rows: list[Frames]) -> Frames:
    """Return several lists of frames as one."""
    if not rows:
        none = np.zeros(0)
        return Frames(np.zeros((0, 3)), np.zeros((0, 2)), none, none, none, none.astype(np.int64))
    return Frames(
        np.concatenate([f.keys for f in rows]),
        np.concatenate([f.points for f in rows]),
        np.concatenate([f.spread for f in rows]),
        np.concatenate([f.turns_rad for f in rows]),
        np.concatenate([f.weights for f in rows]),
        np.concatenate([f.model for f in rows]),
    )


def _scaled(size: FloatArray, absolute: float, ratio: float) -> FloatArray:
    """Return sizes scaled so that a tolerance of absolute + ratio x size is 1 everywhere."""
    return np.asarray(np.log1p(size * ratio / absolute) / ratio)
