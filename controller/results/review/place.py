"""The place of a finding on the part: the part drawn from the side that shows it, and a cross."""

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.arrays import FloatArray
from controller.cad import Solid
from controller.imaging import RayCaster

from ..ray_drawing import FINER, cast, jumps, smaller

ASPECT: Final = 1.25
TILTED_RAD: Final = float(np.radians(25.0))
LIGHT: Final = np.array([-0.35, 0.45, 0.82])  # right, up, towards the eye
PAPER, INK, DARK = 255.0, 40.0, 90.0
MARK_SHARE: Final = 0.055  # radius of the circle round the place, as a share of the width
MARK_BGR: Final = (0, 54, 168)


def place_drawing(
    solid: Solid, caster: RayCaster, p_part_mm: FloatArray, width_px: int
) -> NDArray[np.uint8]:
    """Return a drawing of the part with a place on it, (height, width, 3), blue first.

    Parameters
    ----------
    solid : the part
    caster : caster of its mesh
    p_part_mm : (3,) the place, CAD frame
    width_px : width of the drawing
    """
    right, up, back = _axes(_outwards(solid, p_part_mm))
    size = (width_px, round(width_px / ASPECT))
    corners = np.asarray(solid.mesh.vertices) - solid.centroid_mm
    u, v = corners @ right, corners @ up
    width, height = FINER * size[0], FINER * size[1]
    mm_per_px = 1.1 * max(np.ptp(u) / width, np.ptp(v) / height)
    middle_u, middle_v = (u.min() + u.max()) / 2, (v.min() + v.max()) / 2
    x = (np.arange(width) - width / 2) * mm_per_px + middle_u
    y = (height / 2 - np.arange(height)) * mm_per_px + middle_v
    eye = solid.centroid_mm + 2 * float(np.linalg.norm(np.ptp(corners, axis=0))) * back
    origins = (eye + x[None, :, None] * right + y[:, None, None] * up).reshape(-1, 3)
    triangle, _ = cast(caster, origins, -back[None], (width, height))
    on = triangle >= 0
    light = np.clip(np.asarray(solid.mesh.face_normals) @ (LIGHT @ [right, up, back]), 0, 1)
    image = np.where(on, DARK + (235.0 - DARK) * light[triangle], PAPER)
    face = np.where(on, np.asarray(solid.face_of_triangle)[triangle], -1)
    for here, there in jumps(face.astype(np.int32)):
        image[here], image[there] = INK, np.where(on[there], INK, image[there])
    grey = np.clip(smaller(image.astype(np.float32)), 0, 255).astype(np.uint8)
    drawn = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    off = np.asarray(p_part_mm) - solid.centroid_mm
    at = (
        ((off @ right - middle_u) / mm_per_px + width / 2) / FINER,
        (height / 2 - (off @ up - middle_v) / mm_per_px) / FINER,
    )
    return _marked(np.asarray(drawn, dtype=np.uint8), at)


def _outwards(solid: Solid, p_part_mm: FloatArray) -> FloatArray:
    """Return the normal of the surface at a place, from the triangle whose middle is nearest."""
    middles = np.asarray(solid.mesh.triangles_center)
    corners = np.asarray(solid.mesh.triangles)
    # large triangles have far middles: the nearest corner counts as well
    distance = np.minimum(
        np.linalg.norm(middles - p_part_mm, axis=1),
        np.linalg.norm(corners - p_part_mm, axis=2).min(axis=1),
    )
    near = distance <= distance.min() + 1e-6
    normal = np.asarray(solid.mesh.face_normals)[near].sum(axis=0)
    length = float(np.linalg.norm(normal))
    return normal / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])


def _axes(normal: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return right, up and towards the eye of a look at a surface, a little from the side."""
    helper = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
    right = np.cross(helper, normal)
    right /= np.linalg.norm(right)
    up = np.cross(normal, right)
    c, s = np.cos(TILTED_RAD), np.sin(TILTED_RAD)
    back = c * normal + s * (0.6 * right + 0.8 * up)
    back /= np.linalg.norm(back)
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    return right, np.cross(back, right), back


def _marked(image: NDArray[np.uint8], at: tuple[float, float]) -> NDArray[np.uint8]:
    radius = max(6, round(MARK_SHARE * image.shape[1]))
    x, y = round(at[0]), round(at[1])
    for colour, thick in (((255, 255, 255), 6), (MARK_BGR, 3)):
        cv2.circle(image, (x, y), radius, colour, thick, cv2.LINE_AA)
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            begin = (x + dx * radius, y + dy * radius)
            end = (x + 2 * dx * radius, y + 2 * dy * radius)
            cv2.line(image, begin, end, colour, thick, cv2.LINE_AA)
    return image
