"""All edges of a part as points in space, with their adjacent faces."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np

from controller.arrays import BoolArray, FloatArray, IndexArray
from controller.cad import Crease, Solid, inner_mm, surface_normals
from controller.cad import Curve as CurveKind

from ..dimensions import Curve
from ..limits import CORNER_PX

SPACING_PX: Final = 2.0  # distance between rays; within a lens's blur closer ones add nothing
SHORTEST_PX: Final = 3.0  # length below which an edge is lost in the blur of a lens
# Largest share of an edge left out at a corner, so that short edges are measured too.
MAX_CORNER: Final = 0.3
MIN_POINTS: Final = 4
MAX_POINTS: Final = 160
STEP: Final = 0.5  # step back and on for the tangent, in spacings
KEPT_PARTS: Final = 4  # number of products whose geometry is cached for their next part


@dataclass(frozen=True, eq=False, slots=True)
class PartEdges:
    """Points along every sharp edge of a part, edge by edge in order, CAD frame.

    Attributes
    ----------
    curves : one curve for each edge used
    edge : (n,) number in the boundary of each point's edge
    points_mm : (n, 3)
    length_mm : (n,) length of edge that each point represents
    faces : (n, 2) adjacent faces
    normals : (n, 2, 3) their outward normals
    into : (n, 2, 3) unit, square to the edge, along each face and away from the edge
    is_closed : (n,) True where the edge is closed
    """

    curves: tuple[Curve, ...]
    edge: IndexArray
    points_mm: FloatArray
    length_mm: FloatArray
    faces: IndexArray
    normals: FloatArray
    into: FloatArray
    is_closed: BoolArray

    def moved(self, chosen: Iterable[int], by_mm: FloatArray) -> "PartEdges":
        """Return some of the edges, moved as a whole.

        Parameters
        ----------
        chosen : numbers of edges in the boundary
        by_mm : (3,) CAD frame
        """
        mine = np.isin(self.edge, list(chosen))
        firsts = np.flatnonzero(np.diff(self.edge, prepend=-1))
        curves = (c for c, at in zip(self.curves, firsts, strict=True) if mine[at])
        arrays = ("edge", "length_mm", "faces", "normals", "into", "is_closed")
        return replace(
            self,
            curves=tuple(curve.moved(by_mm) for curve in curves),
            points_mm=self.points_mm[mine] + by_mm,
            **{name: getattr(self, name)[mine] for name in arrays},
        )


def is_blurred(solid: Solid, pixel_mm: float) -> BoolArray:
    """Return a mask (f,) of faces so narrow that their edges are one edge in a picture.

    Parameters
    ----------
    solid : the part
    pixel_mm : pixel size at the part
    """
    return np.asarray(2.0 * inner_mm(solid) < SHORTEST_PX * pixel_mm)


def find_edges(solid: Solid, pixel_mm: float) -> PartEdges | None:
    """Return points along every edge that is neither smooth nor tiny; None without such edges.

    Parameters
    ----------
    solid : the part
    pixel_mm : pixel size at the part
    """
    b = solid.boundary
    vertices = np.asarray(solid.mesh.vertices, dtype=np.float64)
    beside = _triangles_beside(solid)
    facets = np.asarray(solid.mesh.face_normals, dtype=np.float64)
    rows: list[tuple[Curve, int, FloatArray, IndexArray, FloatArray, FloatArray, bool]] = []
    for edge in np.flatnonzero(b.crease != Crease.SMOOTH).tolist():
        chain = b.chain_of(edge)
        way = vertices[chain]
        at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
        length = float(at[-1])
        if length < SHORTEST_PX * pixel_mm:
            continue
        is_closed = int(chain[0]) == int(chain[-1])
        places, share_mm = _places(length, pixel_mm, is_closed)
        step = STEP * SPACING_PX * pixel_mm
        on, before, after = (_along(way, at, places + d, is_closed) for d in (0.0, -step, step))
        segment = np.clip(np.searchsorted(at, places, side="right") - 1, 0, len(at) - 2)
        facet_mm, chord_mm = 0.0, np.zeros_like(on)
        if b.curve[edge] == CurveKind.CIRCLE:
            circle = b.centre_mm[edge], b.axis[edge], float(b.radius_mm[edge])
            on_mesh = on
            on, before, after = (_on_circle(points, *circle) for points in (on, before, after))
            chord_mm = on_mesh - on
            half = 0.5 * float(np.diff(at).max()) / circle[2]
            facet_mm = circle[2] * (1.0 - float(np.cos(np.arcsin(min(half, 1.0)))))
        tangent = after - before
        tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
        faces = np.array([b.face[2 * edge], b.face[2 * edge + 1]], dtype=np.intp)
        normals = np.empty((len(on), 2, 3))
        into = np.empty((len(on), 2, 3))
        for side, turn in ((0, 1.0), (1, -1.0)):
            face = int(faces[side])
            triangles = np.array([
                beside[_key(int(chain[i]), int(chain[i + 1]))][face] for i in segment.tolist()
            ])  # fmt: skip
            ids = np.full(len(on), face, dtype=np.int32)
            normals[:, side] = surface_normals(solid.faces, ids, on, facets[triangles])
            # Seen from outside, a half-edge has its face on the left.
            into[:, side] = turn * np.cross(normals[:, side], tangent)
        out = normals.sum(axis=1)
        size = np.linalg.norm(out, axis=1, keepdims=True)
        out = np.where(size > 1e-6, out / np.maximum(size, 1e-6), normals[:, 0])
        curve = Curve(
            before_mm=before,
            points_mm=on,
            after_mm=after,
            shift=out,
            out=out,
            design=np.zeros((len(on), 1, 3)),
            facet_mm=facet_mm,
            outward=1.0,
            chord_mm=chord_mm[:, None],
        )
        rows.append((curve, edge, np.full(len(on), share_mm), faces, normals, into, is_closed))
    if not rows:
        return None
    counts = [len(row[0].points_mm) for row in rows]
    return PartEdges(
        curves=tuple(row[0] for row in rows),
        edge=np.repeat(np.array([row[1] for row in rows], dtype=np.intp), counts),
        points_mm=np.concatenate([row[0].points_mm for row in rows]),
        length_mm=np.concatenate([row[2] for row in rows]),
        faces=np.repeat(np.array([row[3] for row in rows]), counts, axis=0),
        normals=np.concatenate([row[4] for row in rows]),
        into=np.concatenate([row[5] for row in rows]),
        is_closed=np.repeat(np.array([row[6] for row in rows]), counts),
    )


def _places(length_mm: float, pixel_mm: float, is_closed: bool) -> tuple[FloatArray, float]:
    """Return the places of points along an edge [mm], and the length that each represents."""
    corner = 0.0 if is_closed else min(CORNER_PX * pixel_mm, MAX_CORNER * length_mm)
    wanted = (length_mm - 2 * corner) / (SPACING_PX * pixel_mm)
    count = int(np.clip(wanted, MIN_POINTS, MAX_POINTS))
    places = corner + (np.arange(count) + 0.5) * (length_mm - 2 * corner) / count
    return places, length_mm / count


def _along(way: FloatArray, at: FloatArray, places: FloatArray, is_closed: bool) -> FloatArray:
    """Return points (n, 3) at places along a polyline, possibly beyond its ends."""
    if is_closed:
        places = places % at[-1]
    inside = np.clip(places, at[0], at[-1])
    points = np.column_stack([np.interp(inside, at, way[:, k]) for k in range(3)])
    first = (way[1] - way[0]) / max(float(at[1] - at[0]), 1e-12)
    last = (way[-1] - way[-2]) / max(float(at[-1] - at[-2]), 1e-12)
    beyond = places - inside
    points += np.minimum(beyond, 0.0)[:, None] * first + np.maximum(beyond, 0.0)[:, None] * last
    return points


def _on_circle(
    points_mm: FloatArray, centre_mm: FloatArray, axis: FloatArray, radius_mm: float
) -> FloatArray:
    off = points_mm - centre_mm
    off = off - (off @ axis)[:, None] * axis
    size = np.maximum(np.linalg.norm(off, axis=1, keepdims=True), 1e-9)
    return np.asarray(centre_mm + radius_mm * off / size)


def _key(one: int, other: int) -> tuple[int, int]:
    return (one, other) if one < other else (other, one)


@lru_cache(maxsize=KEPT_PARTS)
def _triangles_beside(solid: Solid) -> dict[tuple[int, int], dict[int, int]]:
    """Return the triangle beside a mesh edge, by the edge's two vertices and by face."""
    out: dict[tuple[int, int], dict[int, int]] = {}
    pairs = np.sort(np.asarray(solid.mesh.face_adjacency_edges), axis=1).tolist()
    triangles = np.asarray(solid.mesh.face_adjacency).tolist()
    face = solid.face_of_triangle
    for (one, other), (a, b) in zip(pairs, triangles, strict=True):
        if face[a] != face[b]:
            out[one, other] = {int(face[a]): a, int(face[b]): b}
    return out
