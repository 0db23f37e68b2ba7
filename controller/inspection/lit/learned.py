"""Appearance of good parts, view by view: the mean look of surfaces, and its scatter.

A prediction from the CAD model is least certain for light between faces, soft shadows and edges,
which good parts show best. The ratio of picture to prediction is stored, so that the prediction
accounts for most of a small change of pose; and the scatter of each filter's responses to it
between parts.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from controller.arrays import BoolArray, Float32Array, FloatArray, median
from controller.imaging import Camera, inverse_pose, rotation_angle, transform

from .brightness import Brightness
from .surface import Surface

# Offset before the logarithm, so that the sensor's noise in black areas has little effect.
DARK_GREY: Final = 3.0
# Largest deviation of a pose, as a factor of the learned poses' own reach.
BEYOND: Final = 1.5
MIN_REACH_MM: Final = 0.3  # least reach, from the repeatability of the arm
MIN_REACH_RAD: Final = float(np.radians(0.4))
SAME_DEPTH_MM: Final = 0.5  # largest difference of depth on the same surface
# Noise of a picture relative to the noisiest learned one, above which finish, lamp or focus differ.
OTHER_FINISH: Final = 1.6
# Calibrations of one camera agree in their pixel scale to this share, in the picture's centre to so
# many pixels.
SAME_SCALE, SAME_CENTRE_PX = 0.01, 10.0
COARSE: Final = 2  # nodes per value of the stored scatter, which changes slowly


@dataclass(frozen=True, eq=False, slots=True)
class LearnedPicture:
    """Learned picture of good parts in one view under one lamp.

    Attributes
    ----------
    mean : (h, w) logarithm of the ratio of picture to prediction; nan where too few parts show it
    scatter : (filters, h / 2, w / 2) standard deviation of each filter's responses between parts
    usual : median of a part's responses in these deviations; the largest of all parts
    """

    mean: Float32Array
    scatter: Float32Array
    usual: float


@dataclass(frozen=True, eq=False, slots=True)
class LearnedView:
    """One view of good parts.

    Attributes
    ----------
    camera : camera of the view
    T_world_part : (4, 4) pose of the grid
    corner_px : x, y of the grid's first node
    step_px : distance between its nodes
    depth_mm : (h, w) depth of the surface along the camera's axis, 0 off the part
    reach_mm, reach_rad : largest deviation of a learned pose from that of the grid
    parts : number of parts that it was learned from
    pictures : learned pictures by lamp
    """

    camera: Camera
    T_world_part: FloatArray
    corner_px: tuple[int, int]
    step_px: int
    depth_mm: Float32Array
    reach_mm: float
    reach_rad: float
    parts: int
    pictures: Mapping[str, LearnedPicture]

    def away(self, camera: Camera, T_world_part: FloatArray, p_part_mm: FloatArray) -> float:
        """Return the deviation of a pose in units of the allowed one; above 1 it is not served.

        Parameters
        ----------
        camera : camera of the other view
        T_world_part : (4, 4) pose there
        p_part_mm : (3,) middle of the part
        """
        mm, rad = pose_gap(camera, T_world_part, self.camera, self.T_world_part, p_part_mm)
        return max(
            mm / max(BEYOND * self.reach_mm, MIN_REACH_MM),
            rad / max(BEYOND * self.reach_rad, MIN_REACH_RAD),
        )


@dataclass(frozen=True, eq=False, slots=True)
class Known:
    """Appearance of good parts on the grid of another picture.

    Attributes
    ----------
    mask : (h, w) mask of the nodes where it is known
    mean : (h, w) logarithm of the ratio of picture to prediction
    scatter : (filters, h, w) standard deviation between parts
    usual : see `LearnedPicture`
    """

    mask: BoolArray
    mean: Float32Array
    scatter: Float32Array
    usual: float


def pose_gap(
    camera: Camera,
    T_world_part: FloatArray,
    other_camera: Camera,
    T_other: FloatArray,
    p_part_mm: FloatArray,
) -> tuple[float, float]:
    """Return the distance [mm] and the turn [rad] between two poses, each before its own camera.

    Parameters
    ----------
    camera, T_world_part : camera of a view, and (4, 4) pose of the part in it
    other_camera, T_other : the same of another view
    p_part_mm : (3,) point of the part at which the distance is taken
    """
    a = inverse_pose(camera.T_world_cam) @ T_world_part
    b = inverse_pose(other_camera.T_world_cam) @ T_other
    mm = float(np.linalg.norm(transform(a, p_part_mm[None]) - transform(b, p_part_mm[None])))
    return mm, rotation_angle(a[:3, :3] @ b[:3, :3].T)


def ratio(observed: Float32Array, brightness: Brightness) -> Float32Array:
    """Return the logarithm of the ratio of picture to prediction at each node (h, w).

    Parameters
    ----------
    observed : (h, w) grey
    brightness : brightness fitted to the picture
    """
    expected = np.maximum(brightness.predicted, np.float32(0)) + np.float32(DARK_GREY)
    return np.asarray(np.log((observed + np.float32(DARK_GREY)) / expected), np.float32)


def on_grid(
    view: LearnedView, surface: Surface, T_world_part: FloatArray
) -> tuple[Float32Array, Float32Array, BoolArray]:
    """Return the columns and rows on a view's grid of another picture's nodes, and a mask (h, w).

    Parameters
    ----------
    view : learned view
    surface : surface seen by the nodes of the other picture
    T_world_part : (4, 4) pose there
    """
    T = view.T_world_part @ inverse_pose(T_world_part)
    points = transform(T, surface.points)
    pixels = (view.camera.project(points) - view.corner_px) / view.step_px
    depth = (points - view.camera.position_mm) @ view.camera.T_world_cam[:3, 2]
    shape = surface.seen.shape
    columns, rows = (np.full(shape, -1.0, dtype=np.float32) for _ in range(2))
    columns[surface.seen], rows[surface.seen] = pixels.T
    near = np.zeros(shape, dtype=bool)
    there = cv2.remap(view.depth_mm, columns, rows, cv2.INTER_NEAREST, borderValue=0)
    near[surface.seen] = np.abs(there[surface.seen] - depth) < SAME_DEPTH_MM
    return columns, rows, near


def regridded(
    values: Float32Array, columns: Float32Array, rows: Float32Array, near: BoolArray
) -> Float32Array:
    """Return a map on another grid (h, w); nan where unknown.

    Parameters
    ----------
    values : the map; nan where unknown
    columns, rows, near : columns, rows and mask of the other grid's nodes, from `on_grid`
    """
    nan = float("nan")
    moved = cv2.remap(values, columns, rows, cv2.INTER_LINEAR, borderValue=nan)
    return np.where(near, moved, np.float32(nan))


def known_at(
    view: LearnedView, lamp: str, surface: Surface, T_world_part: FloatArray
) -> Known | None:
    """Return the appearance of good parts at the nodes of a picture; None for an unlearned lamp.

    Parameters
    ----------
    view : learned view
    lamp : lamp of the picture
    surface : surface seen by its nodes
    T_world_part : (4, 4) pose of the part in it
    """
    picture = view.pictures.get(lamp)
    if picture is None:
        return None
    columns, rows, near = on_grid(view, surface, T_world_part)
    mean = regridded(picture.mean, columns, rows, near)
    mask = np.isfinite(mean)
    u, v = columns / COARSE, rows / COARSE
    scatter = np.empty((len(picture.scatter), *mask.shape), dtype=np.float32)
    for one, target in zip(picture.scatter, scatter, strict=True):
        target[:] = cv2.remap(one, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return Known(mask, np.where(mask, mean, np.float32(0)), scatter, picture.usual)


def contrast(ratios: Float32Array, mean: Float32Array, mask: BoolArray) -> Float32Array:
    """Return the contrast (h, w) of a picture against good parts, as a share; 0 off the mask.

    The brightness of the whole picture is due to lamp and albedo, and is removed.

    Parameters
    ----------
    ratios, mean : (h, w) logarithms of the picture, and of good parts
    mask : (h, w) mask of the nodes where both are known
    """
    off = np.where(mask, ratios, np.float32(0)) - np.where(mask, mean, np.float32(0))
    if mask.any():
        off = np.where(mask, off - np.float32(median(off[mask])), np.float32(0))
    return np.asarray(np.expm1(np.clip(off, -3.0, 3.0)), np.float32)


@dataclass(frozen=True, eq=False, slots=True)
class Appearance:
    """Appearance of good parts in all learned views.

    Attributes
    ----------
    views : learned views
    p_part_mm : (3,) middle of the part
    """

    views: tuple[LearnedView, ...]
    p_part_mm: FloatArray

    def view(self, camera: Camera, T_world_part: FloatArray) -> LearnedView | None:
        """Return the learned view nearest to a pose; None if all are too far from it.

        Parameters
        ----------
        camera : camera of the view
        T_world_part : (4, 4) pose of the part
        """
        away = [
            view.away(camera, T_world_part, self.p_part_mm)
            if _is_alike(view.camera, camera)
            else np.inf
            for view in self.views
        ]
        if not away or min(away) > 1.0:
            return None
        return self.views[int(np.argmin(away))]


def _is_alike(one: Camera, other: Camera) -> bool:
    """Return True for cameras of the same kind and lens, also if calibrated anew."""
    is_near = np.allclose(one.K, other.K, rtol=SAME_SCALE, atol=SAME_CENTRE_PX)
    return one.size_px == other.size_px and bool(is_near)
