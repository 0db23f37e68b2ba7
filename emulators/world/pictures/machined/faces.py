"""The triangles of each machined face, and the direction of its tool.

A plane was milled along a straight line, a curved face was turned about the axis that its normals
are square to.
"""

import itertools
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ...shapes import Array
from ..geometry import Surface

_FLAT_COS: Final = 1.0 - 1e-5  # facets of one plane, 0.26 degrees
_LARGE: Final = 5.0  # a facet this many times as large as the curved ones beside it is a plane
_SMOOTH_COS: Final = 0.9  # facets of one curved face, as shading has it


@dataclass(frozen=True, slots=True, eq=False)
class Faces:
    """The faces of a surface.

    Attributes
    ----------
    of_triangle : (m,) number of the face of each triangle
    across : (k, 3) direction of each face, from tool mark to tool mark
    along : (k, 3) at right angles to it; tool marks run along this or around
    middle_mm : (k, 3) a place on the axis of each turned face
    radius_mm : (k,) radius of turned faces, in the mean; 0 of milled ones
    """

    of_triangle: NDArray[np.intp]
    across: Array
    along: Array
    middle_mm: Array
    radius_mm: Array

    def places_mm(self, face: NDArray[np.intp], points_mm: Array) -> tuple[Array, Array]:
        """Return the positions of points across tool marks and along them [mm], (n,) each.

        On a turned face it is the arc length: an object on it has the same length anywhere.

        Parameters
        ----------
        face : (n,) number of the face of each point
        points_mm : (n, 3) in the part frame
        """
        across, along = self.across[face], self.along[face]
        third = np.cross(across, along)
        off = points_mm - self.middle_mm[face]
        across_mm: Array = np.einsum("ij,ij->i", points_mm, across)
        u, v = np.einsum("ij,ij->i", off, along), np.einsum("ij,ij->i", off, third)
        radius_mm = self.radius_mm[face]
        along_mm: Array = np.where(radius_mm > 0.0, radius_mm * np.arctan2(v, u), u + v)
        return across_mm, along_mm


def machined_faces(surface: Surface, rng: np.random.Generator) -> Faces:
    """Return the faces of a part.

    Parameters
    ----------
    surface : surface of the part
    rng : draws which way each plane was milled
    """
    a, b, c = (surface.vertices_mm[surface.faces[:, i]] for i in range(3))
    cross = np.cross(b - a, c - a)
    double_mm2 = np.linalg.norm(cross, axis=1)
    normals = cross / np.maximum(double_mm2, 1e-12)[:, None]
    pairs = _neighbours(surface.faces)
    dot = np.einsum("ij,ij->i", normals[pairs[:, 0]], normals[pairs[:, 1]])
    facet = _joined(pairs[dot > _FLAT_COS], len(normals))
    bent = (dot > _SMOOTH_COS) & (dot <= _FLAT_COS)
    sizes = np.bincount(facet, weights=double_mm2).astype(float)
    is_plane = _planes(facet, facet[pairs[bent]], sizes)[facet]
    curved = bent & ~(is_plane[pairs[:, 0]] | is_plane[pairs[:, 1]])
    of_triangle = _joined(pairs[curved | (dot > _FLAT_COS)], len(normals))
    count = int(of_triangle.max()) + 1
    across, along = np.empty((count, 3)), np.empty((count, 3))
    middle_mm, radius_mm = np.zeros((count, 3)), np.zeros(count)
    centres_mm = (a + b + c) / 3.0
    for face in range(count):
        mine = of_triangle == face
        weighted = normals[mine] * double_mm2[mine, None]
        values, axes = np.linalg.eigh(weighted.T @ normals[mine])
        if values[1] > 0.01 * values[2]:  # normals lie in a plane or all round: turned
            across[face], along[face] = axes[:, 0], axes[:, 1]
            middle_mm[face], radius_mm[face] = _axis(
                centres_mm[mine], normals[mine], double_mm2[mine], axes[:, 0]
            )
        else:
            angle = rng.uniform(0.0, np.pi)
            across[face] = np.cos(angle) * axes[:, 0] + np.sin(angle) * axes[:, 1]
            along[face] = -np.sin(angle) * axes[:, 0] + np.cos(angle) * axes[:, 1]
    return Faces(of_triangle, across, along, middle_mm, radius_mm)


def _axis(centres_mm: Array, normals: Array, weights: Array, axis: Array) -> tuple[Array, float]:
    """Return a place on the axis that a turned face goes round, and its mean radius.

    Parameters
    ----------
    centres_mm, normals : (n, 3) centres and normals of its triangles
    weights : (n,) their areas
    axis : (3,) its direction
    """
    tangents = np.cross(axis, normals)
    length = np.linalg.norm(tangents, axis=1)
    good = length > 1e-3  # the end of a ball goes round nothing
    tangents = tangents[good] / length[good, None]
    root = np.sqrt(weights[good])
    # the normals meet on the axis: seen from there, every centre lies across its tangent
    found, *_ = np.linalg.lstsq(
        tangents * root[:, None],
        np.einsum("ij,ij->i", tangents, centres_mm[good]) * root,
        rcond=1e-6,
    )
    off = centres_mm - found
    off = off - np.outer(off @ axis, axis)
    return found, float(np.average(np.linalg.norm(off, axis=1), weights=weights))


def _planes(facet: NDArray[np.intp], bends: NDArray[np.intp], sizes: Array) -> NDArray[np.bool_]:
    """Return a mask of the facets that are planes, not pieces of a curved face, (k,).

    Parameters
    ----------
    facet : (m,) number of the facet of each triangle
    bends : (n, 2) facets that meet at so small an angle that shading hides it
    sizes : (k,) sizes of each facet
    """
    both = np.concatenate((bends, bends[:, ::-1]))
    both = both[np.argsort(both[:, 0], kind="stable")]
    first = np.searchsorted(both[:, 0], np.arange(facet.max() + 2))
    planes = np.ones(len(first) - 1, bool)
    for number, (start, end) in enumerate(itertools.pairwise(first)):
        if end > start:
            planes[number] = sizes[number] > _LARGE * np.median(sizes[both[start:end, 1]])
    return planes


def _neighbours(faces: NDArray[np.int32]) -> NDArray[np.intp]:
    """Return pairs of triangles that share a side, (n, 2)."""
    sides = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(faces)), 3)
    order = np.lexsort((sides[:, 1], sides[:, 0]))
    sides, owner = sides[order], owner[order]
    same = np.flatnonzero((sides[1:] == sides[:-1]).all(axis=1))
    return np.stack((owner[same], owner[same + 1]), axis=1)


def _joined(pairs: NDArray[np.intp], count: int) -> NDArray[np.intp]:
    ones = np.ones(len(pairs), bool)
    graph: Any = coo_matrix((ones, (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, labels = connected_components(graph, directed=False)
    return np.asarray(labels, np.intp)
