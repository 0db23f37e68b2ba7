"""Drawn edges from visible pieces: runs from corner to corner of the part."""

from dataclasses import dataclass

import numpy as np

from controller.arrays import BoolArray, FloatArray, Int32Array, IntArray

from .._model import ViewModel
from .._project import FRONT, Projection
from .._segments import near_pairs, tree_of
from .._types import DrawnEdge, LineKind
from ..outlines.outline import ROUNDED_MM, PlaneLoop
from .doubles import DOUBLED_MM
from .hidden import EdgeRuns, plane_at, plane_ends, points_on

KINDS: tuple[LineKind, ...] = ("sharp", "smooth", "silhouette")


def draw(
    model: ViewModel, view: Projection, pieces: EdgeRuns, rings: list[PlaneLoop]
) -> tuple[DrawnEdge, ...]:
    """Return pieces joined to drawn edges.

    A run ends at a vertex of the part, where it goes out of sight, and where it joins or leaves
    the outline.

    Parameters
    ----------
    model, view : the part and how the eye has it
    pieces : those in sight, none twice
    rings : loops of the outline, by which a run is known to be on it
    """
    if len(pieces.mesh_edge) == 0:
        return ()
    on_outline = _on_rings(model, view, pieces, rings)
    edge, start, end, flag = _joined(pieces, on_outline)
    ends, sides, cad_edge = model.ends[edge], model.sides[edge], model.cad_edge[edge]
    is_rim = (view.facing[sides[:, 0]] == FRONT) != (view.facing[sides[:, 1]] == FRONT)
    kind = np.where(cad_edge < 0, 2, np.where(model.is_smooth[edge], np.where(is_rim, 2, 1), 0))
    face = np.where(cad_edge < 0, model.solid.face_of_triangle[sides[:, 0]], -1)
    group = np.where(cad_edge >= 0, cad_edge, len(model.ends) + face)
    first = np.where(start == 0, ends[:, 0], -1)
    last = np.where(end == 1, ends[:, 1], -1)
    key = (group.astype(np.int64) * 3 + kind) * 2 + flag
    runs = _runs(first, last, key, model.is_corner)
    on_cad_edge = model.is_corner.copy()
    on_cad_edge[model.ends[model.cad_edge >= 0]] = True

    # all runs in one go: a piece each, from its first to its last point as the run has it
    flat = np.array([piece for run in runs for piece, _ in run.pieces], dtype=np.int64)
    is_back = np.array([back for run in runs for _, back in run.pieces], dtype=np.bool_)
    begin = np.where(is_back, end[flat], start[flat])
    stop = np.where(is_back, start[flat], end[flat])
    p, q = plane_at(model, view, edge[flat], begin), plane_at(model, view, edge[flat], stop)
    count = subdivisions(view, p, q)
    row = np.repeat(np.arange(len(flat)), count)
    within = (np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)) / count[row]
    at = begin[row] + within * (stop - begin)[row]
    is_last = np.zeros(len(flat), dtype=np.bool_)
    is_last[np.cumsum([len(run.pieces) for run in runs]) - 1] = True
    # the last piece of each run brings its end as well
    where = np.flatnonzero(is_last)
    after = np.cumsum(count)[where]
    all_edges: Int32Array = np.insert(edge[flat][row], after, edge[flat][where]).astype(np.int32)
    all_at = np.insert(at, after, stop[where])
    view_points = view.to_view(plane_at(model, view, all_edges, all_at))
    points_mm = points_on(model, view, all_edges, all_at)
    drawn = []
    stops = after + np.arange(1, len(where) + 1)
    begins = np.concatenate([[0], stops[:-1]])
    for run, low, high in zip(runs, begins.tolist(), stops.tolist(), strict=True):
        piece = run.pieces[0][0]
        is_known = model.is_corner if kind[piece] < 2 else on_cad_edge
        drawn.append(
            DrawnEdge(
                points=view_points[low:high],
                points_mm=points_mm[low:high],
                edge=int(cad_edge[piece]),
                face=int(face[piece]),
                kind=KINDS[kind[piece]],
                on_outline=bool(flag[piece]),
                starts_phantom=not run.is_closed and (run.first < 0 or not is_known[run.first]),
                ends_phantom=not run.is_closed and (run.last < 0 or not is_known[run.last]),
            )
        )
    return tuple(drawn)


BENT_PX = 2e-3  # largest distance of a chord from a line that the lens bends


