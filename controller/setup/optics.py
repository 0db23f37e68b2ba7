"""Build cameras, lamps and backlit areas from the cell file."""

from collections.abc import Sequence

import numpy as np

from controller.arrays import FloatArray
from controller.config.cell import CameraSection, Cell, LampSection
from controller.imaging import Camera, PointLamp


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
    centre = np.array(lamp.centre, dtype=float)
    if lamp.kind == "ring":
        # a ring sits round the lens of the nearest camera
        cameras = (cell.cameras.overhead, cell.cameras.inspection)
        nearest = min(cameras, key=lambda c: np.linalg.norm(np.array(c.pose.position) - centre))
        return PointLamp.ring(name, centre, nearest.pose.build()[:3, 2], lamp.radius or 50.0)
    return PointLamp(name, centre[None])


def panel_corners(cell: Cell, name: str) -> FloatArray:
    """Return the corners of a backlight panel in the world, (4, 3) [mm], in order round it.

    Raises
    ------
    ValueError : the lamp is no panel
    """
    lamp = cell.lamps[name]
    if lamp.kind != "panel" or lamp.normal is None or lamp.up is None or lamp.size is None:
        raise ValueError(f"{name} is not a panel with normal, up and size")
    up = np.array(lamp.up, dtype=float)
    right = np.cross(up, np.array(lamp.normal, dtype=float))
    half_w, half_h = lamp.size[0] / 2, lamp.size[1] / 2
    centre = np.array(lamp.centre, dtype=float)
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
