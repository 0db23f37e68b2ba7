"""The optics of the cell: cameras, lamps, station, and their accuracy."""

from datetime import date
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from controller.arrays import FloatArray

from ..yaml_models import Section, WrongKeyError
from .values import IN_MM, MAX_HEIGHT_MM, MIN_HEIGHT_MM, Pose, Size, Vec2, Vec3, positive

MAX_SIZE_PX = 20_000  # largest width and height of a picture


def _of_a_camera(size: tuple[int, int]) -> tuple[int, int]:
    if max(size) > MAX_SIZE_PX:
        raise ValueError(f"a camera has at most {MAX_SIZE_PX} px each side, not {max(size)}")
    return size


class CameraSection(Section):
    """A camera: its calibration and its settings.

    Attributes
    ----------
    size_px : width and height of a picture
    focal_px, focal_y_px : along the rows, and along the columns if that is not the same
    centre_px : principal point; 0, 0 is the middle of the first pixel
    distortion : k1, k2, p1, p2, k3 of OpenCV's model
    exposure_s, fps : exposure and pictures a second that the camera is set to
    formats : pixel formats to ask for, the first that the camera has; grey with 8, 10, 12 or 16
        bits is GREY, Y10, Y12, Y16
    settle_frames : frames discarded after the stream starts
    margin_s : largest error of a frame's time stamp; None for the driver's own figure
    calibrated : date of the calibration; reports state it
    """

    size_px: Annotated[tuple[int, int], AfterValidator(positive), AfterValidator(_of_a_camera)]
    focal_px: float = Field(ge=10, le=1_000_000)
    focal_y_px: float | None = Field(None, ge=10, le=1_000_000)
    centre_px: Vec2
    distortion: tuple[float, float, float, float, float] = (0, 0, 0, 0, 0)
    pose: Pose
    exposure_s: float = Field(0.01, gt=0, le=1)
    fps: float = Field(10, gt=0, le=240)
    formats: tuple[Literal["GREY", "YUYV", "MJPG", "Y10", "Y12", "Y16"], ...] = (
        "GREY",
        "YUYV",
        "MJPG",
    )
    settle_frames: int = Field(3, ge=0, le=30)
    margin_s: float | None = Field(None, ge=0, le=1)
    calibrated: date | None = None

    def sees(self, point_mm: FloatArray) -> bool:
        """Return whether a point (3,) of the world is in the picture, lens distortion ignored."""
        T = self.pose.build()
        x, y, z = T[:3, :3].T @ (point_mm - T[:3, 3])
        if z < MIN_HEIGHT_MM:
            return False
        u, v = self.focal_px * np.array([x, y]) / z + np.array(self.centre_px)
        return bool(0 <= u < self.size_px[0] and 0 <= v < self.size_px[1])


class CamerasSection(Section):
    """The two cameras."""

    overhead: CameraSection
    inspection: CameraSection

    @model_validator(mode="after")
    def _overhead_is_above_the_table(self) -> "CamerasSection":
        z_mm = self.overhead.pose.position[2]
        if not MIN_HEIGHT_MM <= z_mm <= MAX_HEIGHT_MM:
            raise WrongKeyError(
                ("overhead", "pose", "position"),
                f"the camera would stand {z_mm:g} mm above the table; {IN_MM}",
            )
        return self


class StationSection(Section):
    """The station: where the arm shows the part to the inspection camera.

    Attributes
    ----------
    position : in the world; the part's centre of mass is brought here
    """

    position: Vec3


class LightSection(Section):
    """The light of a lamp, by the place it comes from.

    Attributes
    ----------
    kind : a panel that glows, a ring about a lens, or a spot
    centre : centre of the light, in the world
    normal, up : normal of a panel, out of its light, and the direction of its height
    size : size of a panel: width, height
    radius, width : radius and width of a ring: to the middle of its light, and across it
    diameter : diameter of a spot
    """

    kind: Literal["panel", "ring", "spot"]
    centre: Vec3
    normal: Vec3 | None = None
    up: Vec3 | None = None
    size: Size | None = None
    radius: float | None = Field(None, gt=0)
    width: float | None = Field(None, gt=0)
    diameter: float | None = Field(None, gt=0)

    @model_validator(mode="after")
    def _panels_are_whole(self) -> Self:
        if self.kind != "panel":
            return self
        if self.normal is None or self.up is None or self.size is None:
            raise ValueError("a panel needs normal, up and size")
        normal, up = np.array(self.normal), np.array(self.up)
        if abs(normal @ up) > 1e-6 or abs(normal @ normal - 1) > 1e-6 or abs(up @ up - 1) > 1e-6:
            raise ValueError("normal and up must be of length 1 and at right angles")
        return self


class LampSection(LightSection):
    """A lamp: its channels, and the place and shape of its light.

    Attributes
    ----------
    analog, relay : its channels on the two light modules, counted from 0
    drive : share of its full dimming that it is used with
    settle_s : settling time of its light after a change (default: the driver's own figure)
    full_grey : nominal grey level (of 255) above dark of the lamp alone at its full setting, as the
        mean of the picture of the camera that sees most of it
    """

    analog: int = Field(ge=0, le=7)
    relay: int = Field(ge=0, le=7)
    drive: float = Field(1.0, ge=0.05, le=1)
    settle_s: float | None = Field(None, ge=0, le=60)
    full_grey: float | None = Field(None, gt=0, le=255)


class AccuracySection(Section):
    """The accuracy of measuring in this cell, as standard uncertainties.

    Attributes
    ----------
    edge_px, light_px, lens_px : uncertainties of an edge: from noise, from light, from calibration
    depth_mm : depth of the part along the line of sight of the inspection camera
    scale : scale of the calibration, as a share of a length
    temperature_k : difference of the part's temperature from 20 degrees Celsius
    """

    edge_px: float = Field(0.05, gt=0, le=2)
    light_px: float = Field(0.07, ge=0, le=2)  # an edge anywhere within 0.12 px either way
    lens_px: float = Field(0.1, ge=0, le=2)
    depth_mm: float = Field(0.1, ge=0, le=20)
    scale: float = Field(5e-5, ge=0, le=0.02)
    temperature_k: float = Field(5.0, ge=0, le=50)
