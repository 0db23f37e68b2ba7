"""Depth of a round blind hole from the light of a lamp near the camera on its floor.

Along the axis of a hole, its floor appears at the same place whatever its depth. But the deeper the
floor, the less of a ring lamp's light passes the mouth to the floor's border: the lit area is an
overlap of discs. The depth is therefore fitted to the grey levels within the mouth, with a gain for
the unknown finish and an even light reflected by the walls. The lamp is a ring or a point, as the
cell file states.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter

from controller.arrays import BoolArray, FloatArray, Grey, square_to
from controller.cad import Recess, Solid
from controller.imaging import Camera, PointLamp, inverse_pose, transform

from .._pose import PosedPart
from ..characteristics.edges.rims import SAME_MM
from ..dimensions import PosedView
from ._depth import FloorLook

MIN_TILT_COS: Final = 0.9  # least cosine of incidence; below it the wall hides most of the floor
SUBPIXELS: Final = 2  # points per pixel in each direction
BLUR_PX: Final = 0.8  # blur of a lens in focus; with 0.5 or 1.2 a depth changes by some per cent
CLEAR_PX: Final = 1.5  # margin at the rim, which may have a chamfer or a burr
AROUND_PX: Final = (2.5, 4.5)  # range of distances from the rim of the surface about the mouth
# Largest relative scatter of that surface; more is a shadow, an edge or a highlight.
EVEN: Final = 0.15
RING_COUNT: Final = 16  # points that represent a ring lamp
RING_WIDTHS: Final = (0.9, 1.1)  # inner and outer radius, in radii of the ring
SHARES: Final = np.array([0.1, 0.25, 0.4, 0.5, 0.6, 0.7, 0.85, 1.0, 1.15, 1.4, 1.8, 2.5])
# Least explained share of the variance within the mouth; below it the light is not as predicted.
EXPLAINED: Final = 0.8
# Range of the floor's gain against the surface about the mouth, for one finish.
GAIN: Final = (0.6, 1.6)
EVEN_LIGHT: Final = 0.4  # largest light added by walls, as a share of that surface's
SMALLEST_SIGMAS: Final = 1.0 / 6.0  # standard deviation of a bell, in sizes of the defect it is for
MODEL: Final = 0.07  # standard uncertainty of a depth by the model, as a share of it


@dataclass(frozen=True, eq=False, slots=True)
class BlindBore:
    """A round hole with a plane floor: mouth (3,) and axis out of it, CAD frame; radius, depth."""

    mouth_mm: FloatArray
    axis: FloatArray
    radius_mm: float
    depth_mm: float


def blind_bore(solid: Solid, recess: Recess) -> BlindBore | None:
    """Return a recess as a round hole with a plane floor; None for any other recess.

    Parameters
    ----------
    solid : the part
    recess : recess of the part
    """
    b = solid.boundary
    walls = [solid.faces[wall] for wall in sorted(recess.walls)]
    one = walls[0]
    if recess.is_through or any(
        wall.kind != "cylinder"
        or not wall.concave
        or abs(wall.radius_mm - one.radius_mm) > SAME_MM
        or abs(float(wall.axis @ recess.axis)) < 1.0 - 1e-4
        for wall in walls
    ):
        return None
    floors = [solid.faces[face] for face in recess.bottom(solid)]
    area = np.pi * one.radius_mm**2
    if (
        len(floors) != 1
        or floors[0].kind != "plane"
        or abs(float(floors[0].normal @ recess.axis)) < 1.0 - 1e-4
        or abs(floors[0].area_mm2 / area - 1.0) > 0.05  # the hole continues below it
    ):
        return None
    vertices = np.asarray(solid.mesh.vertices, dtype=np.float64)
    rim = np.concatenate([vertices[b.chain_of(edge)] for edge in sorted(recess.mouths[0])])
    levels = rim @ recess.axis
    if np.ptp(levels) > SAME_MM:
        return None
    centre = one.centre_mm + (levels.mean() - float(one.centre_mm @ recess.axis)) * recess.axis
    return BlindBore(np.asarray(centre), recess.axis, float(one.radius_mm), recess.depth_mm)


def rise_by_light(
    part: PosedPart, bore: BlindBore, view: PosedView, lamp: str, smallest_mm: float
) -> FloorLook | None:
    """Return the height of a floor above nominal from its lit area; None if undetermined.

    Parameters
    ----------
    part : the part
    bore : bore of the part
    view : view with its pictures, and the part's pose
    lamp : lamp of the picture
    smallest_mm : size of the smallest defect
    """
    source = next((one for one in view.task.lamps if one.name == lamp), None)
    if source is None or lamp not in view.pictures.lit:
        return None
    T_part_world = inverse_pose(view.T_world_part_measured)
    axes = np.stack([*square_to(bore.axis), bore.axis])
    eye = (transform(T_part_world, view.task.camera.position_mm[None])[0] - bore.mouth_mm) @ axes.T
    sources = (transform(T_part_world, _points(source)) - bore.mouth_mm) @ axes.T
    if eye[2] < MIN_TILT_COS * np.linalg.norm(eye) or (sources[:, 2] <= 0).any():
        return None
    patch = _patch(part, bore, view, eye, axes, view.pictures.lit[lamp])
    if patch is None or not _is_open(part, view, bore, axes, sources):
        return None
    fits = [_fit(patch, sources, bore.radius_mm, s * bore.depth_mm) for s in SHARES]
    misfit, gain, even = np.array([one[1:] for one in fits]).T
    best = int(np.argmin(misfit))
    if best in (0, len(SHARES) - 1) or misfit[best] > (1.0 - EXPLAINED) * patch.variance:
        return None
    if not GAIN[0] <= gain[best] <= GAIN[1] or not -0.1 <= even[best] <= EVEN_LIGHT:
        return None
    # Pixels within the blur share one error.
    count = max(int(patch.inside.sum()) / (4.0 * np.pi * BLUR_PX**2), 4.0)
    worse = count * (misfit / misfit[best] - 1.0)
    near = SHARES[worse <= 1.0]
    share, half = _vertex(SHARES[best - 1 : best + 2], worse[best - 1 : best + 2])
    spread = max(half, 0.5 * float(np.ptp(near)), MODEL * share)
    return FloorLook(
        view.task.view_id,
        lamp,
        (1.0 - share) * bore.depth_mm,
        spread * bore.depth_mm,
        is_by_light=True,
        uneven=_uneven(patch, fits[best][0], smallest_mm),
    )


@dataclass(frozen=True, eq=False, slots=True)
class _Patch:
    """Grey levels about a mouth, with those used, lines of sight in the bore's frame, variance."""

    grey: FloatArray
    inside: BoolArray
    eye: FloatArray
    lines: FloatArray
    around: float
    pixel_mm: float

    @property
    def variance(self) -> float:
        return float(self.grey[self.inside].var())


