"""Build cameras, lamps and backlit areas from the cell file."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.config.cell import CameraSection, Cell, LampSection, LightSection
from controller.imaging import Camera, PointLamp

DEFAULT_RADIUS_MM: Final = 50.0  # of a ring that names none


def build_camera(camera: CameraSection) -> Camera:
    """Return the calibrated camera."""
    K = np.array(
        [
            [camera.focal_px, 0, camera.centre_px[0]],
            [0, camera.focal_px, camera.centre_px[1]],
            [0, 0, 1],
        ]
    )
    return Camera(camera.size_px, K, np.array(camera.distortion), camera.pose.build())


def build_lamps(cell: Cell, names: Sequence[str]) -> tuple[PointLamp, ...]:
    """Return lamps as the points where their light comes from, in the order of ``names``."""
    return tuple(_lamp(name, cell.lamps[name], cell) for name in names)


def _lamp(name: str, lamp: LampSection, cell: Cell) -> PointLamp:
    # a ring sits round the lens of the nearest camera
    centre = np.array(lamp.centre, dtype=float)
    cameras = (cell.cameras.overhead, cell.cameras.inspection)
    nearest = min(cameras, key=lambda c: np.linalg.norm(np.array(c.pose.position) - centre))
    return build_light(name, lamp, nearest.pose.build()[:3, 2])


def build_light(name: str, light: LightSection, axis: FloatArray) -> PointLamp:
    """Return a ring or a spot as the points where its light comes from.

    Parameters
    ----------
    name : of the lamp
    light : its kind and place
    axis : (3,) of the camera that a ring sits round
    """
    centre = np.array(light.centre, dtype=float)
    if light.kind == "ring":
        return PointLamp.ring(name, centre, axis, light.radius or DEFAULT_RADIUS_MM)
    return PointLamp(name, centre[None])


def panel_corners(cell: Cell, name: str) -> FloatArray:
    """Return the corners of a backlight panel in the world, (4, 3) [mm], in order round it.

    Raises
    ------
    ValueError : the lamp is no panel
    """
    return light_corners(name, cell.lamps[name])


def light_corners(name: str, light: LightSection) -> FloatArray:
    """Return the corners of a panel in the world, (4, 3) [mm], in order round it.

    Raises
    ------
    ValueError : the lamp is no panel
    """
    if light.kind != "panel" or light.normal is None or light.up is None or light.size is None:
        raise ValueError(f"{name} is not a panel with normal, up and size")
    up = np.array(light.up, dtype=float)
    right = np.cross(up, np.array(light.normal, dtype=float))
    half_w, half_h = light.size[0] / 2, light.size[1] / 2
    centre = np.array(light.centre, dtype=float)
    return np.array(
        [
            centre + sx * half_w * right + sy * half_h * up
            for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))
        ]
    )


def table_corners(cell: Cell) -> FloatArray:
    """Return the corners of the backlit area, (4, 3) [mm], in order round it."""
    (x0, x1), (y0, y1) = cell.table.glowing_area.x, cell.table.glowing_area.y
    return np.array([[x0, y0, 0.0], [x1, y0, 0.0], [x1, y1, 0.0], [x0, y1, 0.0]])
