"""From visible pieces to drawn edges: doubled lines merged, pieces joined to runs."""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from ._hidden import SHORTEST_MM, Pieces, points_on
from ._model import ViewModel
from ._outline import ROUNDED_MM, ROUNDED_SINE, Ring
from ._project import FRONT, Projection
from ._types import DrawnEdge, LineKind

Array = NDArray[np.float64]
Ids = NDArray[np.int32]
Bools = NDArray[np.bool_]

DOUBLED_MM = 0.01  # lines closer than this all along show as one
DOUBLED_RAD = 0.05
KINDS: tuple[LineKind, ...] = ("sharp", "smooth", "silhouette")


def without_doubles(model: ViewModel, view: Projection, pieces: Pieces) -> Pieces:
    """Return the pieces less what lies under a nearer one, as the foot of a wall seen edge-on."""
    p, q = _plane_ends(model, view, pieces)
    if len(p) == 0:
        return pieces
    lines = shapely.linestrings(np.stack([p, q], axis=1))
    # two rims of one bore, tessellated differently, keep the distance of their chords
    wall = view.wall[pieces.mesh_edge]
    # and where a free wall is all but edge-on, its facets' silhouette strays about beside its rim
    face = model.solid.face_of_triangle[model.sides[pieces.mesh_edge]]
    is_bare = model.cad_edge[pieces.mesh_edge] < 0
    is_free = np.array([f.kind in ("freeform", "torus") for f in model.solid.faces])
    is_bent = is_bare & is_free[face[:, 0]]
    reach = np.where((wall >= 0) | is_bent, ROUNDED_MM, DOUBLED_MM) * view.scale
    under, over = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=reach)
    differs = pieces.mesh_edge[under] != pieces.mesh_edge[over]
    under, over = under[differs], over[differs]
    r, s = (q - p)[under], (q - p)[over]
    length, over_length = np.linalg.norm(r, axis=1), np.linalg.norm(s, axis=1)
    is_stray = is_bent[under] & ~is_bare[over] & (face[over] == face[under, :1]).any(axis=1)
    is_rim = (wall[under] >= 0) & (wall[under] == wall[over]) | is_stray
    limit = np.where(is_rim, ROUNDED_SINE, DOUBLED_RAD)
    is_along = np.abs(_cross(r, s)) < limit * length * over_length
    under, over, r, length = under[is_along], over[is_along], r[is_along], length[is_along]
    is_stray = is_stray[is_along]
    tolerance = np.where(is_rim[is_along], ROUNDED_MM, DOUBLED_MM) * view.scale
    # what is over it from a to b of its length, and how far beside
    to_start, to_end = p[over] - p[under], q[over] - p[under]
    at = np.stack([(to_start * r).sum(axis=1), (to_end * r).sum(axis=1)]) / length**2
    aside = np.stack([_cross(r, to_start), _cross(r, to_end)]) / length
    a, b = np.clip(at.min(axis=0), 0, 1), np.clip(at.max(axis=0), 0, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = (aside[1] - aside[0]) / (at[1] - at[0])
        beside = [np.abs(aside[0] + slope * (x - at[0])) for x in (a, b)]
        part = ((a + b) / 2 - at[0]) / (at[1] - at[0])
    nearness = _nearness(model, view, pieces, under, (a + b) / 2)
    over_nearness = _nearness(model, view, pieces, over, part)
    gap = SHORTEST_MM * view.scale
    covers = ((b - a) * length > gap) & (np.maximum(*beside) < tolerance)
    covers &= (over_nearness > nearness) | is_stray
    under, a, b, length = under[covers], a[covers], b[covers], length[covers]
    start, end = pieces.start.copy(), pieces.end.copy()
    is_left = np.ones(len(p), dtype=np.bool_)
    more: list[tuple[int, float, float]] = []
    order = np.lexsort((a, under))
    for first, stop in _groups(under[order]):
        rows = order[first:stop]
        piece = int(under[rows[0]])
        short = gap / length[rows[0]]
        is_left[piece] = False
        reach, width = 0.0, pieces.end[piece] - pieces.start[piece]
        gaps = []
        for row in rows:
            if a[row] - reach > short:
                gaps.append((reach, float(a[row])))
            reach = max(reach, float(b[row]))
        if 1 - reach > short:
            gaps.append((reach, 1.0))
        for low, high in gaps:
            begin = pieces.start[piece]
            more.append((piece, begin + low * width, begin + high * width))
    kept = np.flatnonzero(is_left)
    owner = np.concatenate([kept, np.array([m[0] for m in more], dtype=np.int64)])
    start = np.concatenate([start[kept], [m[1] for m in more]])
    end = np.concatenate([end[kept], [m[2] for m in more]])
    order = np.lexsort((start, pieces.mesh_edge[owner]))
    return Pieces(pieces.mesh_edge[owner[order]], start[order], end[order])


def draw(
    model: ViewModel, view: Projection, pieces: Pieces, rings: list[Ring], step: Array | None = None
) -> tuple[DrawnEdge, ...]:
    """Join pieces to drawn edges.

    A run ends at a vertex of the part, where it goes out of sight, and where it joins or leaves
    the outline.
    """
    if len(pieces.mesh_edge) == 0:
        return ()
    on_outline = _on_rings(model, view, pieces, rings)
    facing = view.facing[model.sides]
    is_rim = (facing == FRONT).any(axis=1) & (facing != FRONT).any(axis=1)
    kind = np.where(model.cad_edge < 0, 2, np.where(model.is_smooth, np.where(is_rim, 2, 1), 0))
    face = np.where(model.cad_edge < 0, model.solid.face_of_triangle[model.sides[:, 0]], -1)
    group = np.where(model.cad_edge >= 0, model.cad_edge, len(model.cad_edge) + face)
    edge, start, end, flag = _joined(pieces, on_outline)
    ends = model.ends[edge]
    first = np.where(start == 0, ends[:, 0], -1)
    last = np.where(end == 1, ends[:, 1], -1)
    key = (group[edge] * 3 + kind[edge]) * 2 + flag
    runs = _runs(first, last, key, model.is_corner)
    on_cad_edge = model.is_corner.copy()
    on_cad_edge[model.ends[model.cad_edge >= 0]] = True

    # all runs in one go: a piece each, from its first to its last point as the run has it
    flat = np.array([piece for run in runs for piece, _ in run.pieces], dtype=np.int64)
    is_back = np.array([back for run in runs for _, back in run.pieces], dtype=np.bool_)
    begin = np.where(is_back, end[flat], start[flat])
    stop = np.where(is_back, start[flat], end[flat])
    p, q = _plane_at(model, view, edge[flat], begin), _plane_at(model, view, edge[flat], stop)
    count = subdivisions(view, p, q)
    row = np.repeat(np.arange(len(flat)), count)
    within = (np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)) / count[row]
    at = begin[row] + within * (stop - begin)[row]
    is_last = np.zeros(len(flat), dtype=np.bool_)
    is_last[np.cumsum([len(run.pieces) for run in runs]) - 1] = True
    # the last piece of each run brings its end as well
    where = np.flatnonzero(is_last)
    after = np.cumsum(count)[where]
    all_edges = np.insert(edge[flat][row], after, edge[flat][where])
    all_at = np.insert(at, after, stop[where])
    view_points = view.to_view(_plane_at(model, view, all_edges, all_at))
    points_mm = points_on(model, view, all_edges, all_at)
    drawn = []
    stops = after + np.arange(1, len(where) + 1)
    begins = np.concatenate([[0], stops[:-1]])
    for run, low, high in zip(runs, begins.tolist(), stops.tolist(), strict=True):
        mesh_edge = edge[run.pieces[0][0]]
        is_known = model.is_corner if kind[mesh_edge] < 2 else on_cad_edge
        drawn.append(
            DrawnEdge(
                points=view_points[low:high],
                points_mm=points_mm[low:high],
                edge=int(model.cad_edge[mesh_edge]),
                face=int(face[mesh_edge]),
                kind=KINDS[kind[mesh_edge]],
                on_outline=bool(flag[run.pieces[0][0]]),
                starts_phantom=not run.is_closed and (run.first < 0 or not is_known[run.first]),
                ends_phantom=not run.is_closed and (run.last < 0 or not is_known[run.last]),
            )
        )
    return tuple(drawn)


