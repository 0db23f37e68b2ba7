"""Coverage of a planned view, counted by points to which the plan was not fitted (ADR 57).

At the pose the view is taken at, so that depth, pixels and the border of the picture are exact
where the tables that plans are chosen by have to hold for every roll.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from controller.arrays import BoolArray, FloatArray, IntArray
from controller.cad import Solid, SurfaceSamples, by_face
from controller.imaging import Camera, RayCaster, inverse_pose, transform

from ..geometry import Box, segments_hit, stack
from ..model import CellLayout, Grasp, PlanOptions, of_faces
from ..motion import Scene, link_boxes, shown_pose
from ._arm import holds
from ._lens import SureRegion, stretches
from .gripper import FINGER_SHADOW_MM, holding_boxes
from .visibility import free_pairs, in_picture

STEP_MM = 0.05  # step along the surface, to count the pixels of a millimetre
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
DEPTH_MM_MIN = 1.0  # least depth of a box before the camera that is examined in the picture


def nearest_on_face(samples: SurfaceSamples, points: SurfaceSamples) -> IntArray:
    """Return the nearest sample on the same face for each of some points (m,)."""
    places, targets = (by_face(s.points_mm, s.face_ids) for s in (samples, points))
    return np.asarray(cKDTree(places).query(targets)[1], dtype=np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class CameraSight:
    """A camera's sighting of a part, with the boxes in front of it.

    Attributes
    ----------
    camera : camera that looks
    sharp_mm : depths between which its picture is sharp
    T_cam_part : (4, 4) pose of the part
    boxes : boxes that may hide some of it, in the camera's frame
    """

    camera: Camera
    sharp_mm: tuple[float, float]
    T_cam_part: FloatArray
    boxes: tuple[Box, ...]


class Counter:
    """Counts the points of a part that views show.

    Parameters
    ----------
    solid : the part
    samples : m points to count by
    layout : the cell
    options : up to which incidence a surface counts as seen, and how many pixels it must have
    caster : rays against the part's mesh
    """

    def __init__(
        self,
        solid: Solid,
        samples: SurfaceSamples,
        layout: CellLayout,
        options: PlanOptions,
        caster: RayCaster,
    ) -> None:
        self._solid, self._samples, self._layout = solid, samples, layout
        self._options, self._caster = options, caster
        points, normals = samples.points_mm, samples.normals
        self._ahead = np.einsum("ij,ij->i", points, normals)
        self._square = np.einsum("ij,ij->i", points, points)
        self._sure: dict[int, SureRegion] = {}
        self._standing: list[Box] = []

    def of_rows(self, which: IntArray) -> Counter:
        """Return a counter of some of the points, by number (k,)."""
        some = Counter(
            self._solid, self._samples.rows(which), self._layout, self._options, self._caster
        )
        some._sure, some._standing = self._sure, self._standing
        return some

    def held_up(self, grasp: Grasp, q: FloatArray) -> BoolArray:
        """Return a mask (m,) of what the inspection camera shows in a grasp, the arm at q (6,)."""
        return self.shown(self.sighting(grasp, q))

    def on_table(self, T_world_part: FloatArray) -> BoolArray:
        """Return a mask (m,) of what the overhead camera shows of the part at rest."""
        layout = self._layout
        T_cam_part = inverse_pose(layout.overhead.T_world_cam) @ T_world_part
        return self.shown(CameraSight(layout.overhead, layout.overhead_sharp_mm, T_cam_part, ()))

    def sighting(self, grasp: Grasp, q: FloatArray) -> CameraSight:
        """Return the inspection camera's sighting of a part in a grasp, the arm at q (6,)."""
        layout = self._layout
        camera = layout.inspection
        T_world_part = shown_pose(layout, q, grasp.T_part_tcp)
        T_cam_part = inverse_pose(camera.T_world_cam) @ T_world_part
        T_cam_tcp = T_cam_part @ grasp.T_part_tcp
        boxes = [b.placed(T_cam_tcp) for b in holding_boxes(layout.arm_gripper, grasp)]
        T_links, half_mm = link_boxes(layout, q[None])
        links = (Box(T, half) for T, half in zip(T_links[0], half_mm[0], strict=True))
        boxes += [b.placed(inverse_pose(camera.T_world_cam)) for b in links]
        if not self._standing:
            statics = [b for _, b in Scene(layout, 0.0, layout.fixed_open_mm).statics()]
            others = [b for b in statics if not holds(b, camera.position_mm)]
            self._standing += [b.placed(inverse_pose(camera.T_world_cam)) for b in others]
        boxes += self._standing
        return CameraSight(camera, layout.inspection_sharp_mm, T_cam_part, tuple(boxes))

    def shown(self, sighting: CameraSight) -> BoolArray:
        """Return a mask (m,) of the samples that a camera shows."""
        samples, options, camera = self._samples, self._options, sighting.camera
        T_cam_part, (sharp_from, sharp_to) = sighting.T_cam_part, sighting.sharp_mm
        shown = np.zeros(len(samples.points_mm), dtype=bool)
        eye = inverse_pose(T_cam_part)[:3, 3]
        left, cosine = self._facing(eye, float(np.cos(np.radians(options.max_incidence_deg))))
        p_cam_mm = transform(T_cam_part, samples.points_mm[left])
        depth = p_cam_mm[:, 2]
        good = (depth > 0.0) & (depth >= sharp_from) & (depth <= sharp_to)
        left, cosine, p_cam_mm = left[good], cosine[good], p_cam_mm[good]
        good = self._is_in_picture(camera, p_cam_mm)
        left, cosine, p_cam_mm = left[good], cosine[good], p_cam_mm[good]
        good = self._is_fine(camera, p_cam_mm, cosine, left, T_cam_part)
        left, p_cam_mm = left[good], p_cam_mm[good]
        left = left[~behind_boxes(p_cam_mm, sighting.boxes, FINGER_SHADOW_MM)]
        if len(left):
            eyes = np.broadcast_to(eye, (len(left), 3))
            shown[left] = free_pairs(samples, self._caster, left, eyes)
        return shown

    def _facing(self, eye: FloatArray, least: float) -> tuple[IntArray, FloatArray]:
        """Return the points (k,) that an eye (3,) sees squarely enough, and the cosines."""
        ahead = self._samples.normals @ eye - self._ahead
        (left,) = np.nonzero(ahead > 0.0)
        square = self._square[left] - 2.0 * (self._samples.points_mm[left] @ eye) + eye @ eye
        cosine = ahead[left] / np.sqrt(square)
        good = cosine >= least
        return left[good], cosine[good]

    def _sure_of(self, camera: Camera) -> SureRegion:
        if id(camera) not in self._sure:
            self._sure[id(camera)] = SureRegion.of(camera)
        return self._sure[id(camera)]

    def _is_in_picture(self, camera: Camera, p_cam_mm: FloatArray) -> BoolArray:
        """Return a mask (k,) of camera points (k, 3) in the picture, clear of its border."""
        sure = self._sure_of(camera)
        inside = sure.holds(p_cam_mm[:, 0] / p_cam_mm[:, 2], p_cam_mm[:, 1] / p_cam_mm[:, 2])
        (rows,) = np.nonzero(~inside)
        inside[rows] = in_picture(camera, transform(camera.T_world_cam, p_cam_mm[rows]))
        return inside

    def _is_fine(
        self,
        camera: Camera,
        p_cam_mm: FloatArray,
        cosine: FloatArray,
        members: IntArray,
        T_cam_part: FloatArray,
    ) -> BoolArray:
        """Return a mask (k,) of the points with enough pixels to the millimetre."""
        low_px, high_px = self._sure_of(camera).focal_px
        least = of_faces(self._options.min_px_per_mm, self._samples.face_ids[members])
        # straight ahead a surface looked at askance has fewest pixels, so this is a bound
        fine = np.asarray(low_px * cosine >= least * p_cam_mm[:, 2])
        (rows,) = np.nonzero(~fine)
        p_cam_mm, least = p_cam_mm[rows], least[rows]
        normals = self._samples.normals[members[rows]] @ T_cam_part[:3, :3].T
        per_mm = pinhole_per_mm(p_cam_mm, normals)
        fine[rows] = low_px * per_mm >= least
        unsure = ~fine[rows] & (high_px * per_mm >= least)
        T = camera.T_world_cam
        points = transform(T, p_cam_mm[unsure])
        fine[rows[unsure]] = (
            px_per_mm(camera, points, normals[unsure] @ T[:3, :3].T) >= least[unsure]
        )
        return fine


