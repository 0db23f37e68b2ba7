"""Appearance of good parts, view by view: what a surface looks like, and how far good ones differ.

Light that goes from face to face, soft shadows and edges are what a prediction from the CAD model
knows least, and what good parts show best. What is kept of them is the ratio of picture to
prediction, so that small changes of the pose are mostly in the prediction, and the scatter of each
filter's answers to it from part to part.
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

DARK_GREY: Final = 3.0  # added before the logarithm: what is black may differ by the sensor's noise
DARKEST_GREY: Final = 6.0  # a surface darker than this shows nothing
# Poses farther from the learned ones than these are, by this factor, are not served.
BEYOND: Final = 1.5
MIN_REACH_MM: Final = 0.3  # of the arm: what one commanded pose comes to
MIN_REACH_RAD: Final = float(np.radians(0.4))
SAME_DEPTH_MM: Final = 0.5  # farther behind or before the learned surface is another surface
# Picture noisier than the noisiest learned one by this factor: another finish, lamp or focus.
OTHER_FINISH: Final = 1.6
COARSE: Final = 2  # nodes to a value of the stored scatter, which changes slowly


@dataclass(frozen=True, eq=False, slots=True)
class LearnedPicture:
    """One lamp's picture of good parts in one view.

    Attributes
    ----------
    mean : (h, w) logarithm of the ratio of picture to prediction; nan where too few parts show it
    scatter : (filters, h / 2, w / 2) standard deviation of each filter's answers between parts
    usual : of a part's answers, by these deviations, the median; the largest of the parts
    """

    mean: Float32Array
    scatter: Float32Array
    usual: float


@dataclass(frozen=True, eq=False, slots=True)
class LearnedView:
    """One view of good parts.

    Attributes
    ----------
    camera : that saw it
    T_world_part : (4, 4) pose of the grid
    corner_px : x, y of the grid's first node
    step_px : distance of its nodes
    depth_mm : (h, w) of the surface along the camera's axis, 0 where the part is not
    reach_mm, reach_rad : farthest learned pose from that of the grid
    parts : how many it was learned from
    pictures : by lamp
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
        """Return how far a pose is beyond the learned ones; above 1 it is not served.

        Parameters
        ----------
        camera : of the other view
        T_world_part : (4, 4) pose there
        p_part_mm : (3,) middle of the part
        """
        T = inverse_pose(camera.T_world_cam) @ T_world_part
        own = inverse_pose(self.camera.T_world_cam) @ self.T_world_part
        mm = float(np.linalg.norm(transform(T, p_part_mm[None]) - transform(own, p_part_mm[None])))
        rad = rotation_angle(T[:3, :3] @ own[:3, :3].T)
        return max(
            mm / max(BEYOND * self.reach_mm, MIN_REACH_MM),
            rad / max(BEYOND * self.reach_rad, MIN_REACH_RAD),
        )


@dataclass(frozen=True, eq=False, slots=True)
class Known:
    """Appearance of good parts on the grid of another picture.

    Attributes
    ----------
    mask : (h, w) where it is known
    mean : (h, w) logarithm of the ratio of picture to prediction
    scatter : (filters, h, w) between parts
    usual : see `LearnedPicture`
    """

    mask: BoolArray
    mean: Float32Array
    scatter: Float32Array
    usual: float


def ratio(observed: Float32Array, brightness: Brightness) -> Float32Array:
    """Return the logarithm of the ratio of picture to prediction at each node (h, w).

    Parameters
    ----------
    observed : (h, w) grey
    brightness : as fitted to the picture
    """
    expected = np.maximum(brightness.direct, np.float32(0)) + np.float32(DARK_GREY)
    return np.asarray(np.log((observed + np.float32(DARK_GREY)) / expected), np.float32)


def on_grid(
    view: LearnedView, surface: Surface, T_world_part: FloatArray
) -> tuple[Float32Array, Float32Array, BoolArray]:
    """Return columns, rows and a mask (h, w): where a view's grid has another picture's nodes.

    Parameters
    ----------
    view : learned
    surface : what the nodes of the other picture see
    T_world_part : (4, 4) the pose there
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
    """Return a map on another grid (h, w), nan where it is not known.

    Parameters
    ----------
    values : the map, nan where nothing is known
    columns, rows, near : of the other grid's nodes, as `on_grid` has them
    """
    nan = float("nan")
    moved = cv2.remap(values, columns, rows, cv2.INTER_LINEAR, borderValue=nan)
    return np.where(near, moved, np.float32(nan))


def known_at(
    view: LearnedView, lamp: str, surface: Surface, T_world_part: FloatArray
) -> Known | None:
    """Return what good parts look like on the nodes of a picture; None for a lamp not learned.

    Parameters
    ----------
    view : learned
    lamp : of the picture
    surface : what its nodes see
    T_world_part : (4, 4) the part's pose in it
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
    """Return how much brighter a picture is than good parts (h, w), as a share; 0 off the mask.

    What the whole picture is brighter by is its lamp's and the albedo's, and is left out.

    Parameters
    ----------
    ratios, mean : (h, w) of the picture, and of good parts
    mask : (h, w) where both are known
    """
    off = np.where(mask, ratios, np.float32(0)) - np.where(mask, mean, np.float32(0))
    if mask.any():
        off = np.where(mask, off - np.float32(median(off[mask])), np.float32(0))
    return np.asarray(np.expm1(np.clip(off, -3.0, 3.0)), np.float32)


@dataclass(frozen=True, eq=False, slots=True)
class Appearance:
    """Appearance of good parts in all views that they were shown in.

    Attributes
    ----------
    views : learned
    p_part_mm : (3,) middle of the part
    """

    views: tuple[LearnedView, ...]
    p_part_mm: FloatArray

    def view(self, camera: Camera, T_world_part: FloatArray) -> LearnedView | None:
        """Return the learned view nearest to a pose, None where all are too far from it.

        Parameters
        ----------
        camera : that sees it
        T_world_part : (4, 4) the pose
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
    """Return True for cameras of one picture size, whose pixels show the same to a hundredth."""
    return one.size_px == other.size_px and bool(np.allclose(one.K, other.K, rtol=0.01, atol=10.0))
