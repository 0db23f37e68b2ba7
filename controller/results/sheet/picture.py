"""A part at rest, drawn in grey from a slanting view: for the eye, not for measuring."""

import numpy as np

from controller.arrays import BoolArray, FloatArray, Grey, Int32Array
from controller.cad import Solid
from controller.imaging import RayCaster

from ..ray_drawing import FINER, cast, jumps, png_uri, smaller

# As wide as the page shows it, with the aspect of the drawings.
SIZE_PX = (420, 315)
AZIMUTH_RAD, ELEVATION_RAD = np.radians(-65.0), np.radians(30.0)
KEY_LIGHT = np.array([-0.35, -0.55, 0.76])
FILL_LIGHT = np.array([0.8, -0.45, 0.4])
PAPER, INK, SHADOW = 255.0, 40.0, 206.0
CREASE_RAD = np.radians(20.0)
# Rays to the light start this far off the surface, as a share of the part's size.
LIFT_MM = 1e-3


def rest_picture(solid: Solid, caster: RayCaster, R: FloatArray) -> str:
    """Return a picture of a part at rest as a data URI (PNG).

    Parameters
    ----------
    solid : the part
    caster : rays at its mesh, in the part frame
    R : (3, 3) its stable pose: CAD axes to upright
    """
    return png_uri(shade(solid, caster, R), compression=9)


def shade(solid: Solid, caster: RayCaster, R: FloatArray) -> Grey:
    """Return the picture, (height, width).

    Parameters
    ----------
    solid : the part
    caster : rays at its mesh, in the part frame
    R : (3, 3) its stable pose: CAD axes to upright
    """
    # all in the axes of the CAD frame, where rays are cast, about the centre of mass
    right, up, back = (axis @ R for axis in _axes())
    corners = np.asarray(solid.mesh.vertices) - solid.centroid_mm
    u, v = corners @ right, corners @ up
    width, height = (FINER * px for px in SIZE_PX)
    mm_per_px = 1.2 * max(np.ptp(u) / width, np.ptp(v) / height)
    # room to the right, where the shadow falls
    x = (np.arange(width) - 0.48 * width) * mm_per_px + (u.min() + u.max()) / 2
    y = (0.5 * height - np.arange(height)) * mm_per_px + (v.min() + v.max()) / 2
    size_mm = float(np.linalg.norm(np.ptp(corners, axis=0)))
    eye = solid.centroid_mm + 2 * size_mm * back
    origins = (eye + x[None, :, None] * right + y[:, None, None] * up).reshape(-1, 3)
    triangle, _ = cast(caster, origins, -back[None], (width, height))
    level = _light(solid, R, triangle.ravel())
    beside = np.flatnonzero(triangle < 0)
    table_mm = float((corners @ R[2]).min())
    level[beside[_is_shaded(solid, caster, R, origins[beside], -back, table_mm, size_mm)]] = SHADOW
    image = level.reshape(height, width)
    image = np.where(_creases(solid, triangle), INK, image)
    return np.asarray(np.clip(smaller(image.astype(np.float32)), 0, 255), dtype=np.uint8)


def _axes() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return right and up of the picture and the direction back to the eye, upright frame."""
    c, s = np.cos(ELEVATION_RAD), np.sin(ELEVATION_RAD)
    back = np.array([c * np.cos(AZIMUTH_RAD), c * np.sin(AZIMUTH_RAD), s])
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    return right, np.cross(back, right), back


def _light(solid: Solid, R: FloatArray, triangle: Int32Array) -> FloatArray:
    """Return grey levels (n,) of what the rays met; white where they met nothing."""
    normals = np.asarray(solid.mesh.face_normals)
    key = np.maximum(normals @ (KEY_LIGHT @ R / np.linalg.norm(KEY_LIGHT)), 0)
    fill = np.maximum(normals @ (FILL_LIGHT @ R / np.linalg.norm(FILL_LIGHT)), 0)
    level = 88 + 118 * key + 42 * fill
    return np.where(triangle >= 0, level[triangle], PAPER)


def _is_shaded(
    solid: Solid,
    caster: RayCaster,
    R: FloatArray,
    origins: FloatArray,
    direction: FloatArray,
    table_mm: float,
    size_mm: float,
) -> BoolArray:
    """Return which rays that miss the part meet its shadow on the table, (n,)."""
    heights = (origins - solid.centroid_mm) @ R[2] - table_mm
    spots = origins + (heights / -(direction @ R[2]))[:, None] * direction
    near = np.linalg.norm(spots - solid.centroid_mm, axis=1) < 2 * size_mm
    shaded = np.zeros(len(origins), dtype=bool)
    spots = spots[near] + LIFT_MM * size_mm * R[2]
    shaded[near] = caster.blocked(spots, KEY_LIGHT @ R)
    return shaded


def _creases(solid: Solid, triangle: Int32Array) -> BoolArray:
    """Return where the picture steps from one surface to another, or off the part."""
    face = np.where(triangle >= 0, solid.face_of_triangle[triangle], -1)
    normals = np.asarray(solid.mesh.face_normals)
    ink = np.zeros(face.shape, dtype=bool)
    for here, there in jumps(triangle):
        bend = np.einsum("ij,ij->i", normals[triangle[here]], normals[triangle[there]])
        off = (face[here] < 0) != (face[there] < 0)
        step = off | ((face[here] != face[there]) & (bend < np.cos(CREASE_RAD)))
        ink[here] |= step
        ink[there] |= step & off
    return ink