def subdivisions(view: Projection, p: FloatArray, q: FloatArray) -> IntArray:
    """Return the number of pieces (n,) in which each line follows the lens's distortion.

    Parameters
    ----------
    view : through a camera; without one, or without distortion, a line is one part
    p, q : (n, 2) ends of the lines in the plane
    """
    if view.camera is None or not np.any(view.camera.distortion) or len(p) == 0:
        return np.ones(len(p), dtype=np.int64)
    middle = view.to_view((p + q) / 2)
    bend = np.linalg.norm(middle - (view.to_view(p) + view.to_view(q)) / 2, axis=1)
    count: IntArray = np.maximum(np.ceil(np.sqrt(bend / BENT_PX)), 1).astype(np.int64)
    return count


@dataclass(slots=True)
class _Run:
    pieces: list[tuple[int, bool]]  # number, and True if it is traversed backwards
    first: int  # mesh vertex of its beginning, -1 inside a mesh edge
    last: int
    is_closed: bool


def _runs(first: Int32Array, last: Int32Array, key: IntArray, is_corner: BoolArray) -> list[_Run]:
    """Join pieces that meet, two of one key, at a vertex that is no corner of the part."""
    count = len(first)
    vertex = np.concatenate([first, last])
    end_key = np.concatenate([key, key])
    joins = np.flatnonzero((vertex >= 0) & ~is_corner[vertex])
    order = joins[np.lexsort((end_key[joins], vertex[joins]))]
    other = np.full(2 * count, -1, dtype=np.int64)  # the piece end that goes on from a piece end
    is_same = (np.diff(vertex[order]) == 0) & (np.diff(end_key[order]) == 0)
    # exactly two: not three silhouettes of one face that fork
    is_pair = is_same.copy()
    is_pair[1:] &= ~is_same[:-1]
    is_pair[:-1] &= ~is_same[1:]
    at = np.flatnonzero(is_pair)
    other[order[at]], other[order[at + 1]] = order[at + 1], order[at]
    ahead, where = other.tolist(), vertex.tolist()
    is_used = [False] * count
    runs = []

    def walk(piece: int, back: bool) -> list[tuple[int, bool]]:
        found = []
        while not is_used[piece]:
            is_used[piece] = True
            found.append((piece, back))
            leaving = ahead[piece if back else piece + count]
            if leaving < 0:
                break
            piece, back = leaving % count, leaving >= count
        return found

    for piece in range(count):  # open runs from their free ends
        for is_end in (False, True):
            if not is_used[piece] and ahead[piece + count * is_end] < 0:
                found = walk(piece, is_end)
                end, back = found[-1]
                begin = where[piece + count * is_end]
                runs.append(_Run(found, begin, where[end if back else end + count], False))
    for piece in range(count):
        if not is_used[piece]:
            runs.append(_Run(walk(piece, False), where[piece], where[piece], True))
    for run in runs:
        run.is_closed |= run.first == run.last and run.first >= 0
    return runs


def _joined(
    pieces: EdgeRuns, flag: BoolArray
) -> tuple[Int32Array, FloatArray, FloatArray, BoolArray]:
    edge, start, end = pieces.mesh_edge, pieces.start, pieces.end
    goes_on = (edge[1:] == edge[:-1]) & (start[1:] == end[:-1]) & (flag[1:] == flag[:-1])
    begins = np.flatnonzero(np.concatenate([[True], ~goes_on]))
    stops = np.concatenate([begins[1:], [len(edge)]]) - 1
    return edge[begins], start[begins], end[stops], flag[begins]


def _on_rings(
    model: ViewModel, view: Projection, pieces: EdgeRuns, rings: list[PlaneLoop]
) -> BoolArray:
    p, q = plane_ends(model, view, pieces)
    sides = np.concatenate(
        [np.stack([r.points, np.roll(r.points, -1, axis=0)], axis=1) for r in rings]
    )
    middle = (p + q) / 2
    reach = ROUNDED_MM * view.scale
    near, side = near_pairs(tree_of(sides[:, 0], sides[:, 1]), middle, middle, reach)
    a, b = sides[side, 0], sides[side, 1]
    span = b - a
    part = ((middle[near] - a) * span).sum(axis=1) / np.maximum((span**2).sum(axis=1), 1e-300)
    foot = a + np.clip(part, 0, 1)[:, None] * span
    distance = np.linalg.norm(middle[near] - foot, axis=1)
    # two rims of one bore, tessellated differently, keep the distance of their chords
    edge, label = model.cad_edge[pieces.mesh_edge[near]], np.concatenate([r.edges for r in rings])
    is_same = (edge >= 0) & (edge == label[side]) & (distance < reach)
    on = np.zeros(len(p), dtype=np.bool_)
    on[near[is_same | (distance < DOUBLED_MM * view.scale)]] = True
    return on
