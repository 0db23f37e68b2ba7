"""Parts with holes whose rims lie in no plane, as drawn and as built, and pictures of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from cad_solids import Body, box, prism, rod
from shown_part import CAMERA, LAMPS, PANEL, photograph

from controller.arrays import FloatArray
from controller.cad import Solid
from controller.inspection import InspectionLimits, ViewTask
from controller.inspection.dimensions import PosedView

POSE_MM, POSE_DEG = 0.03, 0.03


@dataclass(frozen=True)
class Drilled:
    """A body with one hole: `way` leads out of its mouth at `mouth_mm`; `length_mm` is drilled."""

    body: Callable[[], Body]
    mouth_mm: tuple[float, float, float]
    way: tuple[float, float, float]
    diameter_mm: float
    length_mm: float

    def built(self, wider_mm: float = 0.0, off_mm: tuple[float, float] = (0.0, 0.0)) -> Body:
        """The part with its hole so much wider, and so far off along `across`."""
        radius = (self.diameter_mm + wider_mm) / 2
        tool = rod(radius, 2 * self.length_mm, 192)
        T = np.eye(4)
        T[:3, 2] = self.axis
        T[:3, 0], T[:3, 1] = self.across
        T[:3, 3] = self.mouth_mm + T[:3, :2] @ off_mm
        return self.body() - tool.transform(T[:3])

    @property
    def axis(self) -> FloatArray:
        return np.array(self.way) / np.linalg.norm(self.way)

    @property
    def across(self) -> tuple[FloatArray, FloatArray]:
        least = np.eye(3)[int(np.abs(self.axis).argmin())]
        first = np.cross(self.axis, least)
        first /= np.linalg.norm(first)
        return first, np.cross(self.axis, first)


def keyed_ring() -> Body:
    return rod(20, 24, 256) - rod(10, 40, 128) - box(6, 10, 40).translate((0, -8.5, 0))


def slope() -> Body:
    return (
        prism([(0, 0), (50, 0), (50, 30), (0, 12)], 40).rotate((90, 0, 0)).translate((-25, 20, -10))
    )


def frustum() -> Body:
    return Body.cylinder(40, 22, 14, 256, True)


def domed() -> Body:
    return rod(22, 16, 256) ^ Body.sphere(38, 256).translate((0, 0, -30))


def pillow() -> Body:
    return box(44, 30, 20) ^ rod(30, 80, 256).rotate((0, 90, 0)).translate((0, 0, -20))


SLOPE = np.degrees(np.arctan2(18, 50))
# no figure of the controller was chosen with any of these
PARTS: dict[str, Drilled] = {
    "cross hole of a collar": Drilled(keyed_ring, (0, 20, 0), (0, 1, 0), 6.0, 15),
    "cross hole of a pin": Drilled(lambda: rod(9, 50, 192), (0, 9, 6), (0, 1, 0), 5.0, 12),
    "oblique hole in a shaft": Drilled(lambda: rod(16, 40, 256), (0, 16, 0), (0, 1, 0.45), 7.0, 12),
    "hole in a slope": Drilled(slope, (0, 0, 11), (0, 0, 1), 8.0, 14),
    "hole in a cone": Drilled(frustum, (0, 18, 0), (0, 1, 0), 7.0, 12),
    "hole beside the top of a dome": Drilled(domed, (9, 5, 6), (0, 0, 1), 6.0, 9),
    "hole in a round back": Drilled(pillow, (6, 3, 9.8), (0, 0, 1), 9.0, 12),
}


def shown(drilled: Drilled, solid: Solid, tilt_deg: float, about_deg: float) -> FloatArray:
    """T_world_part with the mouth of the hole towards the camera, tilted."""
    axis, (first, second) = drilled.axis, drilled.across
    # the camera stands at -y and looks along +y
    R = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]) @ np.stack([first, second, axis])
    about = np.radians(about_deg)
    tilt = cv2.Rodrigues(np.radians(tilt_deg) * np.array([np.cos(about), 0.0, np.sin(about)]))[0]
    T = np.eye(4)
    T[:3, :3] = tilt @ R
    T[:3, 3] = -T[:3, :3] @ solid.centroid_mm
    return T


def views(
    drilled: Drilled, solid: Solid, built: Body, places: list[tuple[float, float]]
) -> list[PosedView]:
    """Views of a part as built, each tilted by so many degrees about an axis of the picture."""
    covariance = np.diag([POSE_MM**2] * 3 + [np.radians(POSE_DEG) ** 2] * 3)
    found = []
    for i, (tilt_deg, about_deg) in enumerate(places):
        T = shown(drilled, solid, tilt_deg, about_deg)
        task = ViewTask(f"v{i}", CAMERA, T, (), PANEL, LAMPS, InspectionLimits())
        found.append(PosedView(task, photograph(built, T, ()), T, covariance, i))
    return found
