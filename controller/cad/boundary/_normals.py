"""Outward normals of recognised surfaces at given points, exact where the facets are not."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from controller.arrays import FloatArray, inner, lengths

from ._types import Face

TINY_MM = 1e-9  # a point nearer than this to an axis or a centre has no usable direction


def unit(vectors: FloatArray) -> FloatArray:
    """Return vectors (..., 3) at length 1; those without a length stay zeros."""
    size = lengths(vectors)[..., None]
    return np.asarray(np.divide(vectors, size, out=np.zeros_like(vectors), where=size > 0))


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
    plane = np.array([face.kind == "plane" for face in faces])[face_ids]
    if plane.any():
        normals[plane] = np.array([face.normal for face in faces])[face_ids[plane]]
    rest = np.flatnonzero(~plane)
    if len(rest):
        normals[rest] = _round_normals(faces, face_ids[rest], points_mm[rest], normals[rest])
    return normals


def _round_normals(
    faces: Sequence[Face],
    face_ids: NDArray[np.integer],
    points_mm: FloatArray,
    normals: FloatArray,
) -> FloatArray:
    """Return the outward normals of curved surfaces at points on them."""
    wall, cone, ball, ring = (
        np.array([face.kind == kind for face in faces])[face_ids]
        for kind in ("cylinder", "cone", "sphere", "torus")
    )
    axes = np.array([face.axis for face in faces])[face_ids]
    centres = np.array([face.centre_mm for face in faces])[face_ids]
    signs = np.where([face.concave for face in faces], -1.0, 1.0)[face_ids][:, None]
    offsets = points_mm - centres
    radial = offsets - inner(offsets, axes)[:, None] * axes
    far = lengths(radial) > TINY_MM
    wall &= far
    normals[wall] = unit(radial[wall]) * signs[wall]
    cone &= far
    if cone.any():
        half = np.array([face.half_angle_rad for face in faces])[face_ids[cone]][:, None]
        slanted = unit(radial[cone]) * np.cos(half) - axes[cone] * np.sin(half)
        normals[cone] = slanted * signs[cone]
    ball &= lengths(offsets) > TINY_MM
    normals[ball] = unit(offsets[ball]) * signs[ball]
    ring &= far
    if ring.any():
        large = np.array([face.radius_mm for face in faces])[face_ids[ring]][:, None]
        from_tube = offsets[ring] - unit(radial[ring]) * large
        inside = lengths(from_tube) > TINY_MM
        rows = np.nonzero(ring)[0][inside]
        normals[rows] = unit(from_tube[inside]) * signs[rows]
    return normals
