"""How bright a posed part looks under a lamp: matt surfaces, its own shadows, nothing else.

Relative radiance only: the gain of lamp, lens and sensor is fitted against the picture by whoever
compares. Highlights and light that bounces from surface to surface are not predicted.
"""

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray

from .camera import Camera, inverse_pose, transform
from .rays import RayCaster
from .views.maps import ViewMaps

Array = NDArray[np.float64]

SHADOW_OFFSET_MM = 0.05  # off the surface, or it would shadow itself


@dataclass(frozen=True, eq=False, slots=True)
class PointLamp:
    """A lamp as the points its light comes from.

    Attributes
    ----------
    name : as in the cell file
    points_mm : (n, 3) in the world; a ring is a handful of points
    """

    name: str
    points_mm: Array

    @staticmethod
    def ring(
        name: str, centre_mm: Array, axis: Array, radius_mm: float, count: int = 6
    ) -> "PointLamp":
        """Return a ring of lamps round a camera's axis."""
        helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
        e1 = np.cross(axis, helper)
        e1 /= np.linalg.norm(e1)
        e2 = np.cross(axis, e1)
        phi = np.arange(count) * 2 * np.pi / count
        points = centre_mm + radius_mm * (np.cos(phi)[:, None] * e1 + np.sin(phi)[:, None] * e2)
        return PointLamp(name, points)


def predict_radiance(
    mesh: trimesh.Trimesh,
    caster: RayCaster,
    maps: ViewMaps,
    T_world_part: Array,
    camera: Camera,
    lamp: PointLamp,
    step_px: int = 1,
) -> NDArray[np.float32]:
    """Return the relative radiance of a region under one lamp, (height, width) float32.

    1 is a matt surface square to the lamp at the distance of the part's origin. Pixels where the
    part is not seen are 0.

    Parameters
    ----------
    maps : of the same pose, region and step
    """
    radiance, _ = predict_light(mesh, caster, maps, T_world_part, camera, lamp, None, step_px)
    return radiance


def predict_light(
    mesh: trimesh.Trimesh,
    caster: RayCaster,
    maps: ViewMaps,
    T_world_part: Array,
    camera: Camera,
    lamp: PointLamp,
    others: RayCaster | None,
    step_px: int = 1,
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return `predict_radiance`, and where anything else keeps light of the lamp away.

    Parameters
    ----------
    others : what else throws shadows, in the world frame (the gripper that holds the part)
    """
    out = np.zeros(maps.triangle.shape, dtype=np.float32)
    shaded = np.zeros(maps.triangle.shape, dtype=bool)
    seen = maps.mask
    if not seen.any():
        return out, shaded
    x0, y0, x1, y1 = maps.roi
    lines = camera.sight_line_table[y0:y1:step_px, x0:x1:step_px][seen].astype(np.float64)
    points = camera.position_mm + lines * maps.depth_mm[seen][:, None]
    normals = np.asarray(mesh.face_normals)[maps.triangle[seen]] @ T_world_part[:3, :3].T
    T_part_world = inverse_pose(T_world_part)
    total = np.zeros(len(points))
    touched = np.zeros(len(points), dtype=bool)
    reference = float(np.mean(np.linalg.norm(lamp.points_mm - T_world_part[:3, 3], axis=1)))
    start = points + SHADOW_OFFSET_MM * normals
    start_part = transform(T_part_world, start)
    for position in lamp.points_mm:
        towards = position - start
        distance = np.linalg.norm(towards, axis=1)
        cosine = (towards * normals).sum(axis=1) / distance
        lit = np.flatnonzero(cosine > 0)
        unit = towards[lit] / distance[lit][:, None]
        dark = caster.blocked(start_part[lit], unit @ T_world_part[:3, :3])
        total[lit] += np.where(dark, 0.0, cosine[lit] * (reference / distance[lit]) ** 2)
        if others is not None:
            # what stands behind the lamp takes none of its light
            touched[lit] |= others.blocked(start[lit], unit, distance[lit])
    out[seen] = (total / len(lamp.points_mm)).astype(np.float32)
    shaded[seen] = touched
    return out, shaded
