"""The views of pictures: the cell's cameras, and parallel projections."""

from dataclasses import dataclass

import numpy as np

from controller.arrays import FloatArray
from controller.imaging import Camera

# x0, y0, x1, y1 [px] in a camera's picture.
Window = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Eye:
    """The rays of a picture, row by row.

    Attributes
    ----------
    size : (width, height) rays
    origins_mm : (n, 3), or (1, 3) where all start at one point
    directions : (n, 3), not of unit length
    right, up, back : (3,) unit, of the picture in the world; back is towards the eye
    """

    size: tuple[int, int]
    origins_mm: FloatArray
    directions: FloatArray
    right: FloatArray
    up: FloatArray
    back: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Slant:
    """A fixed direction of view, and the extent of the picture.

    Attributes
    ----------
    centre_mm : (3,) in the middle of the picture
    width_mm, height_mm : width and height of the picture
    """

    azimuth_rad: float
    elevation_rad: float
    centre_mm: FloatArray
    width_mm: float
    height_mm: float

    def axes(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return right, up and back of the picture in the world."""
        c, s = np.cos(self.elevation_rad), np.sin(self.elevation_rad)
        back = np.array([c * np.cos(self.azimuth_rad), c * np.sin(self.azimuth_rad), s])
        right = np.array([-np.sin(self.azimuth_rad), np.cos(self.azimuth_rad), 0.0])
        return right, np.cross(back, right), back

    def project(self, points_mm: FloatArray, width: int) -> FloatArray:
        """Return pixels (n, 2) of world points (n, 3) in a picture `width` wide."""
        right, up, _ = self.axes()
        scale = width / self.width_mm
        away = points_mm - self.centre_mm
        u = (away @ right + self.width_mm / 2) * scale
        v = (self.height_mm / 2 - away @ up) * scale
        return np.column_stack([u, v])


def slanting_eye(slant: Slant, size: tuple[int, int], far_mm: float) -> Eye:
    """Return parallel rays; they start `far_mm` before the middle.

    Parameters
    ----------
    slant : direction, middle and size of the picture
    size : width and height [px]
    far_mm : enough to start outside all bodies
    """
    width, height = size
    right, up, back = slant.axes()
    u = ((np.arange(width) + 0.5) / width - 0.5) * slant.width_mm
    v = (0.5 - (np.arange(height) + 0.5) / height) * slant.height_mm
    start = slant.centre_mm + far_mm * back
    origins = start + u[None, :, None] * right + v[:, None, None] * up
    origins = origins.reshape(-1, 3)
    return Eye(size, origins, np.broadcast_to(-back, origins.shape), right, up, back)


def slant_over(
    points_mm: FloatArray,
    azimuth_rad: float,
    elevation_rad: float,
    aspect: float,
    room: float = 0.04,
) -> Slant:
    """Return the slant whose picture holds all points (n, 3).

    Parameters
    ----------
    points_mm : (n, 3) in the world
    azimuth_rad : direction to look from, about +z from +x
    elevation_rad : direction to look from, above the table
    aspect : width of the picture divided by its height
    room : empty border on each side, as a share of the points' extent
    """
    probe = Slant(azimuth_rad, elevation_rad, np.zeros(3), 1.0, 1.0)
    right, up, back = probe.axes()
    u, v, w = points_mm @ right, points_mm @ up, points_mm @ back
    width, height = float(np.ptp(u)) * (1 + 2 * room), float(np.ptp(v)) * (1 + 2 * room)
    width, height = max(width, aspect * height), max(height, width / aspect)
    middle = right * (u.min() + u.max()) / 2 + up * (v.min() + v.max()) / 2 + back * float(w.mean())
    return Slant(azimuth_rad, elevation_rad, middle, width, height)


def camera_eye(camera: Camera, window: Window, size: tuple[int, int]) -> Eye:
    """Return the rays of a window of a camera's picture, with lens distortion.

    Parameters
    ----------
    camera : a calibrated camera of the cell
    window : the part of its picture to be drawn [px]
    size : width and height of the drawn picture [px]
    """
    x0, y0, x1, y1 = window
    width, height = size
    u = x0 + (np.arange(width) + 0.5) / width * (x1 - x0) - 0.5
    v = y0 + (np.arange(height) + 0.5) / height * (y1 - y0) - 0.5
    pixels = np.column_stack([np.tile(u, height), np.repeat(v, width)])
    R = camera.T_world_cam[:3, :3]
    return Eye(
        size,
        camera.position_mm[None],
        camera.sight_lines(pixels),
        R[:, 0],
        -R[:, 1],
        -R[:, 2],
    )


def window_about(camera: Camera, points_mm: FloatArray, room: float, aspect: float) -> Window:
    """Return the window of a camera's picture that shows points (n, 3) with a border.

    It is never larger than the picture, and stays inside it where the points are inside.

    Parameters
    ----------
    camera : a calibrated camera of the cell
    points_mm : (n, 3) in the world
    room : border on each side, as a share of the points' extent
    aspect : width of the window divided by its height
    """
    full_w, full_h = (float(px) for px in camera.size_px)
    pixels = camera.project(points_mm)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    side = (1 + 2 * room) * float(max(high[0] - low[0], aspect * (high[1] - low[1])))
    width = min(max(side, 40.0), full_w, aspect * full_h)
    height = width / aspect
    x0, y0 = ((low + high) / 2 - np.array([width, height]) / 2).tolist()
    x0 = min(max(x0, 0.0), full_w - width)
    y0 = min(max(y0, 0.0), full_h - height)
    return x0, y0, x0 + width, y0 + height
