"""A solid's convex hull in facets, the surface that a table can touch, with neighbours.

The table touches the hull alone (references.md P2.1). Qhull answers in triangles; those that lie in
one plane, up to what single precision in an STL file blurs, are one facet here.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from controller.arrays import FloatArray, IntArray
from controller.memory import give_back

from ..graph import components
from ..large import AT_ONCE

SINGLE = float(np.finfo(np.float32).eps)  # STL files hold single precision
BLUR = 8.0  # in single precisions: how far corners of one plane stray from it
SHORT = 16.0  # in blurs: shorter sides have no direction of their own


@dataclass(frozen=True, eq=False, slots=True)
class Hull:
    """The convex hull of a solid as seen from its centre of mass, in the axes of the CAD frame.

    Attributes
    ----------
    corners_mm : (v, 3) from the centre of mass
    triangles : (t, 3) anticlockwise seen from outside
    neighbours : (t, 3) triangle beyond the side that is opposite to each corner
    facet : (t,) facet each triangle is part of
    normals : (f, 3) outward
    heights_mm : (f,) heights of the centre of mass above each facet
    areas_mm2 : (f,)
    edge_ends : (e, 2) corners of the edges between two facets, in the order of the first's outline
    edge_facets : (e, 2) the two facets
    blur_mm : largest distance of corners from the plane they share
    """

    corners_mm: FloatArray
    triangles: IntArray
    neighbours: IntArray
    facet: IntArray
    normals: FloatArray
    heights_mm: FloatArray
    areas_mm2: FloatArray
    edge_ends: IntArray
    edge_facets: IntArray
    blur_mm: float

    @property
    def count(self) -> int:
        """Number of facets."""
        return len(self.areas_mm2)

    def extent_mm(self, directions: FloatArray) -> FloatArray:
        """Return the height (n,) of the centre of mass with each of the directions (n, 3) down."""
        return np.asarray((directions @ self.corners_mm.T).max(axis=1))


def hull_of(points_mm: FloatArray, centre_mm: FloatArray) -> Hull:
    """Return the hull of points (n, 3) about a centre of mass (3,), both in the CAD frame.

    Raises
    ------
    ValueError : the centre is outside of the hull, where no centre of mass can be
    """
    shell = ConvexHull(points_mm)  # qhull's defaults triangulate facets that hold many corners
    if len(shell.simplices) > AT_ONCE:
        give_back()  # what qhull took, several times its answer
    renumber = np.full(len(points_mm), -1, dtype=np.int64)
    renumber[shell.vertices] = np.arange(len(shell.vertices))
    corners = np.asarray(points_mm, dtype=np.float64)[shell.vertices] - centre_mm
    triangles = renumber[shell.simplices]
    neighbours = shell.neighbors.astype(np.int64)
    outward = shell.equations[:, :3]
    blur = BLUR * SINGLE * float(np.abs(points_mm[shell.vertices]).max())
    beyond = float((outward @ centre_mm + shell.equations[:, 3]).max())
    if beyond > max(blur, 1e-9):
        raise ValueError(f"the centre of mass is {beyond:.4g} mm outside of the part's hull")

    a, b, c = corners[triangles[:, 0]], corners[triangles[:, 1]], corners[triangles[:, 2]]
    doubled = np.cross(b - a, c - a)
    inside_out = np.einsum("ij,ij->i", doubled, outward) < 0
    triangles[inside_out] = triangles[inside_out][:, [0, 2, 1]]
    neighbours[inside_out] = neighbours[inside_out][:, [0, 2, 1]]
    doubled[inside_out] *= -1

    facet = _join(corners, triangles, neighbours, outward, doubled, blur)
    area_vectors = np.column_stack([np.bincount(facet, doubled[:, i]) for i in range(3)]) / 2
    areas = np.linalg.norm(area_vectors, axis=1)
    normals = _outward(facet, outward)
    sound = areas > blur * blur
    normals[sound] = area_vectors[sound] / areas[sound, None]
    tops = np.full(len(areas), -np.inf)
    reach = np.einsum("tij,tj->ti", corners[triangles], normals[facet]).max(axis=1)
    np.maximum.at(tops, facet, reach)

    here = np.repeat(np.arange(len(triangles)), 3)
    there = neighbours.ravel()
    own = (facet[here] != facet[there]) & (here < there)
    corner = np.tile(np.arange(3), len(triangles))[own]
    ends = np.column_stack(
        [triangles[here[own], (corner + 1) % 3], triangles[here[own], (corner + 2) % 3]]
    )
    pairs = np.column_stack([facet[here[own]], facet[there[own]]])
    return Hull(corners, triangles, neighbours, facet, normals, tops, areas, ends, pairs, blur)


def _outward(facet: IntArray, outward: FloatArray) -> FloatArray:
    """Return qhull's normal of one triangle of each facet (f, 3)."""
    _, first = np.unique(facet, return_index=True)
    return np.array(outward[first])


def _join(
    corners: FloatArray,
    triangles: IntArray,
    neighbours: IntArray,
    outward: FloatArray,
    doubled: FloatArray,
    blur: float,
) -> IntArray:
    """Return the facet of each triangle (t,); neighbours in one plane share it.

    The plane is the larger triangle's, since a sliver's own is noise. A run of facets that bends
    little from one to the next would join end to end; such a group is taken apart again.
    """
    count = len(triangles)
    here = np.repeat(np.arange(count), 3)
    there = neighbours.ravel()
    size = np.linalg.norm(doubled, axis=1)
    apex = triangles.ravel()  # of the smaller triangle, beyond the side it shares with the larger
    shared = corners[triangles[here, (np.tile(np.arange(3), count) + 1) % 3]]
    off = np.abs(np.einsum("ij,ij->i", outward[there], corners[apex] - shared))
    flat = (off <= blur) & (size[here] <= size[there])
    same = np.einsum("ij,ij->i", outward[here], outward[there]) > 1 - 1e-15
    group = components(count, here[flat | same], there[flat | same])
    weights = np.column_stack([np.bincount(group, doubled[:, i]) for i in range(3)])
    weights = weights / np.maximum(np.linalg.norm(weights, axis=1), 1e-300)[:, None]
    along = np.einsum("tij,tj->ti", corners[triangles], weights[group])
    low, high = np.full(len(weights), np.inf), np.full(len(weights), -np.inf)
    np.minimum.at(low, group, along.min(axis=1))
    np.maximum.at(high, group, along.max(axis=1))
    bent = (high - low > 4 * blur)[group]
    if not bent.any():
        return group
    keep = (flat & ~bent[here] & ~bent[there]) | same
    return components(count, here[keep], there[keep])
