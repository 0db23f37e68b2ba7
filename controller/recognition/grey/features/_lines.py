"""Lines from pieces in cells: collinear neighbours are merged, in rounds.

The paper (references.md P3.2): "the ends are close together and the angle between them is close to
zero". A third condition makes it safe: the points of both still lie on one line, which sums of
their coordinates tell without going back to the points.
"""

import numpy as np
from scipy.spatial import cKDTree

from controller.arrays import FloatArray, IntArray

from .._tolerances import GreyTolerances
from ._cells import Moments, line_of, rms_of

ROUNDS = 12  # pairs merge to twice the length in each round: 4096 cells
MAX_EXTENDED = 80  # longest lines that are extended
EXTENSION_GAP_PX = 2.5  # a point is missing on the ridge here and there
MAX_BRIDGED = 80  # longest lines between which gaps are bridged


def merge_lines(pieces: Moments, tol: GreyTolerances) -> tuple[Moments, IntArray]:
    """Return lines merged from pieces [px of the plane], and each piece's line."""
    count = len(pieces.sums)
    owner = np.arange(count)
    if count < 2:
        return pieces, owner
    ends = pieces.ends.reshape(-1, 2)
    near = cKDTree(ends).query_pairs(tol.join_px, output_type="ndarray") // 2
    near = near[near[:, 0] != near[:, 1]]
    lines, moved = _rounds(pieces, near.astype(np.int64), tol.join_rad, tol.straight_px)
    owner = moved[owner]
    for _ in range(2):
        far = _bridges(lines, tol)
        if len(far) == 0:
            break
        lines, moved = _rounds(lines, far, tol.bridge_rad, tol.straight_px)
        owner = moved[owner]
    return lines, owner


def _rounds(
    lines: Moments, pairs: IntArray, angle_rad: float, rms_px: float
) -> tuple[Moments, IntArray]:
    """Merge pairs of lines that are each other's best until there are none."""
    count = len(lines.sums)
    root = np.arange(count)
    sums, ends, normals = lines.sums.copy(), lines.ends.copy(), lines.normals.copy()
    for _ in range(ROUNDS):
        i, j = root[pairs.T]
        key = np.unique((np.minimum(i, j) * count + np.maximum(i, j))[i != j])
        i, j = np.divmod(key, count)
        lean = normals[i, 0] * normals[j, 0] + normals[i, 1] * normals[j, 1]
        alike = lean > np.cos(angle_rad)
        i, j = i[alike], j[alike]
        if len(i) == 0:
            break
        rms = rms_of(sums[i] + sums[j])
        straight = rms < rms_px
        i, j, rms = i[straight], j[straight], rms[straight]
        if len(i) == 0:
            break
        pairs = np.stack([i, j], axis=1)
        best = np.full(count, np.inf)
        np.minimum.at(best, i, rms)
        np.minimum.at(best, j, rms)
        mutual = np.flatnonzero((best[i] == rms) & (best[j] == rms))
        # equal costs could make a chain of best pairs: each line takes part once
        seen = np.zeros(count, dtype=bool)
        chosen = []
        for m in mutual.tolist():
            if not (seen[i[m]] or seen[j[m]]):
                seen[i[m]] = seen[j[m]] = True
                chosen.append(m)
        a, b = i[chosen], j[chosen]
        sums[a] += sums[b]
        mean, normal, _ = line_of(sums[a], normals[a] + normals[b])
        along = np.array([-normal[:, 1], normal[:, 0]]).T
        both = np.concatenate([ends[a], ends[b]], axis=1) - mean[:, None]
        t = both[..., 0] * along[:, :1] + both[..., 1] * along[:, 1:]
        reach = np.array([t.min(axis=1), t.max(axis=1)]).T
        ends[a] = mean[:, None] + reach[:, :, None] * along[:, None]
        normals[a] = normal
        to = np.arange(count)
        to[b] = a
        root = to[root]
    alive = np.unique(root)
    number = np.zeros(count, dtype=np.int64)
    number[alive] = np.arange(len(alive))
    return Moments(sums[alive], ends[alive], normals[alive]), number[root]