def _points(lamp: PointLamp) -> FloatArray:
    """Return points (n, 3) that represent a lamp."""
    points = np.asarray(lamp.points_mm, dtype=np.float64)
    if len(points) < 3:
        return points
    middle = points.mean(axis=0)
    arm = points - middle
    normal = np.linalg.svd(arm)[2][2]
    first = arm[0] / np.linalg.norm(arm[0])
    second = np.cross(normal, first)
    turn = np.arange(RING_COUNT) * (2 * np.pi / RING_COUNT)
    ring = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second
    radius = float(np.linalg.norm(arm, axis=1).mean())
    return np.concatenate([middle + width * radius * ring for width in RING_WIDTHS])


def _patch(
    part: PosedPart,
    bore: BlindBore,
    view: PosedView,
    eye: FloatArray,
    axes: FloatArray,
    picture: Grey,
) -> _Patch | None:
    """Return the pixels about a mouth; None if they are few, hidden or unevenly lit."""
    camera: Camera = view.task.camera
    T = view.T_world_part_measured
    centre = transform(T, bore.mouth_mm[None])
    middle = camera.project(centre)[0]
    radius_px = bore.radius_mm / camera.mm_per_px(centre[0])
    x0, y0 = np.round(middle).astype(int)
    half = int(np.ceil(radius_px + AROUND_PX[1])) + 1
    width, height = camera.size_px
    if not (half <= x0 < width - half and half <= y0 < height - half):
        return None
    if (
        view.scene is not None
        and view.scene.holder_mask[y0 - half : y0 + half + 1, x0 - half : x0 + half + 1].any()
    ):
        return None
    size = 2 * half + 1
    fine = (np.arange(size * SUBPIXELS) - 0.5 * (size * SUBPIXELS - 1)) / SUBPIXELS
    x, y = np.meshgrid(x0 + fine, y0 + fine)
    sight = camera.sight_lines(np.column_stack([x.ravel(), y.ravel()])) @ T[:3, :3] @ axes.T
    at_mouth = eye - (eye[2] / sight[:, 2])[:, None] * sight
    reach = np.hypot(at_mouth[:, 0], at_mouth[:, 1]).reshape(size, SUBPIXELS, size, SUBPIXELS)
    off_px = (reach.mean(axis=(1, 3)) - bore.radius_mm) / camera.mm_per_px(centre[0])
    grey = picture[y0 - half : y0 + half + 1, x0 - half : x0 + half + 1].astype(np.float64)
    inside = off_px < -CLEAR_PX
    around = grey[(off_px > AROUND_PX[0]) & (off_px < AROUND_PX[1])]
    level = float(np.median(around))
    if inside.sum() < 4 * np.pi * BLUR_PX**2 or around.std() > EVEN * max(level, 1.0):
        return None
    pixel_mm = camera.mm_per_px(centre[0])
    return _Patch(grey, np.asarray(inside), eye, sight, level, pixel_mm)


