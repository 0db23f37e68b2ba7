"""Checks of a boundary: its pointers, and Euler-Poincare, counted apart from the edge list."""

from collections.abc import Sequence

import numpy as np
import trimesh
from numpy.typing import NDArray

from controller.arrays import IntArray

from ...graph import components
from .._types import Boundary
from .halfedges import half_edges, next_on_rim


def face_genera(
    mesh: trimesh.Trimesh, face_of_triangle: NDArray[np.integer], face_count: int
) -> IntArray:
    """Return the number of handles of each surface (f,), counted on the mesh alone.

    A plane, a bore's wall and a ball have none; a surface closed to a ring, such as a whole torus,
    has one.

    Parameters
    ----------
    mesh : closed, every half-edge with its twin
    face_of_triangle : (t,) face of each triangle, 0 to ``face_count`` - 1
    face_count : f; faces without a triangle count as well
    """
    sides = half_edges(np.asarray(mesh.faces))
    face_of = np.repeat(np.asarray(face_of_triangle, dtype=np.int64), 3)
    other = face_of[sides.twin]
    is_rim = face_of != other
    touches_rim = np.zeros(sides.fan_count, dtype=bool)
    touches_rim[sides.fan[is_rim]] = True
    face_of_fan = np.empty(sides.fan_count, dtype=np.int64)
    face_of_fan[sides.fan] = face_of
    inner_vertices = np.bincount(face_of_fan[~touches_rim], minlength=face_count)
    inner_edges = np.bincount(face_of[~is_rim], minlength=face_count) // 2
    characteristic = np.bincount(face_of[::3], minlength=face_count) - inner_edges + inner_vertices
    rim = np.nonzero(is_rim)[0]
    cycle = components(len(face_of), rim, next_on_rim(sides, is_rim)[rim])
    _, one_of_each = np.unique(cycle[rim], return_index=True)
    rims = np.bincount(face_of[rim[one_of_each]], minlength=face_count)
    inside = np.nonzero(~is_rim)[0]
    piece = components(len(face_of) // 3, inside // 3, sides.twin[inside] // 3)
    _, one_of_each = np.unique(piece, return_index=True)
    pieces = np.bincount(face_of[::3][one_of_each], minlength=face_count)
    return (2 * pieces - rims - characteristic) // 2


def euler_defect(boundary: Boundary, genera: Sequence[int] | NDArray[np.integer]) -> int:
    """Return the shortfall of the Euler-Poincare formula, 0 for a valid boundary.

    Vertices - edges + faces - holes = 2 (shells - handles), where a face with loops counts
    2 - 2 x its own handles - its loops: a disc 1, the wall of a bore 0, a ball 2.

    Parameters
    ----------
    boundary : boundary of a solid
    genera : (f,) handles of each surface itself, as `face_genera` counts them; 0 for all surfaces
        unless one closes round a ring on its own
    """
    handles = np.asarray(genera, dtype=np.int64)
    loops = np.bincount(boundary.loop_face, minlength=len(handles))
    faces = int((2 - 2 * handles - loops).sum())
    cells = len(boundary.vertex_ids) - boundary.edge_count + faces
    return cells - 2 * (boundary.shell_count - boundary.genus)


def check_boundary(boundary: Boundary) -> list[str]:
    """Return the faults of a boundary's pointers, one sentence each; empty for a valid boundary."""
    b = boundary
    count = len(b.origin)
    here = np.arange(count)
    faults = []
    if count != 2 * b.edge_count:
        faults.append(f"{count} half-edges on {b.edge_count} edges")
        return faults
    if not (np.array_equal(b.prev[b.next], here) and np.array_equal(b.next[b.prev], here)):
        faults.append("next and prev are not each other's inverse")
    if not np.array_equal(b.origin[b.next], b.origin[here ^ 1]):
        faults.append("a half-edge does not start where the one before it ends")
    if not np.array_equal(b.loop[b.next], b.loop):
        faults.append("a half-edge and its next are on different loops")
    if not np.array_equal(b.loop_face[b.loop], b.face):
        faults.append("a half-edge and its loop are on different faces")
    if (b.face == b.face[here ^ 1]).any():
        faults.append("an edge has the same face on both sides")
    if not np.array_equal(b.loop[b.first], np.arange(len(b.first))):
        faults.append("a loop's first half-edge is on another loop")
    if count and len(np.unique(components(count, here, b.next))) != len(b.first):
        faults.append("a loop falls apart, or two are one")
    outer = np.bincount(b.loop_face[~b.is_hole]) if len(b.first) else np.zeros(0, dtype=int)
    if (outer[np.unique(b.loop_face)] != 1).any():
        faults.append("a face has no outer loop, or several")
    if count:
        begins, ends = b.chain[b.chain_start[:-1]], b.chain[b.chain_start[1:] - 1]
        if not np.array_equal(begins, b.vertex_ids[b.origin[0::2]]) or not np.array_equal(
            ends, b.vertex_ids[b.origin[1::2]]
        ):
            faults.append("a chain does not run from vertex to vertex")
    return faults