def extended(
    lines: Moments, points: FloatArray, normals: FloatArray, tol: GreyTolerances
) -> FloatArray:
    """Return the ends (n, 2, 2) of lines, extended to edge points without a line in their cell.

    If a line ends in a cell with only a few points, or at a corner, the cell's own line was a
    different one.

    Parameters
    ----------
    lines : as found from cell to cell
    points, normals : (m, 2) edge points that are of no line [px of the plane]
    tol : largest distance of an edge point from its line
    """
    ends = lines.ends.copy()
    length = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
    long = np.flatnonzero(length > tol.line_px)
    long = long[np.argsort(-length[long], kind="stable")][:MAX_EXTENDED]
    if len(long) == 0 or len(points) == 0:
        return ends
    n = lines.normals[long]
    middle = ends[long].mean(axis=1)
    half = length[long, None] / 2
    # signs of the points along and beside each line, (line, point)
    beside = n @ points.T - (n * middle).sum(axis=1)[:, None]
    line, point = np.nonzero(
        (np.abs(beside) < tol.band_px) & (n @ normals.T > np.cos(tol.vote_rad))
    )
    way = ends[long, 1] - ends[long, 0]
    way /= np.maximum(np.hypot(way[:, 0], way[:, 1]), 1e-9)[:, None]
    t = ((points[point] - middle[line]) * way[line]).sum(axis=1)
    for side, sign in ((0, -1.0), (1, 1.0)):
        beyond = sign * t - half[line, 0]
        near = (beyond > 0) & (beyond < tol.cell_px)
        order = np.lexsort((beyond[near], line[near]))
        of, out = line[near][order], beyond[near][order]
        if len(of) == 0:
            continue
        begins = np.r_[True, of[1:] != of[:-1]]
        gap = np.where(begins, out, np.diff(out, prepend=0.0))
        # up to the first gap: a line beyond another one's corner is not its own
        broken = np.cumsum(gap > EXTENSION_GAP_PX)
        at_start = broken[begins] - (gap[begins] > EXTENSION_GAP_PX)
        whole = broken == at_start[np.cumsum(begins) - 1]
        reach = np.zeros(len(long))
        np.maximum.at(reach, of[whole], out[whole])
        ends[long, side] += sign * reach[:, None] * way
    return ends


def _bridges(lines: Moments, tol: GreyTolerances) -> IntArray:
    """Return pairs of long collinear lines with a gap between, shorter than the shorter line."""
    length = np.linalg.norm(lines.ends[:, 1] - lines.ends[:, 0], axis=1)
    long = np.flatnonzero(length > 1.5 * tol.cell_px)
    long = long[np.argsort(-length[long], kind="stable")][:MAX_BRIDGED]
    if len(long) < 2:
        return np.zeros((0, 2), dtype=np.int64)
    n, ends = lines.normals[long], lines.ends[long]
    along = np.stack([-n[:, 1], n[:, 0]], axis=1)
    offset = ends[None] - ends.mean(axis=1)[:, None, None]  # (i, j, end, 2): j as seen from i
    beside = np.abs(np.einsum("ijek,ik->ije", offset, n)).max(axis=2)
    t = np.einsum("ijek,ik->ije", offset, along)
    gap = np.maximum(t.min(axis=2), -t.max(axis=2)) - length[long][:, None] / 2
    shorter = np.minimum(length[long][:, None], length[long][None])
    i, j = np.nonzero(
        (n @ n.T > np.cos(tol.bridge_rad))
        & (beside < tol.bridge_px)
        & (tol.bridge_px > beside.T)
        & (gap < 0.5 * shorter)
        & (gap > -tol.join_px)
    )
    pairs = np.stack([long[i], long[j]], axis=1)
    return pairs[i < j]