def behind_boxes(p_cam_mm: FloatArray, boxes: Sequence[Box], grow_mm: float) -> BoolArray:
    """Return a mask (k,) of the points that some box hides from the camera.

    Parameters
    ----------
    p_cam_mm : (k, 3) point before the camera, in its frame
    boxes : in its frame
    grow_mm : growth of every box on all sides
    """
    hidden = np.zeros(len(p_cam_mm), dtype=bool)
    if not len(p_cam_mm) or not len(boxes):
        return hidden
    at, depth = p_cam_mm[:, :2] / p_cam_mm[:, 2:], p_cam_mm[:, 2]
    T, half_mm = stack(boxes)
    corners = np.einsum("bij,bkj->bki", T[:, :3, :3], CORNERS * (half_mm[:, None] + grow_mm))
    corners += T[:, None, :3, 3]
    nearest, farthest = corners[..., 2].min(axis=1), corners[..., 2].max(axis=1)
    is_before = nearest > DEPTH_MM_MIN
    # what a box before the camera hides is within its own picture, and farther away
    pictured = corners[..., :2] / np.where(is_before[:, None], corners[..., 2], 1.0)[..., None]
    low, high = pictured.min(axis=1), pictured.max(axis=1)
    may_meet = ~is_before & (farthest > 0.0)
    may_meet |= is_before & (nearest <= depth.max()) & (high >= at.min(axis=0)).all(axis=1)
    may_meet &= ~is_before | (low <= at.max(axis=0)).all(axis=1)
    for k in np.flatnonzero(may_meet).tolist():
        may_be = ~hidden
        if is_before[k]:
            (x0, y0), (x1, y1) = low[k], high[k]
            may_be &= (at[:, 0] >= x0) & (at[:, 0] <= x1) & (at[:, 1] >= y0) & (at[:, 1] <= y1)
            may_be &= depth >= nearest[k]
        (rows,) = np.nonzero(may_be)
        if len(rows):
            hidden[rows] = segments_hit(p_cam_mm[rows], np.zeros(3), [boxes[k]], grow_mm)
    return hidden


