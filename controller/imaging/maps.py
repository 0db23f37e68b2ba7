"""Maps of a posed mesh for a calibrated camera: the triangle in each pixel, and its depth.

This is the controller's only picture predictor: recognition, planning and inspection compare with
its pictures.
"""

from dataclasses import dataclass

import numpy as np

from controller.arrays import BoolArray, FloatArray, Int32Array

from .camera import Camera, inverse_pose, transform
from .rays import RayCaster

Roi = tuple[int, int, int, int]  # x0, y0, x1, y1 [px], the last ones excluded


@dataclass(frozen=True, eq=False, slots=True)
class ViewMaps:
    """A region of a predicted picture.

    Attributes
    ----------
    roi : the region in the picture
    triangle : (height, width) int32 triangle seen, -1 beside the part
    depth_mm : (height, width) depth along the camera's axis, inf beside the part
    """

    roi: Roi
    triangle: Int32Array
    depth_mm: FloatArray

    @property
    def mask(self) -> BoolArray:
        """Mask (height, width) of the visible part."""
        return self.triangle >= 0


def view_roi(
    vertices_mm: FloatArray, T_world_part: FloatArray, camera: Camera, margin_px: int = 4
) -> Roi | None:
    """Return the picture region of a posed part, None if it is out of sight.

    Parameters
    ----------
    vertices_mm : (n, 3) vertices of the part, CAD frame; at least one
    T_world_part : (4, 4) [mm]
    camera : calibrated, in the world's frame
    margin_px : added round the part, within the picture
    """
    width, height = camera.size_px
    pixels = camera.project(transform(T_world_part, vertices_mm))
    x0, y0 = np.floor(pixels.min(axis=0)).astype(int) - margin_px
    x1, y1 = np.ceil(pixels.max(axis=0)).astype(int) + margin_px + 1
    x0, y0, x1, y1 = max(x0, 0), max(y0, 0), min(x1, width), min(y1, height)
    return None if x0 >= x1 or y0 >= y1 else (int(x0), int(y0), int(x1), int(y1))


def meet_part(
    caster: RayCaster, T_world_part: FloatArray, eye_mm: FloatArray, lines: FloatArray
) -> tuple[Int32Array, FloatArray]:
    """Return the triangle (n,) each sight line meets first, -1 for none, and its distance (n,).

    Parameters
    ----------
    caster : rays against the part's mesh, CAD frame
    T_world_part : (4, 4) [mm]
    eye_mm : (3,) start of the lines, in the world
    lines : (n, 3) directions in the world; distances are in units of their length, which are
        depths for the sight lines of a camera, scaled to depth 1
    """
    T_part_world = inverse_pose(T_world_part)
    directions = lines @ T_part_world[:3, :3].T
    return caster.first_hit(transform(T_part_world, eye_mm[None])[0], directions)


def render_maps(
    caster: RayCaster, T_world_part: FloatArray, camera: Camera, roi: Roi, step_px: int = 1
) -> ViewMaps:
    """Return triangle and depth maps of a posed part at every ``step_px``-th pixel of a region.

    Parameters
    ----------
    caster : caster of the part's mesh, in the CAD frame
    T_world_part : (4, 4) pose of the CAD frame in the world [mm]
    camera : calibrated, in the world's frame
    roi : region of the picture
    step_px : distance between the pixels
    """
    x0, y0, x1, y1 = roi
    lines = camera.sight_line_table[y0:y1:step_px, x0:x1:step_px].astype(np.float64)
    shape = lines.shape[:2]
    triangle, depth = meet_part(caster, T_world_part, camera.position_mm, lines.reshape(-1, 3))
    return ViewMaps(roi, triangle.reshape(shape), depth.reshape(shape))
