"""Other edges and shadows expected beside the sought edge on a nominal part.

An edge found beside its nominal place may really be another feature in its proper place: the next
edge of the part, or the border of a shadow of the part or the gripper. The CAD model at its
measured pose, the gripper and the lamps predict where these are. A step there does not prove that
the sought edge has moved. A shadow that ends too near to the edge to be told from it moves the step
by up to its distance, and U covers that.
"""

from typing import Final

import numpy as np

from controller.arrays import BoolArray, FloatArray, Int32Array, inner, median
from controller.imaging import EdgeFits, inverse_pose, transform

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
# Places on one side of an edge at which its light is compared; a step nearer than the last of them
# may merge with the edge's, or be found in its place by a look that reaches as far.
LIGHT_AT_PX: Final = np.array([0.5, 1.5, 2.5])
SHADOW_SPACING_PX: Final = 2.0  # distance between the rays whose light is predicted


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


def shadow_shifts_px(
    part: PosedPart,
    scene: ViewScene,
    view: PosedView,
    lamp: str,
    rays: Rays,
    found: EdgeFits,
) -> FloatArray:
    """Return how far, and to which side, shadows that end beside an edge may have moved it [px].

    A step of light at a distance d from the edge, as high as a share of the step that was found,
    moves it by that share of d: all the way where the shadow is as dark as the edge's other side.

    Parameters
    ----------
    part : nominal part
    scene : scene without the part
    view, lamp : view and lamp of the picture
    rays : (n,) rays across the edge, at its nominal place
    found : (n,) steps found along them

    Returns
    -------
    shift_px : (n,) 0 where the light is even
    """
    shift: FloatArray = np.zeros(len(rays.pixels))
    if len(shift) == 0:
        return shift
    every = max(round(SHADOW_SPACING_PX / max(median(rays.spacing_px), 1e-9)), 1)
    index = np.arange(0, len(shift), every)
    offsets: FloatArray = np.concatenate([-LIGHT_AT_PX, LIGHT_AT_PX])
    face, lit = _faces_and_light(part, scene, view, lamp, rays.chosen(index), offsets)
    nearest = np.searchsorted(0.5 * (index[1:] + index[:-1]), np.arange(len(shift)))
    face, lit = face[nearest], lit[nearest]
    count = len(LIGHT_AT_PX)
    height = np.maximum(np.abs(found.contrast), 1e-9)
    for side, at, tone in (
        (-1.0, slice(count), found.level),
        (1.0, slice(count, None), found.level + found.contrast),
    ):
        beside, light = face[:, at], lit[:, at]
        change = np.abs(light - light[:, :1]) / np.maximum(np.maximum(light, light[:, :1]), 1e-9)
        is_border = (change >= SHADED) & (beside == beside[:, :1])
        first = np.argmax(is_border, axis=1)
        share = change[np.arange(len(shift)), first] * np.nan_to_num(tone) / height
        far = 0.5 * (LIGHT_AT_PX[first] + LIGHT_AT_PX[np.maximum(first - 1, 0)])
        moved = np.where(is_border.any(axis=1), np.minimum(share, 1.0) * far, 0.0)
        shift = np.where(moved > np.abs(shift), side * moved, shift)
    return shift


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
    face, lit = _faces_and_light(part, scene, view, lamp, rays, offsets_px)
    if lamp == BACKLIT:
        is_part = face != NONE
        return np.asarray(is_part[:, 1:] != is_part[:, :-1])
    is_step = face[:, 1:] != face[:, :-1]
    half = SOFT // 2
    change = np.abs(lit[:, SOFT:] - lit[:, :-SOFT])
    is_step[:, half:-half] |= 0.5 * (change[:, 1:] + change[:, :-1]) >= SHADED
    return np.asarray(is_step)


def _faces_and_light(
    part: PosedPart,
    scene: ViewScene,
    view: PosedView,
    lamp: str,
    rays: Rays,
    offsets_px: FloatArray,
) -> tuple[Int32Array, FloatArray]:
    """Return the faces (n, k) at places of rays, and the share of a lamp that shines there.

    Before the panel, and beside the part, that share is 0.

    Parameters
    ----------
    part, scene, view, lamp, rays : see `is_explained`
    offsets_px : (k,) the places
    """
    camera, T = view.task.camera, view.T_world_part_measured
    at = rays.pixels[:, None] + offsets_px[None, :, None] * rays.normals[:, None]
    shape = at.shape[:2]
    T_part_world = inverse_pose(T)
    eye = transform(T_part_world, camera.position_mm[None])[0]
    lines = camera.sight_lines(at.reshape(-1, 2)) @ T_part_world[:3, :3].T
    triangle, distance = part.caster.first_hit(eye, lines)
    face = np.where(triangle >= 0, part.solid.face_of_triangle[triangle], NONE).astype(np.int32)
    lit: FloatArray = np.zeros(len(lines))
    known = [lamp_points(one) for one in view.task.lamps if one.name == lamp]
    sources = transform(T_part_world, known[0]) if known else np.zeros((0, 3))
    met = np.flatnonzero(triangle >= 0)
    normals = part.caster.normals[triangle[met]]
    normals = normals * -np.sign(inner(normals, lines[met]))[:, None]
    points = eye + distance[met, None] * lines[met] + SHADOW_OFFSET_MM * normals
    for source in sources:
        towards = source - points
        is_open = inner(towards, normals) > 0
        is_open &= ~part.caster.blocked(points, towards)
        if scene.holder is not None:
            world = transform(T, points)
            # Objects behind the lamp take none of its light.
            is_open &= ~scene.holder.blocked(world, towards @ T[:3, :3].T, 1.0)
        lit[met] += is_open / len(sources)
    return face.reshape(shape), lit.reshape(shape)