BENT_PX = 2e-3  # how far a chord may stray from a line that the lens bends


def subdivisions(view: Projection, p: Array, q: Array) -> NDArray[np.int64]:
    """Return in how many parts to draw lines from p to q (n, 2) that the lens bends."""
    if view.camera is None or not np.any(view.camera.distortion) or len(p) == 0:
        return np.ones(len(p), dtype=np.int64)
    middle = view.to_view((p + q) / 2)
    bend = np.linalg.norm(middle - (view.to_view(p) + view.to_view(q)) / 2, axis=1)
    count: NDArray[np.int64] = np.maximum(np.ceil(np.sqrt(bend / BENT_PX)), 1).astype(np.int64)
    return count


@dataclass(slots=True)
class _Run:
    pieces: list[tuple[int, bool]]  # number, and whether it is run through backwards
    first: int  # mesh vertex it begins at, -1 inside a mesh edge
    last: int
    is_closed: bool


def _runs(first: Ids, last: Ids, key: Ids, is_corner: Bools) -> list[_Run]:
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


def _joined(pieces: Pieces, flag: Bools) -> tuple[Ids, Array, Array, Bools]:
    edge, start, end = pieces.mesh_edge, pieces.start, pieces.end
    goes_on = (edge[1:] == edge[:-1]) & (start[1:] == end[:-1]) & (flag[1:] == flag[:-1])
    begins = np.flatnonzero(np.concatenate([[True], ~goes_on]))
    stops = np.concatenate([begins[1:], [len(edge)]]) - 1
    return edge[begins], start[begins], end[stops], flag[begins]


