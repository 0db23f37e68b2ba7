"""Non-planar rims, where a slope, a shaft or another bore cuts a cylinder."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from controller.arrays import FloatArray, IndexArray
from controller.cad import Crease, Solid, surface_normals

from .._types import Rim, RimCourse, rim_directions

# Where the surface that cuts a cylinder is so flat to its axis, the rim runs along the wall: a
# small step of the wall moves it far along the axis, and it shows no radius. 0.25 is 14 degrees.
MIN_SLOPE_COS: Final = 0.25


def course_rims(
    solid: Solid,
    faces: Sequence[int],
    half_edges: Sequence[int],
    axis: FloatArray,
    centre_mm: FloatArray,
    radius_mm: float,
    *,
    is_hole: bool,
) -> list[Rim]:
    """Return the non-planar outer rims of a wall.

    Parameters
    ----------
    solid : the part
    faces : faces of the wall
    half_edges : half-edges of the wall's edges, on the wall's side
    axis, centre_mm, radius_mm : (3,) axis, (3,) centre and radius of the wall
    is_hole : True if the wall faces its axis
    """
    b = solid.boundary
    vertices = np.asarray(solid.mesh.vertices, dtype=np.float64)
    u, v = rim_directions(axis)
    found = []
    for loop in _outer_loops(solid, set(faces), half_edges):
        ids, beyond = _points(solid, loop)
        offset = vertices[ids] - centre_mm
        height = offset @ axis
        angle = np.arctan2(offset @ v, offset @ u)
        steps = (np.roll(angle, -1) - angle + np.pi) % (2 * np.pi) - np.pi
        if not (np.all(steps > 0) or np.all(steps < 0)):
            continue  # the loop turns back, or runs along the wall
        normals = _normals(solid, ids, beyond)
        if np.abs(normals @ axis).min() < MIN_SLOPE_COS:
            continue
        middle = (float(height.min()) + float(height.max())) / 2
        out = axis if float((normals @ axis).mean()) > 0 else -axis
        side = np.cross(out, u)
        turn = np.mod(np.arctan2(offset @ side, offset @ u), 2 * np.pi)
        order = np.argsort(turn)
        course = RimCourse(
            turn[order],
            ((height - middle) * float(out @ axis))[order],
            np.hypot(offset @ u, offset @ side)[order],
            normals[order],
        )
        names, counts = np.unique(beyond, return_counts=True)
        found.append(
            Rim(
                centre_mm=centre_mm + middle * axis,
                axis=out,
                radius_mm=radius_mm,
                start=u,
                sweep_rad=2 * np.pi,
                wall=int(b.face[loop[0]]),
                beyond=int(names[counts.argmax()]),
                is_hole=is_hole,
                course=course,
            )
        )
    return sorted(found, key=lambda rim: (rim.beyond, float(rim.centre_mm @ axis)))


def _outer_loops(solid: Solid, inside: set[int], half_edges: Sequence[int]) -> list[list[int]]:
    """Return the closed loops of a wall's half-edges that consist of outer edges only."""
    b = solid.boundary
    border = [h for h in half_edges if int(b.face[h ^ 1]) not in inside]
    by_origin: dict[int, list[int]] = {}
    for h in border:
        by_origin.setdefault(int(b.origin[h]), []).append(h)
    loops, seen = [], set[int]()
    for first in border:
        run, here = [], first
        while here not in seen:
            seen.add(here)
            run.append(here)
            after = by_origin.get(int(b.origin[here ^ 1]), [])
            if len(after) != 1:
                break
            here = after[0]
        if run and here == first and all(b.crease[h // 2] == Crease.CONVEX for h in run):
            loops.append(run)
    return loops


def _points(solid: Solid, loop: list[int]) -> tuple[IndexArray, IndexArray]:
    """Return the mesh vertices (n,) round a loop, and the face beyond the edge at each."""
    b = solid.boundary
    ids, beyond = [], []
    for h in loop:
        chain = b.chain_of(h // 2)
        run = chain[:-1] if h % 2 == 0 else chain[:0:-1]
        ids.append(run.astype(np.intp))
        beyond.append(np.full(len(run), int(b.face[h ^ 1]), dtype=np.intp))
    return np.concatenate(ids), np.concatenate(beyond)


def _normals(solid: Solid, ids: IndexArray, beyond: IndexArray) -> FloatArray:
    """Return the normals (n, 3) at mesh vertices of the faces beyond."""
    triangles = np.asarray(solid.mesh.faces)
    facets = np.zeros((len(ids), 3))
    for face in np.unique(beyond).tolist():
        own = np.flatnonzero(np.asarray(solid.face_of_triangle) == face)
        total = np.zeros((len(solid.mesh.vertices), 3))
        weighted = np.asarray(solid.mesh.face_normals)[own] * solid.mesh.area_faces[own, None]
        for corner in range(3):
            np.add.at(total, triangles[own, corner], weighted)
        mine = beyond == face
        facets[mine] = total[ids[mine]]
    facets /= np.maximum(np.linalg.norm(facets, axis=1, keepdims=True), 1e-12)
    return surface_normals(solid.faces, beyond, np.asarray(solid.mesh.vertices)[ids], facets)
