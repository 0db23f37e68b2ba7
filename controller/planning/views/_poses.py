"""Poses of the part before the inspection camera for each direction and camera roll."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.cad import Solid, SurfaceSamples
from controller.imaging import Camera

from ..model import CellLayout
from ._arm import ViewCone, seen_extent
from .visibility import even_sphere, in_picture

ROLL_COUNT = 12
OUTER_COUNT = 400
RIM_COUNT = 72


@dataclass(frozen=True, slots=True, eq=False)
class Showing:
    """Poses of the part held up for each direction and roll, for any grasp.

    Attributes
    ----------
    T_world_part : (v, r, 4, 4), pose of `view_poses`
    inside : (v, r) bool, the whole part is in the picture
    partly : direction -> (r, n) samples in the picture, where no roll has the whole part in it
    cone : cone that contains all lines from the camera to the part
    extent : (v, r, k) extent of its samples in the picture each way, of `seen_extent`
    """

    T_world_part: FloatArray
    inside: BoolArray
    partly: Mapping[int, BoolArray]
    cone: ViewCone
    extent: FloatArray


def view_poses(
    solid: Solid, layout: CellLayout, vectors: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return the part's pose at the station for each direction and camera roll.

    Parameters
    ----------
    solid : the part
    layout : the cell; its centre of mass is held at the station
    vectors : (v, 3) unit, from the part to the camera, CAD frame

    Returns
    -------
    T_world_part : (v, r, 4, 4)
    inside : (v, r) bool, the whole part is inside the picture
    """
    camera = layout.inspection
    towards = camera.position_mm - layout.station_mm
    towards = towards / np.linalg.norm(towards)
    right = camera.T_world_cam[:3, 0]
    right = right - towards * (right @ towards)
    right = right / np.linalg.norm(right)
    at_station = np.column_stack([right, np.cross(towards, right), towards])
    angle = 2 * np.pi * np.arange(ROLL_COUNT) / ROLL_COUNT
    turn = np.zeros((ROLL_COUNT, 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
    turn[:, 1, 0], turn[:, 0, 1] = np.sin(angle), -np.sin(angle)
    turn[:, 2, 2] = 1.0
    helper = np.eye(3)[np.argmin(np.abs(vectors), axis=1)]
    u = helper - vectors * np.einsum("vi,vi->v", helper, vectors)[:, None]
    u = u / np.linalg.norm(u, axis=1)[:, None]
    on_part = np.stack([u, np.cross(vectors, u), vectors], axis=2)
    T = np.zeros((len(vectors), ROLL_COUNT, 4, 4))
    T[..., 3, 3] = 1.0
    T[..., :3, :3] = np.einsum("ij,rjk,vlk->vril", at_station, turn, on_part)
    T[..., :3, 3] = layout.station_mm - T[..., :3, :3] @ solid.centroid_mm
    return T, _whole(solid, camera, T)


def _whole(solid: Solid, camera: Camera, T: FloatArray) -> BoolArray:
    """Return a mask (v, r) of the poses (v, r, 4, 4) with the whole part in the picture."""
    hull = solid.hull_mm - solid.centroid_mm
    centre = T[0, 0, :3, :3] @ solid.centroid_mm + T[0, 0, :3, 3]
    radius = float(np.linalg.norm(hull, axis=1).max())
    if in_picture(camera, _rim_of_ball(camera, centre, radius)).all():
        return np.ones(T.shape[:2], dtype=bool)  # whichever way it is turned
    # of a fine mesh the points farthest out, to less than a pixel
    outer = hull[np.unique(np.argmax(even_sphere(OUTER_COUNT) @ hull.T, axis=1))]
    points = np.einsum("vrij,kj->vrki", T[..., :3, :3], outer) + centre
    return np.asarray(in_picture(camera, points).all(axis=2))


def _rim_of_ball(camera: Camera, centre: FloatArray, radius: float) -> FloatArray:
    """Return points round the outline of a ball as the camera sees it (k, 3)."""
    along = centre - camera.position_mm
    distance = float(np.linalg.norm(along))
    along = along / distance
    side = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    side = side / np.linalg.norm(side)
    sine = min(radius / distance, 1.0)
    angle = np.linspace(0.0, 2 * np.pi, RIM_COUNT, endpoint=False)[:, None]
    out = np.cos(angle) * side + np.sin(angle) * np.cross(along, side)
    return np.asarray(centre - radius * sine * along + radius * np.sqrt(1.0 - sine**2) * out)


def hold_up(
    solid: Solid, samples: SurfaceSamples, layout: CellLayout, vectors: FloatArray
) -> Showing:
    """Return the part's poses for each direction and roll, and the samples in each picture.

    Of a part larger than the picture only the samples inside it count.

    Parameters
    ----------
    solid : the part
    samples : samples of its surface
    layout : the cell, with inspection camera and station
    vectors : (v, 3) unit, from the part to the camera, CAD frame
    """
    T, inside = view_poses(solid, layout, vectors)
    partly = {}
    for v in np.flatnonzero(~inside.any(axis=1)):
        points = np.einsum("rij,nj->rni", T[v, :, :3, :3], samples.points_mm)
        partly[int(v)] = in_picture(layout.inspection, points + T[v, :, None, :3, 3])
    radius = float(np.linalg.norm(solid.mesh.vertices - solid.centroid_mm, axis=1).max())
    return Showing(
        T, inside, partly, ViewCone.of_station(layout, radius), _extent(samples, layout, T)
    )


def _extent(samples: SurfaceSamples, layout: CellLayout, T: FloatArray) -> FloatArray:
    """Return the part's extent in the picture by direction, (v, r, k); see `seen_extent`."""
    flat = T[:, 0]
    points = np.einsum("vij,nj->vni", flat[:, :3, :3], samples.points_mm) + flat[:, None, :3, 3]
    first = seen_extent(layout, points)
    # a roll of the part about the sight line turns its picture by as many ways
    return np.stack([np.roll(first, r, axis=1) for r in range(ROLL_COUNT)], axis=1)
