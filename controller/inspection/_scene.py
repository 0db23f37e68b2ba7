"""The scene of a view besides the part, and the surface samples in sight."""

from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
import trimesh

from controller.arrays import BoolArray, FloatArray, IntArray, inner, lengths, on_each_pixel
from controller.cad import SurfaceSamples
from controller.imaging import (
    Camera,
    PointLamp,
    RayCaster,
    ViewMaps,
    inverse_pose,
    render_maps,
    transform,
)

from ._pose import PosedPart
from ._types import ViewTask, WorldBox
from .limits import FLATTEST_COS, POSE_SPREADS

# Standard deviations of the place of the gripper, and of a finger on it, since jaws open wider or
# less. Two of both together are 1.3 mm.
GRIPPER_MM: Final = 0.46
FINGER_MM: Final = 0.46
BORDER_PX: Final = 2.0  # blur of its edge, and the raster of its mask before the part
MASK_STEP_PX: Final = 2  # raster of the mask before the part
COARSE_STEP_PX: Final = 4  # and of the whole picture's, but at its border
UNIT_BOX: Final = trimesh.creation.box()  # of side 1, about the origin
SPOT_RADIUS_MM: Final = 25.0  # assumed radius of a lamp that is given as one point
RING_SPREAD: Final = 0.12  # spread of a ring lamp's radius, as a share
# Offset of shadow rays from the surface, so that it does not shadow itself.
SHADOW_OFFSET_MM: Final = 0.05


@dataclass(frozen=True, eq=False, slots=True)
class ViewScene:
    """Scene of a view without the part, for the prediction.

    Attributes
    ----------
    holder : ray casting against gripper and arm, world; None where nothing holds the part
    holder_mask : (height, width) mask of pixels that may show them
    panel : (height, width) mask of the backlight panel in sight, shrunk
    boxes : of gripper and arm
    margins_px : of each box, what its place and shape may be off in the picture
    wide : ray casting against the boxes, each enlarged by its margin; None without any
    """

    holder: RayCaster | None
    holder_mask: BoolArray
    panel: BoolArray
    boxes: tuple[WorldBox, ...] = ()
    margins_px: tuple[int, ...] = ()
    wide: RayCaster | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Visibility:
    """Visibility of samples, (n,) each, and their pixels (n, 2)."""

    free: BoolArray
    beside_gripper: BoolArray
    pixels: IntArray


def box_mesh(boxes: tuple[WorldBox, ...]) -> trimesh.Trimesh:
    """Return the triangles of one or more boxes in the world."""
    # put together by hand: trimesh takes a millisecond a box
    corners, sides, triangles = UNIT_BOX.vertices, UNIT_BOX.face_normals, UNIT_BOX.faces
    axes = [np.asarray(box.T[:3, :3]).T for box in boxes]
    return trimesh.Trimesh(
        vertices=np.concatenate(
            [trimesh.transform_points(corners * (2 * box.half_mm), box.T) for box in boxes]
        ),
        faces=np.concatenate([triangles + k * len(corners) for k in range(len(boxes))]),
        face_normals=np.concatenate(
            [trimesh.unitize(sides @ np.cross(a[[1, 2, 0]], a[[2, 0, 1]])) for a in axes]
        ),
        process=False,
    )


def margin_px(sigma_px: float, out_px: float = 0.0) -> int:
    """Return the margin round a box of the gripper in a picture.

    Parameters
    ----------
    sigma_px : standard deviation of its place
    out_px : how far its true shape stands out of it
    """
    return int(np.ceil(POSE_SPREADS * sigma_px + out_px + BORDER_PX - 0.5))


def make_scene(task: ViewTask) -> ViewScene:
    """Return the scene of a view: everything in it except the part."""
    width, height = task.camera.size_px
    panel = np.zeros((height, width), dtype=np.uint8)
    edges = [
        task.panel_mm[i] + t * (task.panel_mm[(i + 1) % 4] - task.panel_mm[i])
        for i in range(4)
        for t in np.linspace(0, 1, 20, endpoint=False)
    ]
    outline = task.camera.project(np.array(edges))
    cv2.fillPoly(panel, [np.round(outline).astype(np.int32)], 1)
    inner = cv2.erode(panel, np.ones((9, 9), np.uint8), borderValue=1)
    scene = ViewScene(None, np.zeros((height, width), dtype=bool), inner > 0)
    if not task.holder:
        return scene
    pixel_mm = task.camera.mm_per_px(task.T_world_part_expected[:3, 3])
    margin = margin_px(float(np.hypot(GRIPPER_MM, FINGER_MM)) / pixel_mm)
    scene = with_boxes(scene, task.holder, (margin,) * len(task.holder), pixel_mm)
    assert scene.wide is not None
    return replace(scene, holder_mask=_seen_in(scene.wide, task.camera))


def _seen_in(bodies: RayCaster, camera: Camera) -> BoolArray:
    """Return the mask (height, width) of the pixels that bodies are seen in, in the whole picture.

    Looked at on every fourth pixel, and on each where those around it differ.
    """
    width, height = camera.size_px
    maps = render_maps(bodies, np.eye(4), camera, (0, 0, width, height), COARSE_STEP_PX)
    coarse, kernel = maps.mask.astype(np.uint8), np.ones((3, 3), np.uint8)
    differ = cv2.dilate(coarse, kernel) != cv2.erode(coarse, kernel)
    mask = on_each_pixel(maps.mask, COARSE_STEP_PX, (height, width))
    y, x = np.nonzero(on_each_pixel(differ, COARSE_STEP_PX, (height, width)))
    lines = camera.sight_line_table[y, x].astype(np.float64)
    mask[y, x] = bodies.blocked(camera.position_mm, lines)
    return mask


