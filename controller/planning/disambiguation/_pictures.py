"""Predicted pictures of each hypothesis: outline, visible edges, the arm gripper."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import trimesh

from controller.arrays import BoolArray, FloatArray
from controller.cad import Solid
from controller.imaging import (
    Camera,
    RayCaster,
    Roi,
    ViewMaps,
    mask_rim,
    render_maps,
    transform,
    view_roi,
)

from ..geometry import Box
from ..views import even_sphere
from ._rules import DisambiguationRules

OUTER_COUNT = 400
SAME_FACE_STEP_MM = 3.0  # a surface that hides part of itself
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
_TRIANGLES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)


@dataclass(frozen=True, slots=True, eq=False)
class EdgePicture:
    """A region of a picture on a grid of every `step_px`-th pixel, (height, width) each.

    A measured one has the same fields: the mask from a picture against the backlight, edges from
    one under the ring lamp.

    Attributes
    ----------
    mask : mask of the part
    edges : its outline and the edges inside it that show
    behind, before : masks of arm gripper and arm: over the light behind, and over the part's face
    """

    step_px: int
    mask: BoolArray
    edges: BoolArray
    behind: BoolArray
    before: BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class Stance:
    """Possible offset of a held part in one view, in pixels of its picture.

    Attributes
    ----------
    pivot_px : (2,) the TCP in the grid's region, about which the part may turn
    shift_px : it may be off so far each way, the tilt of what lies before or behind the tip
        included
    turn_rad : and turned about the sight line
    tolerance_px : movement that tilts may still cause after that, and the error of edges
    """

    pivot_px: FloatArray
    shift_px: float
    turn_rad: float
    tolerance_px: float


def outer_points(solid: Solid) -> FloatArray:
    """Return the points of a solid farthest out each way (n, 3), to a fraction of a pixel."""
    vertices = np.asarray(solid.mesh.vertices)
    return np.asarray(vertices[np.unique(np.argmax(even_sphere(OUTER_COUNT) @ vertices.T, axis=1))])


def region_of(
    outer_mm: Sequence[FloatArray], T_world_part: Sequence[FloatArray], camera: Camera, margin: int
) -> Roi | None:
    """Return the region that holds all hypotheses with a margin [px], None if one is out of sight.

    Parameters
    ----------
    outer_mm : of `outer_points`
    T_world_part : pose of each hypothesis (4, 4), as it is held up
    camera : camera of the view
    margin : margin on all sides [px]
    """
    found = [view_roi(p, T, camera, margin) for p, T in zip(outer_mm, T_world_part, strict=True)]
    known = [r for r in found if r is not None]
    if len(known) < len(found):
        return None
    low, high = np.min(known, axis=0), np.max(known, axis=0)
    return int(low[0]), int(low[1]), int(high[2]), int(high[3])


def predict(
    solid: Solid,
    caster: RayCaster,
    T_world_part: FloatArray,
    camera: Camera,
    roi: Roi,
    step_px: int,
    arm_gripper: ViewMaps | None,
    rules: DisambiguationRules,
) -> EdgePicture:
    """Return the predicted picture of one hypothesis.

    Parameters
    ----------
    solid : the hypothesis's part
    caster : rays against its mesh
    T_world_part : (4, 4) as it is held up
    camera : camera of the view
    roi : region of the picture
    step_px : distance of the grid's pixels
    arm_gripper : of `see_boxes` on the same grid; None where nothing holds the part
    rules : rules on visible edges, and on the distance to the gripper within which nothing is
        compared
    """
    maps = render_maps(caster, T_world_part, camera, roi, step_px)
    mask = maps.mask
    x0, y0, x1, y1 = roi
    lines = camera.sight_line_table[y0:y1:step_px, x0:x1:step_px].astype(np.float64)
    lines = lines @ T_world_part[:3, :3]
    seen = np.maximum(maps.triangle, 0)
    normals = np.asarray(solid.mesh.face_normals)[seen]
    faces = np.where(mask, solid.face_of_triangle[seen], -1)
    edges = mask_rim(mask)
    for ahead in ((slice(None), slice(1, None)), (slice(1, None), slice(None))):
        back = tuple(slice(None, -1) if s.start == 1 else s for s in ahead)
        both = mask[ahead] & mask[back]
        cosine = np.einsum("hwi,hwi->hw", normals[ahead], normals[back])
        crease = (faces[ahead] != faces[back]) & (cosine < np.cos(rules.crease_rad))
        # how far one pixel's surface would pass beside the next pixel's
        slope = np.einsum("hwi,hwi->hw", normals[back], lines[back])
        on = np.einsum("hwi,hwi->hw", normals[back], lines[ahead])
        with np.errstate(invalid="ignore", divide="ignore"):
            gap = np.abs(maps.depth_mm[back] * slope / on - maps.depth_mm[ahead])
        far = np.where(faces[ahead] != faces[back], rules.step_mm, SAME_FACE_STEP_MM)
        step = both & np.isfinite(gap) & (gap > far) & (np.abs(on) > 1e-3)
        # on the nearer side, where the edge is
        nearer = maps.depth_mm[back] <= maps.depth_mm[ahead]
        found = both & (crease | step)
        edges[back] |= found & nearer
        edges[ahead] |= found & ~nearer
    if arm_gripper is None:
        none = np.zeros_like(mask)
        return EdgePicture(step_px, mask, edges, none, none)
    grow = np.ones((2 * int(np.ceil(rules.gripper_px / step_px)) + 1,) * 2, np.uint8)
    before = arm_gripper.mask & (arm_gripper.depth_mm < maps.depth_mm)
    return EdgePicture(step_px, mask, edges, _grown(arm_gripper.mask, grow), _grown(before, grow))


def see_boxes(boxes: Sequence[Box], camera: Camera, roi: Roi, step_px: int) -> ViewMaps:
    """Return triangle and depth maps of boxes in the world.

    Parameters
    ----------
    boxes : in the world, at least one
    camera : calibrated, in the world's frame
    roi : region of the picture that is asked for
    step_px : step of its pixels, every so many are looked at
    """
    return render_maps(box_caster(boxes), np.eye(4), camera, roi, step_px)


def box_caster(boxes: Sequence[Box]) -> RayCaster:
    """Return ray casting against boxes in the world, at least one."""
    corners = [(_CORNERS * b.half_mm) @ b.T[:3, :3].T + b.T[:3, 3] for b in boxes]
    triangles = np.vstack([_TRIANGLES + 8 * k for k in range(len(boxes))])
    return RayCaster(trimesh.Trimesh(np.vstack(corners), triangles, process=False))


def stance_of(
    outer_mm: Sequence[FloatArray],
    T_world_part: Sequence[FloatArray],
    T_world_tcp: FloatArray,
    camera: Camera,
    roi: Roi,
    rules: DisambiguationRules,
) -> Stance:
    """Return the possible shift and tilt of hypotheses in one gripper, as one view sees them.

    To first order: a point at depth z from the gripper's TCP moves by the tilt times z across the
    picture. Its mean is a shift of all; the rest is tolerated.

    Parameters
    ----------
    outer_mm : of each hypothesis, `outer_points` (n, 3), CAD frame
    T_world_part : pose of each hypothesis (4, 4), as it is held up
    T_world_tcp : (4, 4) pose of the TCP
    camera : camera of the view
    roi : region of the picture; the pivot is counted from its corner
    rules : uncertainty of the grasp
    """
    axis = camera.T_world_cam[:3, 2]
    tcp_mm = T_world_tcp[:3, 3]
    depths = np.concatenate(
        [(transform(T, p) - tcp_mm) @ axis for p, T in zip(outer_mm, T_world_part, strict=True)]
    )
    middle, half = (depths.max() + depths.min()) / 2, (depths.max() - depths.min()) / 2
    px_per_mm = float(camera.K[0, 0]) / float((tcp_mm - camera.position_mm) @ axis + middle)
    return Stance(
        camera.project(tcp_mm[None])[0] - np.array(roi[:2]),
        px_per_mm * (rules.shift_mm + rules.turn_rad * abs(float(middle))),
        rules.turn_rad,
        px_per_mm * rules.turn_rad * float(half) + rules.edge_px,
    )


def _grown(mask: BoolArray, kernel: np.ndarray) -> BoolArray:
    return np.asarray(cv2.dilate(mask.astype(np.uint8), kernel) > 0)
