"""Other edges and shadows expected beside the sought edge on a nominal part.

An edge found beside its nominal place may really be another feature in its proper place: the next
edge of the part, or the border of a shadow of the part or the gripper. The CAD model at its
measured pose, the gripper and the lamps predict where these are. A step there does not prove that
the sought edge has moved.
"""

from typing import Final

import numpy as np

from controller.arrays import BoolArray, FloatArray, inner
from controller.imaging import inverse_pose, transform

from .._pose import PosedPart
from .._scene import SHADOW_OFFSET_MM, ViewScene, lamp_points
from ._rays import NONE, Rays
from ._types import BACKLIT, PosedView

PLACE_STEP_PX: Final = 0.5  # distance between the tested places of a ray
# Largest width, in steps, of a shadow's border that counts as an edge.
SOFT: Final = 4
# Hidden share of the lamp that makes a border; a ring of six points loses a sixth at a time.
SHADED: Final = 0.1
APART_PX: Final = 1.5  # distance below which blur merges two steps into one
# Largest distance of a step from a shape that it lies on, for errors of pose and blur.
ON_PX: Final = 1.0
# Least share of the rays; most rays agree on one edge, while a crossing edge meets few of them.
MIN_RAY_SHARE: Final = 0.5
# Largest number of rays tested for a feature; each takes a hundred rays into the CAD model.
MAX_RAYS: Final = 40


def is_explained(
    part: PosedPart,
    scene: ViewScene,
    view: PosedView,
    lamp: str,
    rays: Rays,
    place_px: FloatArray,
) -> bool:
    """Return True if another edge of the nominal part explains the found edge.

    Parameters
    ----------
    part : nominal part
    scene : scene without the part
    view, lamp : view and lamp of the picture
    rays : (n,) rays that found the edge, at its nominal place
    place_px : (n,) places on them at which it was found
    """
    index = np.flatnonzero(np.abs(place_px) >= APART_PX)
    if 2 * len(index) < len(place_px):
        return False
    index = index[:: max(len(index) // MAX_RAYS, 1)]
    some, place = rays.chosen(index), place_px[index]
    reach = float(np.abs(place).max()) + ON_PX + PLACE_STEP_PX * SOFT
    count = int(np.ceil(reach / PLACE_STEP_PX))
    offsets: FloatArray = np.arange(-count, count + 1, dtype=np.float64) * PLACE_STEP_PX
    between = 0.5 * (offsets[1:] + offsets[:-1])
    is_step = _steps(part, scene, view, lamp, some, offsets)
    # The nominal place of the sought edge explains nothing.
    is_step &= np.abs(between) >= APART_PX - ON_PX
    is_step &= np.abs(between - place[:, None]) <= ON_PX
    return bool(is_step.any(axis=1).mean() >= MIN_RAY_SHARE)


def _steps(
    part: PosedPart,
    scene: ViewScene,
    view: PosedView,
    lamp: str,
    rays: Rays,
    offsets_px: FloatArray,
) -> BoolArray:
    """Return the intervals between places of rays that contain an edge or a shadow's border.

    Parameters
    ----------
    part, scene, view, lamp, rays : see `is_explained`
    offsets_px : (k,) the places, evenly spaced

    Returns
    -------
    is_step : (n, k - 1)
    """
    camera, T = view.task.camera, view.T_world_part_measured
    at = rays.pixels[:, None] + offsets_px[None, :, None] * rays.normals[:, None]
    shape = at.shape[:2]
    T_part_world = inverse_pose(T)
    eye = transform(T_part_world, camera.position_mm[None])[0]
    lines = camera.sight_lines(at.reshape(-1, 2)) @ T_part_world[:3, :3].T
    triangle, distance = part.caster.first_hit(eye, lines)
    face = np.where(triangle >= 0, part.solid.face_of_triangle[triangle], NONE).reshape(shape)
    if lamp == BACKLIT:
        is_part = face != NONE
        return np.asarray(is_part[:, 1:] != is_part[:, :-1])
    lit: FloatArray = np.zeros(len(lines))
    met = np.flatnonzero(triangle >= 0)
    normals = part.caster.normals[triangle[met]]
    normals = normals * -np.sign(inner(normals, lines[met]))[:, None]
    points = eye + distance[met, None] * lines[met] + SHADOW_OFFSET_MM * normals
    known = [lamp_points(one) for one in view.task.lamps if one.name == lamp]
    sources = transform(T_part_world, known[0]) if known else np.zeros((0, 3))
    for source in sources:
        towards = source - points
        is_open = inner(towards, normals) > 0
        is_open &= ~part.caster.blocked(points, towards)
        if scene.holder is not None:
            world = transform(T, points)
            # Objects behind the lamp take none of its light.
            is_open &= ~scene.holder.blocked(world, towards @ T[:3, :3].T, 1.0)
        lit[met] += is_open / len(sources)
    lit = lit.reshape(shape)
    is_step = face[:, 1:] != face[:, :-1]
    half = SOFT // 2
    change = np.abs(lit[:, SOFT:] - lit[:, :-SOFT])
    is_step[:, half:-half] |= 0.5 * (change[:, 1:] + change[:, :-1]) >= SHADED
    return np.asarray(is_step)