def with_boxes(
    scene: ViewScene, boxes: tuple[WorldBox, ...], margins_px: tuple[int, ...], pixel_mm: float
) -> ViewScene:
    """Return a scene with other boxes of gripper and arm; its mask stays.

    Parameters
    ----------
    scene : the scene
    boxes, margins_px : one or more boxes, and the margin of each
    pixel_mm : size of a pixel at the part
    """
    wide = tuple(
        WorldBox(box.T, box.half_mm + margin * pixel_mm)
        for box, margin in zip(boxes, margins_px, strict=True)
    )
    return replace(
        scene,
        boxes=boxes,
        margins_px=margins_px,
        holder=RayCaster(box_mesh(boxes)),
        wide=RayCaster(box_mesh(wide)),
    )


def before_part(scene: ViewScene, maps: ViewMaps, camera: Camera) -> ViewScene:
    """Return a scene with the gripper masked on the part only where it may be in front of it.

    A gripper behind the part hides none of the part's face, wherever beside its place it stands.
    Beside the part and through its holes it remains in the mask.

    Parameters
    ----------
    scene : scene from `make_scene`
    maps : predicted picture of the part at its measured pose
    camera : camera of the view
    """
    if scene.wide is None:
        return scene
    x0, y0, x1, y1 = maps.roi
    held = render_maps(scene.wide, np.eye(4), camera, maps.roi, step_px=MASK_STEP_PX)
    held_mm = np.where(held.mask, held.depth_mm, np.inf)
    part_mm = np.where(maps.mask, maps.depth_mm, np.inf)
    mask = scene.holder_mask.copy()
    mask[y0:y1, x0:x1] = on_each_pixel(held_mm, MASK_STEP_PX, part_mm.shape) < part_mm
    return replace(scene, holder_mask=mask)


def lamp_points(lamp: PointLamp) -> FloatArray:
    """Return sample points (n, 3) of a lamp of unknown extent [mm]."""
    points = lamp.points_mm
    if len(points) == 1:
        reach = SPOT_RADIUS_MM * np.vstack([np.eye(3), -np.eye(3)])
        return np.vstack([points, points + reach])
    middle = points.mean(axis=0)
    scale = np.where(np.arange(len(points)) % 2, 1 + RING_SPREAD, 1 - RING_SPREAD)
    return np.asarray(middle + (points - middle) * scale[:, None])


def lamp_reaches(
    part: RayCaster,
    T_world_part: FloatArray,
    others: RayCaster | None,
    start: FloatArray,
    towards: FloatArray,
    normals: FloatArray,
) -> BoolArray:
    """Return a mask (n,) of surface points that a lamp shines on, world.

    Parameters
    ----------
    part : ray casting against the part, CAD frame
    T_world_part : (4, 4) its pose
    others : other bodies that cast shadows; None for none
    start : (n, 3) just off the surface
    towards : (n, 3) from there to the lamp
    normals : (n, 3) of the facets
    """
    distance = lengths(towards)
    unit = towards / distance[:, None]
    out: BoolArray = inner(unit, normals) > 0
    facing = np.flatnonzero(out)
    in_part = transform(inverse_pose(T_world_part), start[facing])
    hidden = part.blocked(in_part, unit[facing] @ T_world_part[:3, :3])
    if others is not None:
        hidden |= others.blocked(start[facing], unit[facing], distance[facing])
    out[facing[hidden]] = False
    return out


def samples_in_sight(
    part: PosedPart, samples: SurfaceSamples, camera: Camera, T: FloatArray, scene: ViewScene
) -> Visibility:
    """Return the surface samples in sight, and which of them lie beside the gripper.

    Parameters
    ----------
    part : the part, with ray casting
    samples : samples of its surface, CAD frame
    camera : camera of the view
    T : (4, 4) pose of the part in the world
    scene : scene without the part
    """
    points = transform(T, samples.points_mm)
    normals = samples.normals @ T[:3, :3].T
    towards = camera.position_mm - points
    unit = towards / lengths(towards)[:, None]
    seen: BoolArray = inner(unit, normals) > FLATTEST_COS
    pixels = np.round(camera.project(points)).astype(int)
    width, height = camera.size_px
    seen &= (pixels[:, 0] >= 0) & (pixels[:, 0] < width)
    seen &= (pixels[:, 1] >= 0) & (pixels[:, 1] < height)
    start = points + 0.05 * normals
    T_part_world = inverse_pose(T)
    index = np.nonzero(seen)[0]
    hidden = part.caster.blocked(transform(T_part_world, start[index]), unit[index] @ T[:3, :3])
    if scene.holder is not None:
        hidden |= scene.holder.blocked(start[index], unit[index])
    seen[index[hidden]] = False
    beside = np.zeros_like(seen)
    if scene.wide is not None:
        index = np.nonzero(seen)[0]
        beside[index] = scene.wide.blocked(start[index], unit[index])
    return Visibility(seen, beside, pixels)
