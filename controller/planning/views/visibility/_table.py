"""Surface that the overhead camera shows of a part on the table."""

from __future__ import annotations

import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.cad import SurfaceSamples
from controller.imaging import Camera, RayCaster, inverse_pose, transform

from ...model import of_faces
from ._rules import in_picture
from ._visible import cosines, free_sight_lines


def table_views(
    samples: SurfaceSamples,
    caster: RayCaster,
    T_world_part: FloatArray,
    camera: Camera,
    sharp_mm: tuple[float, float],
    max_incidence_rad: float,
    min_px_per_mm: float | tuple[float, ...],
) -> BoolArray:
    """Return a mask (k, n) of the samples that the camera shows well of a part in each pose.

    The rules are those of the inspection camera: incidence, own shadow, resolution, depth of field
    and picture. The table hides nothing that faces upwards.

    Parameters
    ----------
    samples : n, of the part's surface
    T_world_part : (k, 4, 4)
    caster : caster of the part's mesh, in the CAD frame
    camera : calibrated, in the world's frame
    sharp_mm : depths along its axis between which the picture is sharp
    max_incidence_rad : up to which a surface counts as seen
    min_px_per_mm : least resolution along the surface, of every face or by its id; 0 for any
    """
    focal_px = float(min(camera.K[0, 0], camera.K[1, 1]))
    least = of_faces(min_px_per_mm, samples.face_ids)
    shown = np.zeros((len(T_world_part), len(samples.points_mm)), dtype=bool)
    for k, T in enumerate(T_world_part):
        points = transform(T, samples.points_mm)
        depth = (points - camera.position_mm) @ camera.T_world_cam[:3, 2]
        eye = transform(inverse_pose(T), camera.position_mm[None])[0]
        cosine = cosines(samples, eye[None])[0]
        good = (cosine >= np.cos(max_incidence_rad)) & (depth > 0.0)
        good &= focal_px * cosine >= least * depth
        good &= (depth >= sharp_mm[0]) & (depth <= sharp_mm[1])
        good &= in_picture(camera, points)
        shown[k] = free_sight_lines(samples, caster, good[None], eye[None])[0]
    return shown
