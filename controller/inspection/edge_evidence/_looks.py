"""Search for every edge of a part in a view's pictures: in place, elsewhere, or absent."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from controller.arrays import BoolArray, FloatArray, Grey, IndexArray
from controller.imaging import EdgeFits, RayCaster, inverse_pose, measure_edges, transform
from controller.imaging.levels import pixel_noise

from .._apart import is_turned
from .._pose import PosedPart
from .._scene import lamp_points, make_scene
from ..dimensions import (
    BACKLIT,
    MeasuringSettings,
    PosedView,
    Rays,
    place_rays,
    with_rotation,
    with_visibility,
)
from ..integrity import Allowances
from ..limits import SURE_SIGMAS
from ._edges import PartEdges

BEYOND_PX: Final = 2.5  # least reach of the search to either side of an edge
# Difference allowed between neighbours beyond noise, for broken edges and light.
FORM_PX: Final = 0.25
BESIDE: Final = 3  # number of neighbours compared on either side
MIN_AGREE: Final = 0.5  # least share of neighbours that must agree
# Least share of an edge's length visible in the picture; below it the edge is seen end-on.
END_ON: Final = 0.3
# Least visible share of a step along a wall's normal beside light through a hole.
OWN_WALL: Final = 0.5


class State(IntEnum):
    """State of an edge point in a picture."""

    HIDDEN = 0
    IN_PLACE = 1
    ELSEWHERE = 2
    ABSENT = 3


@dataclass(frozen=True, eq=False, slots=True)
class EdgeLook:
    """All edges in one picture.

    Attributes
    ----------
    view_id, lamp : view and lamp of the picture
    state : (n,) `State` of each point
    offset_px : (n,) place of the edge along its ray, out of the material; nan where none was found
    sigma_px : (n,) its standard error
    contrast : (n,) rise of brightness along the ray [grey]
    limit_px : (n,) largest offset of a good part
    least_mm : (n, 2) least displacement of the edge along either face that is beyond the limit; inf
        where it stays on its line in the picture
    faces_camera : (n, 2) True where either face is turned to the camera
    light_through : (n, 2) True where the panel is visible on the side that either face is turned to
    may_glare : (n,) True where a wall at a grazing angle may reflect the panel's light
    pixels, normals : (n, 2) origins and directions of the rays
    across : (n, 3) derivative of the offset by the edge's displacement, CAD frame [px/mm]
    may_shade : (n,) True where the gripper may block some of the light, or its shadow may end
    """

    view_id: str
    lamp: str
    state: NDArray[np.int8]
    offset_px: FloatArray
    sigma_px: FloatArray
    contrast: FloatArray
    limit_px: FloatArray
    least_mm: FloatArray
    faces_camera: BoolArray
    light_through: BoolArray
    may_glare: BoolArray
    pixels: FloatArray
    normals: FloatArray
    across: FloatArray
    may_shade: BoolArray

    def pixel_mm(self, points: IndexArray) -> float:
        """Return the pixel size at some points (k,) of edges."""
        return 1.0 / float(np.linalg.norm(self.across[points], axis=1).max())

    def only(self, points: BoolArray) -> "EdgeLook":
        """Return the look with only some of its points (n,); the others are hidden."""
        return replace(self, state=np.where(points, self.state, State.HIDDEN).astype(np.int8))


@dataclass(frozen=True, eq=False, slots=True)
class EdgeLooks:
    """All looks at a part's edges, with what bounds their errors.

    Attributes
    ----------
    edges : edges of the part
    every : looks, picture by picture
    T_world_part : (4, 4) measured pose of the part by view id
    pixel_mm : pixel size at the part in the closest view
    smallest_mm : size of the smallest defect
    allowances : allowed unevenness and false alarms
    settings : uncertainties from light
    """

    edges: PartEdges
    every: tuple[EdgeLook, ...]
    T_world_part: Mapping[str, FloatArray]
    pixel_mm: float
    smallest_mm: float
    allowances: Allowances
    settings: MeasuringSettings

    def is_turned(self, view_id: str, other_id: str) -> bool:
        """Return True if the part is turned between two views: two independent looks."""
        return is_turned(self.T_world_part[view_id], self.T_world_part[other_id])

    def wave_px(self, look: EdgeLook) -> float:
        """Return the standard deviation of neighbouring edge points by light and form [px].

        The effect of light on the edge as a whole is part of its course.
        """
        settings = self.settings
        light = settings.backlit_edge_px if look.lamp == BACKLIT else settings.lit_edge_px
        return float(np.hypot(light / 3.0, self.allowances.form_mm / self.pixel_mm))


def look_at_edges(
    part: PosedPart,
    edges: PartEdges,
    view: PosedView,
    allowed_mm: FloatArray,
    settings: MeasuringSettings,
) -> list[EdgeLook]:
    """Return the edges of a part in each of a view's pictures.

    Parameters
    ----------
    part : the part
    edges : edges of the part
    view : view with the pictures that count, and the part's pose
    allowed_mm : (f, 2) largest growth and shift of each face of a good part
    settings : prior uncertainties
    """
    camera, T = view.task.camera, view.T_world_part_measured
    scene = view.scene if view.scene is not None else make_scene(view.task)
    rays = place_rays(edges.curves, T, camera)
    rays = with_visibility(rays, edges.curves, part, T, camera, scene)
    pivot = transform(T, part.solid.centroid_mm[None])[0]
    rays = with_rotation(rays, T, pivot)
    across = rays.pose[:, :3] @ T[:3, :3]  # derivative of the offset by displacement, CAD frame
    # An edge seen end-on has no direction.
    length_px = rays.spacing_px
    full_px = edges.length_mm / camera.mm_per_px(pivot)
    is_long = length_px >= END_ON * full_px
    play_px = _play(edges, across, allowed_mm)
    pose_px = np.sqrt(
        np.maximum(np.einsum("ni,ij,nj->n", rays.pose, view.covariance, rays.pose), 0)
    )
    along = np.abs(np.einsum("nj,nkj->nk", across, edges.into))  # px/mm
    eye = transform(inverse_pose(T), camera.position_mm[None])[0]
    faces_camera = ((eye - edges.points_mm)[:, None, :] * edges.normals).sum(axis=2) > 0
    step = np.einsum("nj,nkj->nk", across, edges.normals)
    own = OWN_WALL * np.linalg.norm(across, axis=1)
    through = (rays.rising[:, None] * step) > own[:, None]
    out = []
    for lamp in view.lamps:
        is_backlit = lamp == BACKLIT
        picture = view.picture(lamp)
        light = settings.backlit_edge_px if is_backlit else settings.lit_edge_px
        u_px = np.sqrt(pose_px**2 + light**2 + settings.lens_px**2)
        limit = play_px + SURE_SIGMAS * u_px + rays.wall_px * is_backlit
        shows = ((rays.rising != 0) if is_backlit else rays.shows_lit) & is_long
        measured = _measured(picture, rays, shows, limit, edges, is_backlit, settings)
        out.append(
            EdgeLook(
                view.task.view_id, lamp, *measured, limit,
                _ratio(limit[:, None], along), faces_camera, through & is_backlit,
                (rays.wall_px > 0) & is_backlit,
                rays.pixels, rays.normals, across,
                _in_gripper_shadow(edges, view, lamp, scene.wide),
            )
        )  # fmt: skip
    return out


def _ratio(limit_px: FloatArray, along: FloatArray) -> FloatArray:
    """Return limits (n, 1) in displacements along faces (n, 2), whose derivatives are given."""
    out = np.full(along.shape, np.inf)
    np.divide(np.broadcast_to(limit_px, along.shape), along, out=out, where=along > 0)
    return out


def _in_gripper_shadow(
    edges: PartEdges, view: PosedView, lamp: str, gripper: RayCaster | None
) -> BoolArray:
    """Return a mask (n,) of edge points where a gripper may block some of a lamp's light."""
    out = np.zeros(len(edges.points_mm), dtype=bool)
    if lamp == BACKLIT or gripper is None:
        return out
    points = transform(view.T_world_part_measured, edges.points_mm)
    for source in lamp_points(next(one for one in view.task.lamps if one.name == lamp)):
        # Objects behind the lamp block none of its light.
        out |= gripper.blocked(points, source - points, 1.0)
    return out


