"""Visible surface of a posed part on a grid of pixels."""

from dataclasses import dataclass

import numpy as np

from controller.arrays import BoolArray, Float32Array, FloatArray, Int32Array, inner, lengths
from controller.cad import Solid, surface_normals
from controller.imaging import Camera, ViewMaps, inverse_pose, transform


@dataclass(frozen=True, eq=False, slots=True)
class Surface:
    """Surface hit by the lines of sight of a grid of pixels; all arrays are on that grid.

    Attributes
    ----------
    seen : (h, w) mask of pixels on the part
    points, normals : (n, 3) world, for these pixels in order; normals of the recognised surface
    face : (h, w) face hit, -1 for none
    cosine : (h, w) cosine of the angle of incidence, 0 off the part
    area_mm2 : (h, w) surface area in a pixel of the full picture
    depth_mm : (h, w) depth along the camera's axis, 0 off the part
    node_mm : (h, w) side of a node square to the line of sight
    """

    seen: BoolArray
    points: FloatArray
    normals: FloatArray
    facets: FloatArray
    face: Int32Array
    cosine: Float32Array
    area_mm2: Float32Array
    depth_mm: Float32Array
    node_mm: Float32Array


def find_surface(
    solid: Solid, maps: ViewMaps, T_world_part: FloatArray, camera: Camera, step_px: int
) -> Surface:
    """Return the surface of a posed part on a grid of pixels.

    Parameters
    ----------
    solid : the part
    maps : its `ViewMaps` for every ``step_px``-th pixel of their region
    T_world_part : (4, 4) [mm] pose of the maps
    camera : camera of the maps
    step_px : distance between the grid's pixels
    """
    seen = maps.mask
    x0, y0, x1, y1 = maps.roi
    lines = camera.sight_line_table[y0:y1:step_px, x0:x1:step_px][seen].astype(np.float64)
    points = camera.position_mm + lines * maps.depth_mm[seen][:, None]
    triangle = maps.triangle[seen]
    faces = solid.face_of_triangle[triangle]
    facets = np.asarray(solid.mesh.face_normals)[triangle]
    T_part_world = inverse_pose(T_world_part)
    smooth = surface_normals(solid.faces, faces, transform(T_part_world, points), facets)
    R = T_world_part[:3, :3].T
    normals = smooth @ R
    cosine = -inner(normals, lines) / lengths(lines)
    side_mm = maps.depth_mm[seen] / float(camera.K[0, 0])

    def spread(values: FloatArray) -> Float32Array:
        out = np.zeros(seen.shape, dtype=np.float32)
        out[seen] = values
        return out

    face = np.full(seen.shape, -1, dtype=np.int32)
    face[seen] = faces
    return Surface(
        seen=seen,
        points=points,
        normals=normals,
        facets=facets @ R,
        face=face,
        cosine=spread(np.clip(cosine, 0.0, 1.0)),
        area_mm2=spread(side_mm**2 / np.maximum(cosine, 0.2)),
        depth_mm=spread(maps.depth_mm[seen]),
        node_mm=spread(step_px * side_mm),
    )
