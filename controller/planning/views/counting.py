"""What a planned view shows, counted by points that the plan was not fitted to (ADR 57).

At the pose the view is taken at, so that depth, pixels and the border of the picture are exact
where the tables that plans are chosen by have to hold for every roll.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from controller.arrays import BoolArray, FloatArray, IntArray
from controller.cad import Solid, SurfaceSamples, by_face
from controller.imaging import Camera, RayCaster, inverse_pose, transform

from ..geometry import Box, segments_hit
from ..model import CellLayout, Grasp, PlanOptions
from ..motion import Scene, link_boxes, shown_pose
from ._arm import holds
from .gripper import FINGER_SHADOW_MM, holding_boxes
from .visibility import cosines, free_sight_lines, in_picture

STEP_MM = 0.05  # along the surface, to count the pixels of a millimetre


def nearest_on_face(samples: SurfaceSamples, points: SurfaceSamples) -> IntArray:
    """Return for each of some points (m,) the nearest of the samples on its face."""
    places, targets = (by_face(s.points_mm, s.face_ids) for s in (samples, points))
    return np.asarray(cKDTree(places).query(targets)[1], dtype=np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class Counter:
    """Counts what views show of a part.

    Attributes
    ----------
    solid : the part
    samples : m points to count by
    layout : the cell
    options : up to which incidence a surface counts as seen, and how many pixels it must have
    caster : rays against the part's mesh
    """

    solid: Solid
    samples: SurfaceSamples
    layout: CellLayout
    options: PlanOptions
    caster: RayCaster

    def held_up(self, grasp: Grasp, q: FloatArray) -> BoolArray:
        """Return what the inspection camera shows (m,) of a part in a grasp, the arm at q (6,)."""
        layout = self.layout
        T_world_part = shown_pose(layout, q, grasp.T_part_tcp)
        T_world_tcp = T_world_part @ grasp.T_part_tcp
        boxes = [b.placed(T_world_tcp) for b in holding_boxes(layout.arm_gripper, grasp)]
        T_links, half_mm = link_boxes(layout, q[None])
        boxes += [Box(T, half) for T, half in zip(T_links[0], half_mm[0], strict=True)]
        scene = Scene(layout, grasp.opening_mm, layout.fixed_open_mm)
        boxes += [b for _, b in scene.statics() if not holds(b, layout.inspection.position_mm)]
        return self._shown(T_world_part, layout.inspection, layout.inspection_sharp_mm, boxes)

    def on_table(self, T_world_part: FloatArray) -> BoolArray:
        """Return what the overhead camera shows of the part at rest (m,)."""
        return self._shown(T_world_part, self.layout.overhead, self.layout.overhead_sharp_mm, [])

    def _shown(
        self,
        T_world_part: FloatArray,
        camera: Camera,
        sharp_mm: tuple[float, float],
        boxes: list[Box],
    ) -> BoolArray:
        samples, options = self.samples, self.options
        eye = transform(inverse_pose(T_world_part), camera.position_mm[None])
        cosine = cosines(samples, eye)[0]
        (left,) = np.nonzero(cosine >= np.cos(np.radians(options.max_incidence_deg)))
        points = transform(T_world_part, samples.points_mm[left])
        depth = (points - camera.position_mm) @ camera.T_world_cam[:3, 2]
        good = (depth > 0.0) & (depth >= sharp_mm[0]) & (depth <= sharp_mm[1])
        good &= in_picture(camera, points)
        normals = samples.normals[left] @ T_world_part[:3, :3].T
        good &= px_per_mm(camera, points, normals) >= options.min_px_per_mm
        left, points = left[good], points[good]
        left = left[~segments_hit(points, camera.position_mm, boxes, FINGER_SHADOW_MM)]
        asked = np.zeros((1, len(cosine)), dtype=bool)
        asked[0, left] = True
        return np.asarray(free_sight_lines(samples, self.caster, asked, eye)[0])


def px_per_mm(camera: Camera, points_mm: FloatArray, normals: FloatArray) -> FloatArray:
    """Return the pixels of a millimetre along a surface, the way that has fewest (n,).

    Parameters
    ----------
    camera : with its lens
    points_mm : (n, 3) on the surface, world
    normals : (n, 3) unit
    """
    if len(points_mm) == 0:
        return np.zeros(0)
    u = np.cross(normals, np.eye(3)[np.argmin(np.abs(normals), axis=1)])
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    a, b = (
        (camera.project(points_mm + STEP_MM / 2 * d) - camera.project(points_mm - STEP_MM / 2 * d))
        / STEP_MM
        for d in (u, np.cross(normals, u))
    )
    # the smaller singular value of the matrix whose columns they are
    half = ((a * a).sum(axis=1) + (b * b).sum(axis=1)) / 2.0
    area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return np.asarray(np.sqrt(np.maximum(half - np.sqrt(np.maximum(half**2 - area**2, 0.0)), 0.0)))
