"""Outward normals of recognised surfaces at given points, exact where the facets are not."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from controller.arrays import FloatArray

from ._types import Face

TINY_MM = 1e-9  # nearer than this to an axis or a centre no direction is worth having


def unit(vectors: FloatArray) -> FloatArray:
    """Return vectors (..., 3) at length 1; those without a length stay zeros."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0))


def surface_normals(
    faces: Sequence[Face],
    face_ids: NDArray[np.integer],
    points_mm: FloatArray,
    facet_normals: FloatArray,
) -> FloatArray:
    """Return the outward normals of surfaces at points on them.

    Parameters
    ----------
    faces : all surfaces of the part
    face_ids : (n,) surface of each point
    points_mm : (n, 3) in the CAD frame
    facet_normals : (n, 3) taken where the surface has no formula, or none at that point

    Returns
    -------
    (n, 3) unit normals
    """
    normals = np.array(facet_normals, dtype=np.float64)
    if len(face_ids) == 0:
        return normals
    kinds = np.array([face.kind for face in faces])[face_ids]
    axes = np.array([face.axis for face in faces])[face_ids]
    centres = np.array([face.centre_mm for face in faces])[face_ids]
    signs = np.where([face.concave for face in faces], -1.0, 1.0)[face_ids][:, None]
    offsets = points_mm - centres
    radial = offsets - (offsets * axes).sum(axis=1, keepdims=True) * axes
    far = np.linalg.norm(radial, axis=1) > TINY_MM
    plane = kinds == "plane"
    if plane.any():
        normals[plane] = np.array([face.normal for face in faces])[face_ids[plane]]
    wall = far & (kinds == "cylinder")
    normals[wall] = unit(radial[wall]) * signs[wall]
    cone = far & (kinds == "cone")
    if cone.any():
        half = np.array([face.half_angle_rad for face in faces])[face_ids[cone]][:, None]
        slanted = unit(radial[cone]) * np.cos(half) - axes[cone] * np.sin(half)
        normals[cone] = slanted * signs[cone]
    ball = kinds == "sphere"
    ball &= np.linalg.norm(offsets, axis=1) > TINY_MM
    normals[ball] = unit(offsets[ball]) * signs[ball]
    ring = far & (kinds == "torus")
    if ring.any():
        large = np.array([face.radius_mm for face in faces])[face_ids[ring]][:, None]
        from_tube = offsets[ring] - unit(radial[ring]) * large
        inside = np.linalg.norm(from_tube, axis=1) > TINY_MM
        rows = np.nonzero(ring)[0][inside]
        normals[rows] = unit(from_tube[inside]) * signs[rows]
    return normals