def _play(edges: PartEdges, across: FloatArray, allowed_mm: FloatArray) -> FloatArray:
    """Return the largest offsets (n,) of a good part's edges along their rays [px]."""
    grown, moved = allowed_mm[edges.faces, 0], allowed_mm[edges.faces, 1]
    by = np.abs(np.einsum("nj,nkj->nk", across, edges.normals))
    size = np.linalg.norm(across, axis=1)[:, None]
    return np.asarray((by * grown + size * moved).sum(axis=1))


def _measured(
    picture: Grey,
    rays: Rays,
    shows: BoolArray,
    limit_px: FloatArray,
    edges: PartEdges,
    is_backlit: bool,
    settings: MeasuringSettings,
) -> tuple[NDArray[np.int8], FloatArray, FloatArray, FloatArray]:
    """Return the state, step position, standard error and contrast of each point, (n,) each."""
    count = len(shows)
    state = np.zeros(count, dtype=np.int8)
    offset, sigma, contrast = np.full(count, np.nan), np.full(count, np.inf), np.zeros(count)
    index = np.flatnonzero(shows)
    if len(index) == 0:
        return state, offset, sigma, contrast
    noise = pixel_noise(picture, None, 1)
    reach = np.minimum(rays.reach_px[index, 0 if is_backlit else 1], limit_px[index] + BEYOND_PX)
    rising = rays.rising[index] if is_backlit else None
    found = measure_edges(
        picture,
        rays.pixels[index],
        rays.normals[index],
        np.maximum(reach, BEYOND_PX),
        noise,
        rising,
    )
    good = found.is_found & (found.sigma_px <= settings.max_ray_px)
    if is_backlit and good.any():
        typical = float(np.median(np.abs(found.contrast[good])))
        good &= np.abs(found.contrast) >= settings.min_contrast_share * typical
    place = np.where(good, found.offset_px, np.nan)
    agrees = _agree(place, found, edges.edge[index], index)
    is_near = np.abs(place) <= limit_px[index]
    state[index] = np.select(
        [good & agrees & is_near, good], [State.IN_PLACE, State.ELSEWHERE], State.ABSENT
    )
    offset[index] = place
    sigma[index] = found.sigma_px
    contrast[index] = found.contrast
    return state, offset, sigma, contrast


def _agree(
    place: FloatArray, found: EdgeFits, edge: NDArray[np.intp], index: NDArray[np.intp]
) -> BoolArray:
    """Return a mask (n,) of found edges that continue in their neighbours, unlike texture."""
    count = len(place)
    agree = np.zeros(count)
    known = np.zeros(count)
    variance = np.square(np.minimum(found.sigma_px, 1.0))
    for shift in (*range(-BESIDE, 0), *range(1, BESIDE + 1)):
        other = np.clip(np.arange(count) + shift, 0, count - 1)
        same = (edge[other] == edge) & (np.abs(index[other] - index) == abs(shift))
        known += same
        room = FORM_PX + SURE_SIGMAS * np.sqrt(variance + variance[other])
        with np.errstate(invalid="ignore"):
            agree += same & (np.abs(place[other] - place) <= room)
    return np.asarray((known > 0) & (agree >= MIN_AGREE * known))