def _is_open(
    part: PosedPart, view: PosedView, bore: BlindBore, axes: FloatArray, sources: FloatArray
) -> bool:
    """Return True if nothing lies between the mouth and the lamp, or the camera."""
    eye = (
        transform(inverse_pose(view.T_world_part_measured), view.task.camera.position_mm[None])[0]
        - bore.mouth_mm
    ) @ axes.T
    ends = np.vstack([sources[:: max(len(sources) // 12, 1)], eye])
    turn = np.arange(8) * (np.pi / 4)
    starts = 0.7 * bore.radius_mm * np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    starts[:, 2] = SAME_MM
    origins = np.repeat(starts, len(ends), axis=0)
    ways = np.tile(ends, (len(starts), 1)) - origins
    p_mm, way = origins @ axes + bore.mouth_mm, ways @ axes
    if part.caster.blocked(p_mm, way, 1.0).any():
        return False
    holder = view.scene.holder if view.scene is not None else None
    if holder is None:
        return True
    R = view.T_world_part_measured[:3, :3]
    return not holder.blocked(transform(view.T_world_part_measured, p_mm), way @ R.T, 1.0).any()


def _fit(
    patch: _Patch, sources: FloatArray, radius_mm: float, depth_mm: float
) -> tuple[FloatArray, float, float, float]:
    """Return what a depth leaves of the grey levels within the mouth (k,), and how it fits.

    Parameters
    ----------
    patch : grey levels about the mouth
    sources : (n, 3) points of the lamp, bore's frame
    radius_mm, depth_mm : radius and depth of the hole

    Returns
    -------
    off, misfit : what is left [grey], and its mean square [grey²]
    gain, even : of the floor, and even light on it, in the surface about the mouth
    """
    size = len(patch.grey)
    light = _light(patch.eye, patch.lines, sources, radius_mm, depth_mm)
    seen = gaussian_filter(light.reshape(size * SUBPIXELS, size * SUBPIXELS), BLUR_PX * SUBPIXELS)
    seen = seen.reshape(size, SUBPIXELS, size, SUBPIXELS).mean(axis=(1, 3))[patch.inside]
    grey = patch.grey[patch.inside]
    design = np.column_stack([seen, np.ones(len(seen))])
    (gain, even), *_ = np.linalg.lstsq(design, grey, rcond=None)
    off = np.asarray(grey - design @ [gain, even])
    around = max(patch.around, 1.0)
    return off, float(np.mean(np.square(off))), float(gain) / around, float(even) / around


def _uneven(patch: _Patch, off: FloatArray, smallest_mm: float) -> float:
    """Return how far the light at any place of the smallest defect's size is off a depth's.

    Parameters
    ----------
    patch : grey levels about the mouth
    off : (k,) what the depth leaves of those within it
    smallest_mm : size of the smallest defect
    """
    whole = np.zeros_like(patch.grey)
    whole[patch.inside] = off
    # a bell that has most of its weight on a disc of that size
    width_px = SMALLEST_SIGMAS * smallest_mm / patch.pixel_mm
    weight = gaussian_filter(patch.inside.astype(np.float64), width_px)
    mean = gaussian_filter(whole, width_px)[patch.inside] / weight[patch.inside]
    return float(np.abs(mean).max()) / max(patch.around, 1.0)


def _light(
    eye: FloatArray, lines: FloatArray, sources: FloatArray, radius_mm: float, depth_mm: float
) -> FloatArray:
    """Return the light (n,) where lines of sight end; 1 on the surface about the mouth.

    Parameters
    ----------
    eye, lines : (3,) camera and (n, 3) its lines of sight, bore's frame: mouth at 0, axis up
    sources : (m, 3) points of the lamp
    radius_mm, depth_mm : radius and depth of the hole
    """
    way = lines / -lines[:, 2:]
    mouth = eye + eye[2] * way
    floor = mouth + depth_mm * way
    on_floor = np.hypot(floor[:, 0], floor[:, 1]) < radius_mm
    is_in = np.hypot(mouth[:, 0], mouth[:, 1]) < radius_mm
    a = np.maximum((way[:, :2] ** 2).sum(axis=1), 1e-12)
    half_b = (mouth[:, :2] * way[:, :2]).sum(axis=1)
    c = (mouth[:, :2] ** 2).sum(axis=1) - radius_mm**2
    down = (-half_b + np.sqrt(np.maximum(half_b**2 - a * c, 0.0))) / a
    wall = mouth + down[:, None] * way
    at = np.where(on_floor[:, None], floor, wall)[is_in]
    normal = np.where(on_floor[:, None], [0.0, 0.0, 1.0], wall * [-1.0, -1.0, 0.0] / radius_mm)
    normal = normal[is_in]
    towards = sources[None] - at[:, None]
    squared = np.einsum("nmk,nmk->nm", towards, towards)
    cosine = np.einsum("nmk,nk->nm", towards, normal) / np.sqrt(squared)
    through = at[:, None, :2] - (at[:, 2:] / towards[:, :, 2])[:, :, None] * towards[:, :, :2]
    gets_in = np.hypot(through[..., 0], through[..., 1]) < radius_mm
    light = (np.clip(cosine, 0.0, None) * gets_in / squared).sum(axis=1)
    length = np.linalg.norm(sources, axis=1)
    plain = float((sources[:, 2] / length**3).sum())
    out = np.ones(len(lines))
    out[is_in] = light / plain
    return out


def _vertex(shares: FloatArray, worse: FloatArray) -> tuple[float, float]:
    """Return the minimum of a parabola through three points, and the step for a rise by one."""
    a, b, _ = np.polyfit(shares, worse, 2)
    if a <= 0:
        return float(shares[1]), float(np.ptp(shares))
    return float(np.clip(-b / (2 * a), shares[0], shares[2])), float(1.0 / np.sqrt(a))
