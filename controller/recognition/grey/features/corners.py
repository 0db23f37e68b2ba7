"""Corners and junctions: where ends of lines meet.

The paper (references.md P3.2) has corners of about 90 deg; here they are of any angle, with the Y
(three ends meet) and the T (one ends at another's middle) that it left open.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from controller.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False, slots=True)
class Corners:
    """Corners of lines.

    Attributes
    ----------
    positions : (n, 2) intersection of the two lines
    lines : (n, 2) their numbers
    ends : (n, 2) index of the end of each, 0 or 1
    angles_rad : (n,) between them, 0..pi
    """

    positions: FloatArray
    lines: IntArray
    ends: IntArray
    angles_rad: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class Junctions:
    """Meetings of lines other than corners: at (n, 2), of three ends (Y) or one end (T)."""

    positions: FloatArray
    is_y: BoolArray


def find_corners(segments: FloatArray, reach: float, min_rad: float) -> Corners:
    """Return the corners of lines.

    Parameters
    ----------
    segments : (n, 4) x0 y0 x1 y1
    reach : largest distance of ends from the point where their lines meet, in the same unit
    min_rad : lines that bend by less are one curve
    """
    count = len(segments)
    if count < 2:
        none = np.zeros((0, 2), dtype=np.int64)
        return Corners(np.zeros((0, 2)), none, none.copy(), np.zeros(0))
    ends = segments.reshape(-1, 2)
    length = np.maximum(np.linalg.norm(segments[:, 2:] - segments[:, :2], axis=1), 1e-9)
    into = (segments[:, 2:] - segments[:, :2]) / length[:, None]
    into = np.stack([into, -into], axis=1).reshape(-1, 2)  # from each end along its line
    pairs = cKDTree(ends).query_pairs(2 * reach, p=np.inf, output_type="ndarray")
    a, b = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))].T
    other = a // 2 != b // 2
    a, b = a[other], b[other]
    cross = into[a, 0] * into[b, 1] - into[a, 1] * into[b, 0]
    dot = np.einsum("ni,ni->n", into[a], into[b])
    bent = np.abs(cross) > np.sin(min_rad)
    a, b, cross, dot = a[bent], b[bent], cross[bent], dot[bent]
    d = ends[b] - ends[a]
    s = (d[:, 0] * into[b, 1] - d[:, 1] * into[b, 0]) / cross
    t = (d[:, 0] * into[a, 1] - d[:, 1] * into[a, 0]) / cross
    near_a = np.minimum(reach, 0.4 * length[a // 2])
    near_b = np.minimum(reach, 0.4 * length[b // 2])
    meets = (np.abs(s) < near_a) & (np.abs(t) < near_b)
    a, b, s, t, dot = a[meets], b[meets], s[meets], t[meets], dot[meets]
    position = ends[a] + s[:, None] * into[a]
    return Corners(
        position,
        np.stack([a // 2, b // 2], axis=1),
        np.stack([a % 2, b % 2], axis=1),
        np.arccos(np.clip(dot, -1.0, 1.0)),
    )


def find_junctions(segments: FloatArray, corners: Corners, reach: float) -> Junctions:
    """Return the Y and T junctions of lines.

    Parameters
    ----------
    segments : (n, 4) x0 y0 x1 y1
    corners : `find_corners` of them
    reach : largest distance of an end from the line it meets, in the same unit
    """
    count = len(segments)
    key = corners.lines * 2 + corners.ends
    shared = np.bincount(key.ravel(), minlength=2 * count)
    # three ends that meet are three corners, each end in two of them
    y_corner = (shared[key] >= 2).all(axis=1) if len(key) else np.zeros(0, dtype=bool)
    y_at = corners.positions[y_corner]
    if len(y_at):
        cells = np.round(y_at / max(2 * reach, 1e-9)).astype(np.int64)
        _, first = np.unique(cells, axis=0, return_index=True)
        y_at = y_at[np.sort(first)]
    start, along = segments[:, :2], segments[:, 2:] - segments[:, :2]
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-9)
    along = along / length[:, None]
    ends = segments.reshape(-1, 2)
    # signs and distances of all ends along and beside all lines, (end, line)
    across = np.stack([along[:, 1], -along[:, 0]], axis=1)
    t = ends @ along.T - (start * along).sum(axis=1)
    beside = ends @ across.T - (start * across).sum(axis=1)
    e, line = np.nonzero((np.abs(beside) < reach) & (t > 2 * reach) & (t < length - 2 * reach))
    lean = np.abs((along[e // 2] * across[line]).sum(axis=1))
    e, line = e[lean > 0.34], line[lean > 0.34]
    t_at = start[line] + t[e, line][:, None] * along[line]
    return Junctions(
        np.concatenate([y_at, t_at]), np.r_[np.ones(len(y_at), bool), np.zeros(len(t_at), bool)]
    )