def _on_rings(model: ViewModel, view: Projection, pieces: Pieces, rings: list[Ring]) -> Bools:
    p, q = _plane_ends(model, view, pieces)
    sides = np.concatenate(
        [np.stack([r.points, np.roll(r.points, -1, axis=0)], axis=1) for r in rings]
    )
    tree = shapely.STRtree(shapely.linestrings(sides))
    middle = (p + q) / 2
    near, side = tree.query(
        shapely.points(middle), predicate="dwithin", distance=ROUNDED_MM * view.scale
    )
    a, b = sides[side, 0], sides[side, 1]
    span = b - a
    part = ((middle[near] - a) * span).sum(axis=1) / np.maximum((span**2).sum(axis=1), 1e-300)
    foot = a + np.clip(part, 0, 1)[:, None] * span
    distance = np.linalg.norm(middle[near] - foot, axis=1)
    # two rims of one bore, tessellated differently, keep the distance of their chords
    edge, label = model.cad_edge[pieces.mesh_edge[near]], np.concatenate([r.edges for r in rings])
    is_same = (edge >= 0) & (edge == label[side])
    on = np.zeros(len(p), dtype=np.bool_)
    on[near[is_same | (distance < DOUBLED_MM * view.scale)]] = True
    return on


def _plane_at(model: ViewModel, view: Projection, mesh_edge: Ids, at: Array) -> Array:
    ends = model.ends[mesh_edge]
    p = view.points[ends[:, 0]]
    points: Array = p + at[:, None] * (view.points[ends[:, 1]] - p)
    return points


def _plane_ends(model: ViewModel, view: Projection, pieces: Pieces) -> tuple[Array, Array]:
    return (
        _plane_at(model, view, pieces.mesh_edge, pieces.start),
        _plane_at(model, view, pieces.mesh_edge, pieces.end),
    )


def _nearness(model: ViewModel, view: Projection, pieces: Pieces, piece: Ids, part: Array) -> Array:
    at = pieces.start[piece] + part * (pieces.end - pieces.start)[piece]
    z = view.nearness[model.ends[pieces.mesh_edge[piece]]]
    nearness: Array = z[:, 0] + at * (z[:, 1] - z[:, 0])
    return nearness


def _groups(sorted_ids: Ids) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(sorted_ids, prepend=-1, append=-1))
    return list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))


def _cross(a: Array, b: Array) -> Array:
    product: Array = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return product
