"""cell.yaml: where the devices are and how the cell stands in the world. mm, degrees, seconds."""

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from controller.cad import Camera

from ._yaml import ConfigError, Section, load_yaml

Array = NDArray[np.float64]
Vec2 = tuple[float, float]
Vec3 = tuple[float, float, float]
Box = tuple[float, float, float, float, float, float]
EMULATED = "emulated"


class Pose(Section):
    """A frame in the world: its origin and two of its axes."""

    position: Vec3
    x_axis: Vec3 = (1, 0, 0)
    y_axis: Vec3 = (0, 1, 0)

    @model_validator(mode="after")
    def _axes_are_square(self) -> "Pose":
        x, y = np.array(self.x_axis), np.array(self.y_axis)
        if abs(x @ y) > 1e-6 or abs(x @ x - 1) > 1e-6 or abs(y @ y - 1) > 1e-6:
            raise ValueError("x_axis and y_axis must be of length 1 and at right angles")
        return self

    def build(self) -> Array:
        """Return the pose (4, 4) [mm]."""
        T = np.eye(4)
        x, y = np.array(self.x_axis, dtype=float), np.array(self.y_axis, dtype=float)
        T[:3, 0], T[:3, 1], T[:3, 2], T[:3, 3] = x, y, np.cross(x, y), self.position
        return T


class SerialDevice(Section):
    """A device on a line of its own, or a camera node."""

    address: str


class ModbusSection(Section):
    """A Modbus device: `host:port` for tcp and rtu-tcp, a serial device for rtu."""

    address: str
    transport: Literal["tcp", "rtu", "rtu-tcp"] = "tcp"
    unit: int = Field(1, ge=1, le=247)
    baudrate: int = Field(115200, ge=1200, le=1_000_000)


class LightsSection(Section):
    """The two light modules on one line."""

    address: str
    transport: Literal["tcp", "rtu", "rtu-tcp"] = "tcp"
    analog_unit: int = Field(1, ge=1, le=247)
    relay_unit: int = Field(2, ge=1, le=247)
    baudrate: int = Field(9600, ge=1200, le=1_000_000)


class DevicesSection(Section):
    """Where each device is; `emulated` asks the emulator started beside the run."""

    arm: SerialDevice
    gripper: ModbusSection
    lights: LightsSection
    io: ModbusSection
    overhead: SerialDevice
    inspection: SerialDevice


class Range2(Section):
    """A rectangle on the table."""

    x: Vec2
    y: Vec2


class TableSection(Section):
    """The glowing plate, and where on it parts can be expected."""

    glowing_area: Range2
    drop_area: Range2


class CameraSection(Section):
    """A camera: its calibration and how it is run."""

    size_px: tuple[int, int]
    focal_px: float = Field(gt=0)
    centre_px: Vec2
    distortion: tuple[float, float, float, float, float] = (0, 0, 0, 0, 0)
    pose: Pose
    exposure_s: float = Field(0.01, gt=0, le=1)
    fps: float = Field(10, gt=0, le=240)
    formats: tuple[Literal["GREY", "YUYV", "MJPG", "Y16"], ...] = ("GREY", "YUYV", "MJPG")
    settle_frames: int = Field(3, ge=0, le=30)  # of a stream just started, before one is trusted
    margin_s: float | None = Field(None, ge=0, le=1)  # a stamp's play; the driver's own otherwise

    def build(self) -> Camera:
        """Return the calibrated camera."""
        K = np.array(
            [
                [self.focal_px, 0, self.centre_px[0]],
                [0, self.focal_px, self.centre_px[1]],
                [0, 0, 1],
            ]
        )
        return Camera(self.size_px, K, np.array(self.distortion), self.pose.build())


class CamerasSection(Section):
    """The two cameras."""

    overhead: CameraSection
    inspection: CameraSection


class StationSection(Section):
    """Where the arm shows the part."""

    position: Vec3


class LampSection(Section):
    """A lamp: its channels, and where its light comes from."""

    analog: int = Field(ge=0, le=7)
    relay: int = Field(ge=0, le=7)
    kind: Literal["panel", "ring", "spot"]
    centre: Vec3
    normal: Vec3 | None = None
    up: Vec3 | None = None
    size: Vec2 | None = None
    radius: float | None = None


class FingersSection(Section):
    """The two fingers of a jaw."""

    length_mm: float = Field(gt=0)
    width_mm: float = Field(gt=0)
    thickness_mm: float = Field(gt=0)
    pad_length_mm: float = Field(gt=0)


class ParkSection(Section):
    """Where the arm waits, out of both cameras' sight."""

    shoulder: float
    elbow: float
    yaw: float
    pitch: float
    roll: float


class ArmSection(Section):
    """The arm: where it stands and what shape it has."""

    pose: Pose
    upper_mm: float = Field(gt=0)
    fore_mm: float = Field(gt=0)
    tool_mm: float = Field(gt=0)
    wrist_height_mm: float = Field(gt=0)
    jaw_max_mm: float = Field(gt=0)
    park_deg: ParkSection
    links: dict[str, Box]
    hand: dict[str, Box]
    fingers: FingersSection


class FixtureSection(Section):
    """The fixed second gripper."""

    pose: Pose
    jaw_max_mm: float = Field(gt=0)
    body: dict[str, Box]
    fingers: FingersSection
    post: Box


class TraySection(Section):
    """A place to put parts."""

    centre: Vec2
    size: Vec2


class InterlocksSection(Section):
    """Inputs of the I/O block, counted from 0."""

    emergency_stop: Annotated[int, Field(ge=0, le=5)] = 0
    door: Annotated[int, Field(ge=0, le=5)] = 1
    part_in_nest: Annotated[int, Field(ge=0, le=5)] = 2
    part_in_fixture: Annotated[int, Field(ge=0, le=5)] = 3
    supply: Annotated[int, Field(ge=0, le=5)] = 4
    acknowledge: Annotated[int, Field(ge=0, le=5)] = 5


class TraysSection(Section):
    """Where parts go, by verdict."""

    accept: TraySection
    reject: TraySection
    quarantine: TraySection


class Cell(Section):
    """One cell, as its file describes it."""

    name: str
    devices: DevicesSection
    table: TableSection
    cameras: CamerasSection
    station: StationSection
    lamps: dict[str, LampSection]
    arm: ArmSection
    fixture: FixtureSection
    obstacles: dict[str, Box] = Field(default_factory=dict)
    trays: TraysSection
    interlocks: InterlocksSection = InterlocksSection()

    @model_validator(mode="after")
    def _lamps_are_all_there(self) -> "Cell":
        missing = [lamp for lamp in REQUIRED_LAMPS if lamp not in self.lamps]
        if missing:
            raise ValueError(f"lamps lacks {', '.join(missing)}")
        return self

    @property
    def emulated_devices(self) -> tuple[str, ...]:
        """Names of the devices that are to be emulated."""
        devices = self.devices
        return tuple(
            name
            for name in type(devices).model_fields
            if getattr(devices, name).address == EMULATED
        )


REQUIRED_LAMPS = (
    "table_backlight",
    "table_ring",
    "table_side",
    "station_backlight",
    "station_ring",
    "station_side",
)


def load_cell(path: Path) -> Cell:
    """Read a cell file.

    Raises
    ------
    ConfigError : the file is wrong
    """
    return load_yaml(path, Cell)


__all__ = ["EMULATED", "Cell", "ConfigError", "load_cell"]
