"""The scene of a view besides the part, and the surface samples in sight."""

from dataclasses import dataclass, replace
from typing import Final, cast

import cv2
import numpy as np
import trimesh

from controller.arrays import BoolArray, FloatArray, IntArray, inner, lengths
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

from ._connected import grow
from ._pose import PosedPart
from ._types import ViewTask, WorldBox

# Margin round the gripper, whose shape and place are known to about a millimetre.
HOLDER_MARGIN_PX: Final = 9
MASK_STEP_PX: Final = 2
# A gripper farther behind the part's surface than this is not in front of it.
BEHIND_MM: Final = 2.0
MAX_INCIDENCE_COS: Final = float(np.cos(np.radians(75.0)))
SPOT_RADIUS_MM: Final = 25.0  # assumed radius of a lamp that is given as one point
RING_SPREAD: Final = 0.12  # spread of a ring lamp's radius, as a share
# Offset of shadow rays from the surface, so that it does not shadow itself.
SHADOW_OFFSET_MM: Final = 0.05


@dataclass(frozen=True, eq=False, slots=True)
class ViewScene:
    """Scene of a view without the part, for the prediction."""

    holder: RayCaster | None
    holder_mask: BoolArray  # (height, width), grown
    panel: BoolArray  # (height, width), where the backlight panel is seen, shrunk


@dataclass(frozen=True, eq=False, slots=True)
class Visibility:
    """Visibility of samples, (n,) each, and their pixels (n, 2)."""

    free: BoolArray
    beside_gripper: BoolArray
    pixels: IntArray


def box_mesh(boxes: tuple[WorldBox, ...]) -> trimesh.Trimesh:
    """Return the triangles of one or more boxes in the world."""
    meshes = [trimesh.creation.box(extents=2 * box.half_mm, transform=box.T) for box in boxes]
    return cast("trimesh.Trimesh", trimesh.util.concatenate(meshes))


def make_scene(task: ViewTask) -> ViewScene:
    """Return the scene of a view: everything in it except the part."""
    width, height = task.camera.size_px
    holder: RayCaster | None = None
    holder_mask = np.zeros((height, width), dtype=bool)
    if task.holder:
        mesh = box_mesh(task.holder)
        holder = RayCaster(mesh)
        # With a margin of nine pixels, every fourth pixel is enough.
        maps = render_maps(holder, np.eye(4), task.camera, (0, 0, width, height), step_px=4)
        coarse = np.repeat(np.repeat(maps.mask, 4, axis=0), 4, axis=1)[:height, :width]
        holder_mask = grow(coarse, HOLDER_MARGIN_PX)
    panel = np.zeros((height, width), dtype=np.uint8)
    edges = [
        task.panel_mm[i] + t * (task.panel_mm[(i + 1) % 4] - task.panel_mm[i])
        for i in range(4)
        for t in np.linspace(0, 1, 20, endpoint=False)
    ]
    outline = task.camera.project(np.array(edges))
    cv2.fillPoly(panel, [np.round(outline).astype(np.int32)], 1)
    inner = cv2.erode(panel, np.ones((9, 9), np.uint8), borderValue=1)
    return ViewScene(holder, holder_mask, inner > 0)


def before_part(scene: ViewScene, maps: ViewMaps, camera: Camera) -> ViewScene:
    """Return a scene with the gripper masked only where it is in front of the part.

    A finger behind the part hides none of the part's face; beside the part and through its holes it
    remains in the mask.

    Parameters
    ----------
    scene : scene from `make_scene`
    maps : predicted picture of the part at its measured pose
    camera : camera of the view
    """
    if scene.holder is None:
        return scene
    x0, y0, x1, y1 = maps.roi
    held = render_maps(scene.holder, np.eye(4), camera, maps.roi, step_px=MASK_STEP_PX)
    depth_mm = maps.depth_mm[::MASK_STEP_PX, ::MASK_STEP_PX]
    seen = maps.mask[::MASK_STEP_PX, ::MASK_STEP_PX]
    front = held.mask & ~(seen & (held.depth_mm > depth_mm + BEHIND_MM))
    fine = np.repeat(np.repeat(front, MASK_STEP_PX, axis=0), MASK_STEP_PX, axis=1)
    mask = scene.holder_mask.copy()
    mask[y0:y1, x0:x1] = grow(fine[: y1 - y0, : x1 - x0], HOLDER_MARGIN_PX)
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
    seen: BoolArray = inner(unit, normals) > MAX_INCIDENCE_COS
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
    x, y = np.clip(pixels, 0, [width - 1, height - 1]).T
    return Visibility(seen, seen & scene.holder_mask[y, x], pixels)
