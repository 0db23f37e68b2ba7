"""Pictures that a view would give of a good, matt part: what the inspection is forecast by.

They are judged by the inspection itself, so that a forecast has its numbers. The light is that of
the lamp's centre, with hard shadows and none thrown back between surfaces: where light is uncertain
the inspection finds by bounds of its own, which do not depend on the pictures.
"""

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.arrays import (
    BoolArray,
    Float32Array,
    FloatArray,
    Grey,
    inner,
    lengths,
    on_each_pixel,
)
from controller.cad import surface_normals
from controller.imaging import (
    PointLamp,
    RayCaster,
    inverse_pose,
    meet_part,
    render_maps,
    transform,
    view_roi,
)

from ._pose import PosedPart
from ._scene import SHADOW_OFFSET_MM, box_mesh, lamp_reaches
from ._types import ViewPictures, ViewTask

FINE: Final = 2  # samples to a pixel, each way
BLUR_PX: Final = 0.6  # blur of a good lens, beside that of the pixels
MARGIN_PX: Final = 8  # round the part, for the blur
HOLDER_STEP_PX: Final = 2  # the gripper is left out with a margin of several pixels
PANEL_GREY: Final = 200.0
DARK_GREY: Final = 6.0
MATT_GREY: Final = 120.0  # of a surface square to a lamp, at the part's distance
WALL_GREY: Final = 25.0
NOISE_GREY: Final = 1.0


def predict_pictures(part: PosedPart, task: ViewTask) -> ViewPictures:
    """Return the pictures that a view would give of a good part at its expected pose.

    Parameters
    ----------
    part : the CAD model
    task : the view

    Raises
    ------
    ValueError : the part is out of the picture
    """
    T, camera = task.T_world_part_expected, task.camera
    roi = view_roi(np.asarray(part.solid.mesh.vertices), T, camera, MARGIN_PX)
    if roi is None:
        raise ValueError(f"{task.view_id}: the part is out of the picture")
    x0, y0, x1, y1 = roi
    # between pixels a line of sight is the mean of its neighbours', to a thousandth of a pixel
    lines = cv2.resize(camera.sight_line_table[y0:y1, x0:x1], None, fx=FINE, fy=FINE)
    ways = lines.reshape(-1, 3).astype(np.float64)
    triangle, depth_mm = meet_part(part.caster, T, camera.position_mm, ways)
    holder = RayCaster(box_mesh(task.holder)) if task.holder else None
    held, held_mm = _held(task, holder)
    on_part = triangle >= 0
    if holder is not None:
        before = np.repeat(np.repeat(held_mm[y0:y1, x0:x1], FINE, axis=0), FINE, axis=1).ravel()
        on_part &= ~((before > 0) & (before < depth_mm))
    seen = np.flatnonzero(on_part)
    rng = np.random.default_rng(0)

    def taken(whole: Float32Array, of_part: Float32Array | float) -> Grey:
        """Return a picture of part and surroundings with blur and noise."""
        fine = np.repeat(np.repeat(whole[y0:y1, x0:x1], FINE, axis=0), FINE, axis=1)
        fine.reshape(-1)[seen] = of_part
        out = whole.copy()
        out[y0:y1, x0:x1] = cv2.resize(fine, (x1 - x0, y1 - y0), interpolation=cv2.INTER_AREA)
        noise = rng.normal(0.0, NOISE_GREY, out.shape).astype(np.float32)
        grey = cv2.GaussianBlur(out, (0, 0), BLUR_PX) + noise
        return np.asarray(np.clip(grey.round(), 0, 255), np.uint8)

    panel = np.full(held.shape, DARK_GREY, dtype=np.float32)
    cv2.fillPoly(panel, [camera.project(task.panel_mm).round().astype(np.int32)], PANEL_GREY)
    panel[held] = DARK_GREY
    wall = np.full(held.shape, WALL_GREY, dtype=np.float32)
    points = camera.position_mm + ways[seen] * depth_mm[seen][:, None]
    lit = {
        lamp.name: taken(wall, _matt(part, T, lamp, points, triangle[seen], holder))
        for lamp in task.lamps
    }
    return ViewPictures(taken(panel, DARK_GREY), lit)


def _held(task: ViewTask, holder: RayCaster | None) -> tuple[BoolArray, Float32Array]:
    """Return a mask of the pixels that show gripper and arm, and their depth, 0 for none [mm]."""
    width, height = task.camera.size_px
    shape = (height, width)
    if holder is None:
        return np.zeros(shape, dtype=bool), np.zeros(shape, np.float32)
    maps = render_maps(holder, np.eye(4), task.camera, (0, 0, width, height), HOLDER_STEP_PX)
    depth = np.where(maps.mask, maps.depth_mm, 0.0).astype(np.float32)
    return (
        on_each_pixel(maps.mask, HOLDER_STEP_PX, shape),
        on_each_pixel(depth, HOLDER_STEP_PX, shape),
    )


def _matt(
    part: PosedPart,
    T_world_part: FloatArray,
    lamp: PointLamp,
    points: FloatArray,
    triangles: NDArray[np.integer],
    holder: RayCaster | None,
) -> Float32Array:
    """Return the brightness of matt surface points (n, 3) on triangles (n,) under a lamp [grey]."""
    solid, R = part.solid, T_world_part[:3, :3]
    T_part_world = inverse_pose(T_world_part)
    facets = np.asarray(solid.mesh.face_normals)[triangles]
    faces = solid.face_of_triangle[triangles]
    normals = surface_normals(solid.faces, faces, transform(T_part_world, points), facets) @ R.T
    source = lamp.points_mm.mean(axis=0)
    start = points + SHADOW_OFFSET_MM * facets @ R.T
    towards = source - start
    distance = lengths(towards)
    cosine = inner(towards / distance[:, None], normals)
    is_lit = lamp_reaches(part.caster, T_world_part, holder, start, towards, facets @ R.T)
    reference = float(np.linalg.norm(source - T_world_part[:3, 3]))
    bright = np.where(is_lit & (cosine > 0), MATT_GREY * cosine * (reference / distance) ** 2, 0.0)
    return np.float32(DARK_GREY) + bright.astype(np.float32)
