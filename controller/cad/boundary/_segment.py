"""Surfaces from triangles: planes as coplanar facets, curved walls as smooth runs of strips.

A tessellated bore is many narrow coplanar strips; a plane is a facet that is much larger than
the strips it may run into. So planes are taken first, and what is left is grown across edges
that are nearly smooth.
"""

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ._types import NO_DIRECTION, Face

Array = NDArray[np.float64]

COPLANAR_RAD = np.radians(0.2)
SMOOTH_RAD = np.radians(22.0)  # strips of a bore of 17 segments and more count as smooth
STRIP_RATIO = 4.0  # a plane is this many times larger than the strips round it


def _components(count: int, pairs: NDArray[np.int64]) -> NDArray[np.int32]:
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int32)


def find_faces(mesh: trimesh.Trimesh) -> tuple[tuple[Face, ...], NDArray[np.int32]]:
    """Return the surfaces of a mesh and, per triangle, the id of its surface (n,)."""
    count = len(mesh.faces)
    adjacency = np.asarray(mesh.face_adjacency)
    angles = np.asarray(mesh.face_adjacency_angles)
    facet = _components(count, adjacency[angles < COPLANAR_RAD])
    areas = np.bincount(facet, weights=mesh.area_faces)
    smooth = (angles >= COPLANAR_RAD) & (angles < SMOOTH_RAD)
    a, b = facet[adjacency[smooth, 0]], facet[adjacency[smooth, 1]]
    largest_neighbour = np.zeros(len(areas))
    np.maximum.at(largest_neighbour, a, areas[b])
    np.maximum.at(largest_neighbour, b, areas[a])
    touches_smooth = largest_neighbour > 0
    is_plane = ~touches_smooth | (areas > STRIP_RATIO * largest_neighbour)
    curved = ~is_plane[facet]
    joins = adjacency[smooth & curved[adjacency[:, 0]] & curved[adjacency[:, 1]]]
    flat = adjacency[angles < COPLANAR_RAD]
    group = _split_pairs(_components(count, np.vstack([joins, flat])), facet)
    order = np.argsort(-np.bincount(group, weights=mesh.area_faces), kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    face_of_triangle = rank[group].astype(np.int32)
    by_face = np.argsort(face_of_triangle, kind="stable")
    runs = np.split(by_face, np.cumsum(np.bincount(face_of_triangle))[:-1])
    faces = tuple(_describe(i, mesh, run) for i, run in enumerate(runs))
    return faces, face_of_triangle


def _split_pairs(group: NDArray[np.int32], facet: NDArray[np.int32]) -> NDArray[np.int32]:
    """Take groups of two facets apart (n,): a roof or a slope is two planes, never a curve."""
    _, first = np.unique(facet, return_index=True)
    strip_counts = np.bincount(group[first])
    apart = np.where(strip_counts[group] == 2, group.max() + 1 + facet, group)
    return np.asarray(np.unique(apart, return_inverse=True)[1], dtype=np.int32)


def _describe(face_id: int, mesh: trimesh.Trimesh, triangles: NDArray[np.int64]) -> Face:
    normals = np.asarray(mesh.face_normals)[triangles]
    weights = np.asarray(mesh.area_faces)[triangles]
    corners = np.asarray(mesh.triangles)[triangles]
    area = float(weights.sum())
    centre = np.average(corners.mean(axis=1), axis=0, weights=np.maximum(weights, 1e-12))
    mean = (normals * weights[:, None]).sum(axis=0)
    if np.linalg.norm(mean) > 0.999 * area:
        normal = mean / np.linalg.norm(mean)
        return Face(
            face_id, "plane", area, normal, NO_DIRECTION, centre, 0.0, 0.0, 0.0, concave=False
        )
    length = float(np.linalg.norm(mean))
    direction = mean / length if length > 1e-6 * area else NO_DIRECTION
    fit = _fit_cylinder(normals, weights, corners)
    if fit is not None:
        axis, on_axis, radius, concave = fit
        return Face(
            face_id, "cylinder", area, direction, axis, on_axis, radius, 0.0, 0.0, concave=concave
        )
    return Face(
        face_id, "freeform", area, direction, NO_DIRECTION, centre, 0.0, 0.0, 0.0, concave=False
    )


def _fit_cylinder(
    normals: Array, weights: Array, corners: Array
) -> tuple[Array, Array, float, bool] | None:
    spread, vectors = np.linalg.eigh((normals * weights[:, None]).T @ normals / weights.sum())
    if spread[0] > 1e-3 or spread[1] < 0.02:
        return None
    axis, e1, e2 = vectors[:, 0], vectors[:, 1], vectors[:, 2]
    points = corners.reshape(-1, 3)
    uv = np.column_stack([points @ e1, points @ e2])
    system = np.column_stack([2 * uv, np.ones(len(uv))])
    solution, *_ = np.linalg.lstsq(system, (uv**2).sum(axis=1), rcond=None)
    centre_uv = solution[:2]
    radius = float(np.sqrt(max(solution[2] + centre_uv @ centre_uv, 0.0)))
    residual = np.abs(np.linalg.norm(uv - centre_uv, axis=1) - radius)
    if radius == 0 or float(residual.max()) > 0.02 * radius + 0.02:
        return None
    along = float((points @ axis).mean())
    on_axis = axis * along + e1 * centre_uv[0] + e2 * centre_uv[1]
    outward = ((corners.mean(axis=1) - on_axis) * normals).sum(axis=1)
    return axis, on_axis, radius, bool(np.average(outward, weights=weights) < 0)
