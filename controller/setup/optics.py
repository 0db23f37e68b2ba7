"""Cameras, lamps and backlit areas from the cell file."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.config.cell import CameraSection, Cell, LampSection, LightSection
from controller.imaging import Camera, PointLamp

RADIUS_MM: Final = 50.0  # radius of a ring that names none


def build_camera(camera: CameraSection) -> Camera:
    """Return the calibrated camera."""
    K = np.array(
        [
            [camera.focal_px, 0, camera.centre_px[0]],
            [0, camera.focal_y_px or camera.focal_px, camera.centre_px[1]],
            [0, 0, 1],
        ]
    )
    return Camera(camera.size_px, K, np.array(camera.distortion), camera.pose.build())


def build_lamps(cell: Cell, names: Sequence[str]) -> tuple[PointLamp, ...]:
    """Return lamps as point sources, in the order of ``names``."""
    return tuple(_lamp(name, cell.lamps[name], cell) for name in names)


def _lamp(name: str, lamp: LampSection, cell: Cell) -> PointLamp:
    return build_light(name, light_of(lamp, cell))


def light_of(lamp: LampSection, cell: Cell) -> LightSection:
    """Return a lamp's light without its channels; a ring has the axis that it sits round."""
    light = LightSection(**lamp.model_dump(include=set(LightSection.model_fields)))
    if light.kind != "ring" or light.normal is not None:
        return light
    # a ring sits round the lens of the nearest camera
    centre = np.array(lamp.centre, dtype=float)
    cameras = (cell.cameras.overhead, cell.cameras.inspection)
    nearest = min(cameras, key=lambda c: np.linalg.norm(np.array(c.pose.position) - centre))
    x, y, z = (float(v) for v in nearest.pose.build()[:3, 2])
    return light.model_copy(update={"normal": (x, y, z), "radius": light.radius or RADIUS_MM})


def build_light(name: str, light: LightSection, camera_axis: FloatArray | None = None) -> PointLamp:
    """Return a ring or a spot as the points where its light comes from.

    Parameters
    ----------
    name : name of the lamp
    light : its kind and place
    camera_axis : (3,) axis of the camera that a ring sits round, if the ring does not name its own
    """
    centre = np.array(light.centre, dtype=float)
    axis = camera_axis if light.normal is None else np.array(light.normal, dtype=float)
    if light.kind == "ring":
        assert axis is not None, name
        return PointLamp.ring(name, centre, axis, light.radius or RADIUS_MM)
    return PointLamp(name, centre[None])


def table_light(cell: Cell) -> LightSection:
    """Return the backlit area of the table as a panel."""
    (x0, x1), (y0, y1) = cell.table.glowing_area.x, cell.table.glowing_area.y
    return LightSection(
        kind="panel",
        centre=((x0 + x1) / 2, (y0 + y1) / 2, 0.0),
        normal=(0.0, 0.0, 1.0),
        up=(0.0, 1.0, 0.0),
        size=(x1 - x0, y1 - y0),
    )


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
    return light_corners("table", table_light(cell))