def px_per_mm(camera: Camera, points_mm: FloatArray, normals: FloatArray) -> FloatArray:
    """Return the pixels of a millimetre along a surface, in its worst direction (n,).

    Parameters
    ----------
    camera : with its lens
    points_mm : (n, 3) on the surface, world
    normals : (n, 3) unit
    """
    if len(points_mm) == 0:
        return np.zeros(0)
    a, b = (
        (camera.project(points_mm + STEP_MM / 2 * d) - camera.project(points_mm - STEP_MM / 2 * d))
        / STEP_MM
        for d in _along(normals)
    )
    return np.asarray(stretches(a, b)[0])


def pinhole_per_mm(p_cam_mm: FloatArray, normals: FloatArray) -> FloatArray:
    """Return the least length (n,) of a surface millimetre in the plane at depth 1.

    Parameters
    ----------
    p_cam_mm : (n, 3) on the surface, before the camera, in its frame
    normals : (n, 3) unit, in that frame
    """
    at = p_cam_mm[:, :2] / p_cam_mm[:, 2:]
    a, b = ((d[:, :2] - at * d[:, 2:]) / p_cam_mm[:, 2:] for d in _along(normals))
    return np.asarray(stretches(a, b)[0])


def _along(normals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return two directions along each surface, square to each other (n, 3)."""
    u = np.cross(normals, np.eye(3)[np.argmin(np.abs(normals), axis=1)])
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    return u, np.cross(normals, u)
