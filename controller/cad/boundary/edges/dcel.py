"""The doubly connected edge list of a segmented mesh (references.md P2.0; planning-facts.md 4).

A mesh edge is on the list where the surfaces on its two sides differ. Runs of such mesh edges
between vertices where three surfaces or more meet are one edge; loops follow from turning about
each vertex inside one surface.
"""

from collections.abc import Sequence

import numpy as np
import trimesh
from numpy.typing import NDArray

from controller.arrays import BoolArray, FloatArray, IntArray

from ...graph import components
from .._types import Boundary, Face
from ._creases import find_creases
from ._curves import fit_curves
from .halfedges import HalfEdges, first_of_each, half_edges, next_on_rim, rank_chains


def find_boundary(
    mesh: trimesh.Trimesh, faces: Sequence[Face], face_of_triangle: NDArray[np.integer]
) -> Boundary:
    """Return the edges, loops and vertices between the surfaces of a closed mesh.

    Parameters
    ----------
    mesh : closed, consistently wound, outward normals [mm]
    faces : its surfaces, as `find_faces` returns them
    face_of_triangle : (n,) surface of each triangle

    Raises
    ------
    ValueError : the mesh is not closed or not wound one way
    """
    vertices_mm = np.asarray(mesh.vertices, dtype=np.float64)
    sides = half_edges(np.asarray(mesh.faces))
    face_of = np.repeat(np.asarray(face_of_triangle, dtype=np.int64), 3)
    is_rim = face_of != face_of[sides.twin]
    onward = next_on_rim(sides, is_rim)
    degree = np.bincount(sides.fan[is_rim], minlength=sides.fan_count)
    # the side of the lower face tells an edge; the other side is its mirror image
    members = np.nonzero(is_rim & (face_of < face_of[sides.twin]))[0]
    order, start = _chains(sides, onward, members, is_vertex=degree > 2)
    edge_count = len(start) - 1
    head, tail = order[start[:-1]], order[start[1:] - 1]

    ends = np.empty(2 * edge_count, dtype=np.int64)  # first and last mesh half-edge of each side
    lasts = np.empty(2 * edge_count, dtype=np.int64)
    ends[0::2], lasts[0::2] = head, tail
    ends[1::2], lasts[1::2] = sides.twin[tail], sides.twin[head]
    side_of = np.full(len(is_rim), -1, dtype=np.int64)
    side_of[ends] = np.arange(2 * edge_count)
    following = side_of[onward[lasts]]
    before = np.empty_like(following)
    before[following] = np.arange(2 * edge_count)

    fans, origin = np.unique(sides.fan[ends], return_inverse=True)
    mesh_vertex_of_fan = np.empty(sides.fan_count, dtype=np.int64)
    mesh_vertex_of_fan[sides.fan] = sides.origin
    vertex_ids = mesh_vertex_of_fan[fans]

    chain_start = start + np.arange(edge_count + 1)  # each chain has one vertex more than edges
    chain = np.empty(len(order) + edge_count, dtype=np.int64)
    at = np.arange(len(order)) + np.repeat(np.arange(edge_count), np.diff(start))
    chain[at] = sides.origin[order]
    chain[chain_start[1:] - 1] = sides.origin[sides.twin[tail]]

    face = face_of[ends]
    loop, first, is_hole = _loops(
        following, face, faces, *_sweep(vertices_mm, chain, chain_start, faces, face)
    )
    curves = fit_curves(vertices_mm, chain, chain_start, faces, face)
    creases = find_creases(mesh, sides, order, start, faces, face_of)
    shells = components(len(face_of) // 3, np.arange(len(face_of)) // 3, sides.twin // 3)
    shell_count = int(shells.max(initial=-1)) + 1
    characteristic = sides.fan_count - len(face_of) // 2 + len(face_of) // 3
    return Boundary(
        vertex_ids=vertex_ids.astype(np.int32),
        vertices_mm=vertices_mm[vertex_ids],
        origin=origin.ravel().astype(np.int32),
        next=following.astype(np.int32),
        prev=before.astype(np.int32),
        face=face.astype(np.int32),
        loop=loop.astype(np.int32),
        first=first.astype(np.int32),
        loop_face=face[first].astype(np.int32),
        is_hole=is_hole,
        chain_start=chain_start.astype(np.int32),
        chain=chain.astype(np.int32),
        curve=curves.curve,
        centre_mm=curves.centre_mm,
        axis=curves.axis,
        radius_mm=curves.radius_mm,
        crease=creases.crease,
        angle_rad=creases.angle_rad,
        shell_count=shell_count,
        genus=shell_count - characteristic // 2,
    )


def _chains(
    sides: HalfEdges, onward: IntArray, members: IntArray, *, is_vertex: BoolArray
) -> tuple[IntArray, IntArray]:
    """Return mesh half-edges edge by edge, in order, and the start of each edge (e+1,)."""
    if len(members) == 0:
        return members, np.zeros(1, dtype=np.int64)
    local = np.full(len(onward), -1, dtype=np.int64)
    local[members] = np.arange(len(members))
    end_fan = sides.fan[onward[members]]
    successor = np.where(is_vertex[end_fan], -1, local[onward[members]])
    linked = successor >= 0
    run = components(len(members), np.nonzero(linked)[0], successor[linked])
    run_count = int(run.max()) + 1
    is_open = np.zeros(run_count, dtype=bool)
    is_open[run[~linked]] = True
    # an edge that closes on itself is cut at the lowest mesh vertex on it
    by_origin = np.lexsort((sides.origin[members], run))
    lowest = by_origin[np.searchsorted(run[by_origin], np.arange(run_count))]
    entry = np.full(len(members), -1, dtype=np.int64)
    entry[successor[linked]] = np.nonzero(linked)[0]
    successor[entry[lowest[~is_open]]] = -1
    _, steps = rank_chains(successor)
    # edges in the order of their first mesh half-edge, so that the numbering is deterministic
    rank = np.empty(run_count, dtype=np.int64)
    rank[np.argsort(first_of_each(run, run_count), kind="stable")] = np.arange(run_count)
    order = np.lexsort((-steps, rank[run]))
    start = np.concatenate([[0], np.cumsum(np.bincount(rank[run], minlength=run_count))])
    return members[order], start


def _sweep(
    vertices_mm: FloatArray,
    chain: IntArray,
    chain_start: IntArray,
    faces: Sequence[Face],
    face: IntArray,
) -> tuple[FloatArray, FloatArray]:
    """Return each half-edge's length, and the area it sweeps round its face's mean normal."""
    if len(face) == 0:
        return np.zeros(0), np.zeros(0)
    points = vertices_mm[chain]
    steps = np.diff(points, axis=0)
    inner = np.ones(len(steps), dtype=bool)
    inner[chain_start[1:-1] - 1] = False
    edge = np.repeat(np.arange(len(chain_start) - 1), np.diff(chain_start) - 1)
    lengths = np.bincount(edge, weights=np.linalg.norm(steps, axis=1)[inner])
    about = np.array([f.centre_mm for f in faces])
    normals = np.array([f.normal for f in faces])
    swept = np.empty(len(face))
    for side, sign in ((0, 1.0), (1, -1.0)):
        mine = face[side::2]
        spoke = points[:-1][inner] - about[mine][edge]
        doubled = (np.cross(spoke, steps[inner]) * normals[mine][edge]).sum(axis=1)
        swept[side::2] = sign * np.bincount(edge, weights=doubled) / 2
    return np.repeat(lengths, 2), swept


def _loops(
    following: IntArray,
    face: IntArray,
    faces: Sequence[Face],
    lengths: FloatArray,
    swept: FloatArray,
) -> tuple[IntArray, IntArray, BoolArray]:
    """Return the loop of each half-edge, a half-edge of each loop, and a mask of the holes.

    Loops are numbered by face, the outer one first.
    """
    if len(following) == 0:
        none = np.zeros(0, dtype=np.int64)
        return none, none, np.zeros(0, dtype=bool)
    raw = components(len(following), np.arange(len(following)), following)
    count = int(raw.max()) + 1
    first = first_of_each(raw, count)
    loop_face = face[first]
    flat = np.array([f.kind == "plane" for f in faces])[loop_face]
    size = np.where(flat, np.bincount(raw, weights=swept), np.bincount(raw, weights=lengths))
    order = np.lexsort((first, -size, loop_face))
    rank = np.empty(count, dtype=np.int64)
    rank[order] = np.arange(count)
    sorted_faces = loop_face[order]
    is_hole = np.concatenate([[False], sorted_faces[1:] == sorted_faces[:-1]])
    return rank[raw], first[order], is_hole
