"""cell.yaml: where the devices are and how the cell stands in the world. mm, degrees, seconds."""

from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import (
    AfterValidator,
    AliasChoices,
    BeforeValidator,
    Field,
    PrivateAttr,
    model_validator,
)

from controller.arrays import FloatArray

from .calibration_reference import CalibrationName, CalibrationReference
from .errors import ConfigError
from .faults import FaultsSection
from .file_kinds import is_recipe
from .grippers import ArmJawsSection, FingersSection, FixedJawsSection, Width
from .interlock_rules import InterlockRules
from .yaml_models import Section, WrongKeyError

Number = Annotated[float, Field(ge=-50_000, le=50_000)]  # no cell is 50 m wide
Vec2 = tuple[Number, Number]
Vec3 = tuple[Number, Number, Number]
Length = Annotated[float, Field(ge=10, le=5000)]  # of a link [mm]; given in metres it is below 1
# Between a camera and the table or the station that it looks at [mm]. A value below 20 is likely to
# be in metres.
MIN_HEIGHT_MM, MAX_HEIGHT_MM = 50.0, 20_000.0
MAX_SIZE_PX = 20_000  # of a picture, each way
IN_MM = "lengths are in millimetres; are these metres?"
MIN_AREA_MM = 10.0  # side of an area in which parts lie
MAX_ZERO_DEG, MAX_OFF_MM = 5.0, 20.0  # an arm that is farther off wants mending, not measuring


def _rising(bounds: tuple[float, ...]) -> tuple[float, ...]:
    """Return (low, high) pairs; raise ValueError unless they are in this order."""
    for low, high in zip(bounds[::2], bounds[1::2], strict=True):
        if low >= high:
            raise ValueError(f"bounds must go from low to high, not from {low:g} to {high:g}")
    return bounds


def _of_a_camera(size: tuple[int, int]) -> tuple[int, int]:
    if max(size) > MAX_SIZE_PX:
        raise ValueError(f"a camera has at most {MAX_SIZE_PX} px each side, not {max(size)}")
    return size


def _positive(size: tuple[float, ...]) -> tuple[float, ...]:
    if min(size) <= 0:
        raise ValueError(f"sizes must be more than 0, not {min(size):g}")
    return size


def _all_different(what: str, values: Mapping[str, int]) -> None:
    """Raise ValueError if two names have the same number."""
    owner: dict[int, str] = {}
    for name, value in values.items():
        if value in owner:
            raise ValueError(f"{what} {value} is given to both {owner[value]} and {name}")
        owner[value] = name


Range = Annotated[Vec2, AfterValidator(_rising)]
Size = Annotated[Vec2, AfterValidator(_positive)]
Box = Annotated[tuple[float, float, float, float, float, float], AfterValidator(_rising)]
EMULATED = "emulated"
Parity = Literal["N", "E", "O"]  # of a serial line: none, even, odd
DriverName = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_.-]*$", max_length=80)]


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

    def build(self) -> FloatArray:
        """Return the pose (4, 4) [mm]."""
        T = np.eye(4)
        x, y = np.array(self.x_axis, dtype=float), np.array(self.y_axis, dtype=float)
        T[:3, 0], T[:3, 1], T[:3, 2], T[:3, 3] = x, y, np.cross(x, y), self.position
        return T


class DeviceSection(Section):
    """A device: its address and its driver.

    Attributes
    ----------
    address : device node, `host:port`, or whatever the driver takes
    driver : name of an installed driver of this kind of device (docs/drivers.md)
    settings : further settings of that driver
    """

    address: str
    driver: DriverName
    settings: dict[str, Any] = Field(default_factory=dict)


class ArmDevice(DeviceSection):
    """The arm, on a line of its own."""

    driver: DriverName = "umi_rtx"


class CameraDevice(DeviceSection):
    """A camera node."""

    driver: DriverName = "v4l2"


class ModbusSection(DeviceSection):
    """A Modbus device: `host:port` for tcp and rtu-tcp, a serial device for rtu."""

    transport: Literal["tcp", "rtu", "rtu-tcp"] = "tcp"
    unit: int = Field(1, ge=1, le=247)
    baudrate: int = Field(115200, ge=1200, le=1_000_000)
    parity: Parity = "N"


class GripperDevice(ModbusSection):
    """The fixed gripper."""

    driver: DriverName = "robotiq_2f"


class IoDevice(ModbusSection):
    """The I/O block."""

    driver: DriverName = "moxa_e1214"


class LightsSection(DeviceSection):
    """The two light modules on one line."""

    driver: DriverName = "waveshare"
    transport: Literal["tcp", "rtu", "rtu-tcp"] = "tcp"
    analog_unit: int = Field(1, ge=1, le=247)
    relay_unit: int = Field(2, ge=1, le=247)
    baudrate: int = Field(9600, ge=1200, le=1_000_000)
    parity: Parity = "N"

    @model_validator(mode="after")
    def _units_differ(self) -> "LightsSection":
        if self.analog_unit == self.relay_unit:
            raise ValueError(f"both modules on one line have unit {self.analog_unit}; change one")
        return self


class DevicesSection(Section):
    """The address of each device; `emulated` takes the emulator started beside the run."""

    arm: ArmDevice
    gripper: GripperDevice
    lights: LightsSection
    io: IoDevice
    overhead: CameraDevice
    inspection: CameraDevice


class Range2(Section):
    """A rectangle on the table."""

    x: Range
    y: Range


class TableSection(Section):
    """The light table, and the area on it where parts can be expected."""

    glowing_area: Range2
    drop_area: Range2

    @model_validator(mode="after")
    def _areas_hold_a_part(self) -> "TableSection":
        for name, area in (("glowing_area", self.glowing_area), ("drop_area", self.drop_area)):
            side_mm = min(area.x[1] - area.x[0], area.y[1] - area.y[0])
            if side_mm < MIN_AREA_MM:
                raise WrongKeyError((name,), f"a side of {side_mm:g} mm; {IN_MM}")
        return self


class CameraSection(Section):
    """A camera: its calibration and its settings.

    Attributes
    ----------
    focal_px, focal_y_px : along the rows, and along the columns if that is not the same
    calibrated : when; the report states it
    """

    size_px: Annotated[tuple[int, int], AfterValidator(_positive), AfterValidator(_of_a_camera)]
    focal_px: float = Field(ge=10, le=1_000_000)
    focal_y_px: float | None = Field(None, ge=10, le=1_000_000)
    centre_px: Vec2
    distortion: tuple[float, float, float, float, float] = (0, 0, 0, 0, 0)
    pose: Pose
    exposure_s: float = Field(0.01, gt=0, le=1)
    fps: float = Field(10, gt=0, le=240)
    formats: tuple[Literal["GREY", "YUYV", "MJPG", "Y16"], ...] = ("GREY", "YUYV", "MJPG")
    settle_frames: int = Field(3, ge=0, le=30)  # frames discarded after the stream starts
    # how far a frame's time stamp may be off; None for the driver's own figure
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
    """The station: where the arm shows the part to the inspection camera."""

    position: Vec3


class LightSection(Section):
    """The light of a lamp: where it comes from."""

    kind: Literal["panel", "ring", "spot"]
    centre: Vec3
    normal: Vec3 | None = None
    up: Vec3 | None = None
    size: Size | None = None
    radius: float | None = Field(None, gt=0)
    width: float | None = Field(None, gt=0)  # of a ring, measured along its radius
    diameter: float | None = Field(None, gt=0)  # of a spot

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
    drive : share of its full dimming that it is used with
    settle_s : until its light is steady after a change (default: the driver's own figure)
    full_grey : by design, the mean grey level (of 255) over the dark one that the lamp alone makes
        at its full setting in the picture of the camera that sees most of it
    """

    analog: int = Field(ge=0, le=7)
    relay: int = Field(ge=0, le=7)
    drive: float = Field(1.0, ge=0.05, le=1)
    settle_s: float | None = Field(None, ge=0, le=60)
    full_grey: float | None = Field(None, gt=0, le=255)


class ParkSection(Section):
    """The position where the arm waits, out of both cameras' sight."""

    shoulder: float
    elbow: float
    yaw: float
    pitch: float
    roll: float


class LinksSection(Section):
    """The boxes that the arm's links take up, each in its own frame."""

    column: Box
    carriage: Box
    upper: Box
    fore: Box


class ArmSection(Section):
    """The keys of any arm: its pose in the world, and the gripper on it."""

    pose: Pose
    jaw_max_mm: Width
    jaws: ArmJawsSection = ArmJawsSection()
    arm_gripper: dict[str, Box] = Field(
        validation_alias=AliasChoices("arm_gripper", "hand"), serialization_alias="hand"
    )
    fingers: FingersSection


Zero = Annotated[float, Field(ge=-MAX_ZERO_DEG, le=MAX_ZERO_DEG)]
Small = Annotated[float, Field(ge=-MAX_OFF_MM, le=MAX_OFF_MM)]


class ZerosSection(Section):
    """Where joints are when their counters mean 0, in degrees."""

    shoulder: Zero = 0.0
    elbow: Zero = 0.0
    yaw: Zero = 0.0
    pitch: Zero = 0.0
    roll: Zero = 0.0


class CorrectionsSection(Section):
    """How one UMI RTX differs from what its counters mean; all 0 until it was measured.

    Attributes
    ----------
    tool_off_mm : of the TCP from the approach axis, along the jaws' axis and across
    zed_zero_mm : height of zed where its counter means 0
    yaw_per_elbow : heading that a turn of the elbow adds to the nominal half of it
    sag_mm : by how much the stretched arm hangs lower
    """

    tool_off_mm: tuple[Small, Small] = (0.0, 0.0)
    zero_deg: ZerosSection = ZerosSection()
    zed_zero_mm: Small = 0.0
    yaw_per_elbow: float = Field(0.0, ge=-0.05, le=0.05)
    sag_mm: Small = 0.0


class UncertaintySection(Section):
    """Standard uncertainty of a pose."""

    position_mm: float = Field(0.0, ge=0, le=MAX_OFF_MM)
    angle_deg: float = Field(0.0, ge=0, le=MAX_ZERO_DEG)


class UmiSection(ArmSection):
    """A UMI RTX.

    Attributes
    ----------
    park_zed_mm : zed where the arm waits, below the noisy last counts under its top stop
        (umi_rtx.md 5.2)
    column_pose : of the column's box in the world, once the base that it stands on was measured;
        None where it stands as drawn
    """

    upper_mm: Length
    fore_mm: Length
    tool_mm: Length
    wrist_height_mm: Length
    park_deg: ParkSection
    park_zed_mm: float = Field(-10.0, ge=-850, le=-5.5)
    links: LinksSection
    corrections: CorrectionsSection = CorrectionsSection()
    uncertainty: UncertaintySection = UncertaintySection()
    column_pose: Pose | None = None


class OtherArmSection(ArmSection):
    """An arm of another make.

    Attributes
    ----------
    column : the box in the world of what does not move
    shape : the dimensions that its driver needs
    """

    column: Box
    shape: dict[str, Any]

    @model_validator(mode="before")
    @classmethod
    def _names_no_umi(cls, given: object) -> object:
        for key in sorted(UmiSection.model_fields.keys() - cls.model_fields.keys()):
            if isinstance(given, dict) and key in given:
                raise WrongKeyError(
                    (key,), "describes a UMI RTX; what another arm is like stands under `shape`"
                )
        return given


def _arm_section(given: object) -> ArmSection:
    """Return the section of a UMI, or of the arm whose ``shape`` is given."""
    if isinstance(given, ArmSection):
        return given
    section = OtherArmSection if isinstance(given, dict) and "shape" in given else UmiSection
    return section.model_validate(given)


class HeldSection(Section):
    """By how much a pose may be off, at most, where nothing was measured."""

    mm: float = Field(0.0, ge=0, le=MAX_OFF_MM)
    deg: float = Field(0.0, ge=0, le=MAX_ZERO_DEG)


class FixedGripperSection(Section):
    """The fixed second gripper.

    Attributes
    ----------
    opening_zero_mm, opening_scale : its jaws are ``zero + scale * reported`` apart
    held : by how much it may stand elsewhere along its pads, where only its plane was measured
    """

    pose: Pose
    held: HeldSection = HeldSection()
    opening_zero_mm: float = Field(0.0, ge=-10, le=10)
    opening_scale: float = Field(1.0, ge=0.8, le=1.25)
    jaw_max_mm: Width
    jaws: FixedJawsSection = FixedJawsSection()
    body: dict[str, Box]
    fingers: FingersSection
    post: Box


class PlateSection(Section):
    """A plate: from its corner two edges span the face that parts slide on.

    The plate's matter is on the other side: that face looks along ``along`` x ``across``.
    """

    corner: Vec3
    along: Vec3
    across: Vec3
    thickness_mm: Width

    @model_validator(mode="after")
    def _is_a_rectangle(self) -> Self:
        along, across = np.array(self.along), np.array(self.across)
        lengths = float(np.linalg.norm(along)), float(np.linalg.norm(across))
        if min(lengths) <= 0:
            raise ValueError("along and across must be longer than 0")
        if abs(along @ across) > 1e-4 * lengths[0] * lengths[1]:
            raise ValueError("along and across must be at right angles")
        return self


class ChuteSection(Section):
    """What catches a part that falls from the fixed gripper and lets it slide onto the table.

    Attributes
    ----------
    plates : what the part slides on
    walls : boxes in the world that keep it on the way, and on the table
    """

    plates: dict[str, PlateSection]
    walls: dict[str, Box] = Field(default_factory=dict)


class NestSection(Section):
    """A place for one part in a tray.

    Attributes
    ----------
    at : x, y from the tray's middle, along the world's axes
    size : room along x and y; the part's outline stays within it
    turn : angle about the vertical that parts are turned to, deg; None for any
    """

    at: Vec2
    size: Size
    turn: float | None = Field(None, ge=-360, le=360)


class NestGridSection(Section):
    """Nests side by side that share a tray evenly.

    Attributes
    ----------
    columns, rows : along x and along y
    turn : angle about the vertical that parts are turned to, deg; None for any
    """

    columns: int = Field(ge=1, le=20)
    rows: int = Field(ge=1, le=20)
    turn: float | None = Field(None, ge=-360, le=360)


class TraySection(Section):
    """A place to put parts.

    Attributes
    ----------
    nests : places for one part each, filled in order and counted; None for a tray with one place
        in its middle that nobody counts: somebody empties it after each part
    walls_mm : height of the tray's walls above its floor
    """

    centre: Vec2
    size: Size
    nests: NestGridSection | Annotated[list[NestSection], Field(min_length=1)] | None = None
    walls_mm: float = Field(0.0, ge=0, le=200)

    def places(self) -> list[NestSection]:
        """Return the nests, in the order in which they are filled; none if nobody counts."""
        if not isinstance(self.nests, NestGridSection):
            return list(self.nests or [])
        grid = self.nests
        room = (self.size[0] / grid.columns, self.size[1] / grid.rows)
        return [
            NestSection(
                at=(
                    (column + 0.5) * room[0] - self.size[0] / 2,
                    (row + 0.5) * room[1] - self.size[1] / 2,
                ),
                size=room,
                turn=grid.turn,
            )
            for row in range(grid.rows)
            for column in range(grid.columns)
        ]

    @model_validator(mode="after")
    def _nests_are_within(self) -> "TraySection":
        for number, nest in enumerate(self.places(), start=1):
            for axis, name in enumerate("xy"):
                out = abs(nest.at[axis]) + (nest.size[axis] - self.size[axis]) / 2
                if out > 1e-6:
                    raise ValueError(f"nest {number} is {out:g} mm beyond the tray along {name}")
        for k, one in enumerate(self.places()):
            for number, other in enumerate(self.places()[:k], start=1):
                gaps = [
                    abs(one.at[axis] - other.at[axis]) - (one.size[axis] + other.size[axis]) / 2
                    for axis in (0, 1)
                ]
                if max(gaps) < -1e-6:
                    raise ValueError(f"nests {number} and {k + 1} overlap")
        return self


class InterlocksSection(Section):
    """Inputs of the I/O block, counted from 0."""

    emergency_stop: Annotated[int, Field(ge=0, le=5)] = 0
    door: Annotated[int, Field(ge=0, le=5)] = 1
    part_in_nest: Annotated[int, Field(ge=0, le=5)] = 2
    part_in_fixed_gripper: int = Field(
        3,
        ge=0,
        le=5,
        validation_alias=AliasChoices("part_in_fixed_gripper", "part_in_fixture"),
        serialization_alias="part_in_fixture",
    )
    supply: Annotated[int, Field(ge=0, le=5)] = 4
    acknowledge: Annotated[int, Field(ge=0, le=5)] = 5

    @model_validator(mode="after")
    def _inputs_differ(self) -> "InterlocksSection":
        _all_different("input", self.model_dump())
        return self


class TraysSection(Section):
    """The trays for parts, by verdict."""

    accept: TraySection
    reject: TraySection
    quarantine: TraySection


class TimingSection(Section):
    """How long the controller waits for the devices, in seconds of cell time.

    Attributes
    ----------
    io_poll_s : from one reading of the inputs to the next
    io_stale_s : an input read longer ago is unknown, and unknown is not healthy
    modbus_reply_s : a Modbus device that takes longer to answer counts as silent
    frame_late_s : a frame may come this much later than rate and exposure explain
    """

    io_poll_s: float = Field(0.04, ge=0.02, le=1)
    io_stale_s: float = Field(0.2, ge=0.05, le=5)
    modbus_reply_s: float = Field(0.3, ge=0.05, le=5)
    frame_late_s: float = Field(5.0, ge=0.1, le=60)

    @model_validator(mode="after")
    def _polls_before_it_is_stale(self) -> "TimingSection":
        if self.io_stale_s < 2 * self.io_poll_s:
            raise ValueError(
                f"io_stale_s must be at least twice io_poll_s ({self.io_poll_s:g} s), "
                f"not {self.io_stale_s:g} s: one late reading would stop the cell"
            )
        return self


class DetectionSection(Section):
    """Within what time a loss is known, in seconds of cell time.

    Attributes
    ----------
    arm_silent_s : a silent line of the arm, at rest and in motion
    arm_beat_s : at rest the arm is asked so often; part of `arm_silent_s`
    device_beat_s : the fixed gripper and the lamps are asked so often
    stop_confirm_s : a device that has not confirmed a stop by then is reported
    loop_late_s : a delay of the controller above this is recorded, in seconds of the wall
    """

    arm_silent_s: float = Field(0.5, ge=0.3, le=10)
    arm_beat_s: float = Field(0.1, ge=0.05, le=5)
    device_beat_s: float = Field(2.0, ge=0.2, le=60)
    stop_confirm_s: float = Field(1.0, ge=0.2, le=30)
    loop_late_s: float = Field(0.05, ge=0.01, le=10)

    @model_validator(mode="after")
    def _beat_leaves_time_for_an_answer(self) -> "DetectionSection":
        if self.arm_beat_s > self.arm_silent_s / 2:
            raise WrongKeyError(
                ("arm_beat_s",),
                f"{self.arm_beat_s:g} s leave too little of arm_silent_s "
                f"({self.arm_silent_s:g} s) for an answer; give half of it at most",
            )
        return self


class AccuracySection(Section):
    """What measuring in this cell is uncertain by, as standard uncertainties.

    Attributes
    ----------
    edge_px, light_px, lens_px : of an edge, by its noise, by light, by what calibration leaves
    depth_mm : of the part along the line of sight of the inspection camera
    scale : of the calibration, as a share of a length
    temperature_k : of the part from 20 degrees Celsius
    """

    edge_px: float = Field(0.05, gt=0, le=2)
    light_px: float = Field(0.07, ge=0, le=2)  # an edge anywhere within 0.12 px either way
    lens_px: float = Field(0.1, ge=0, le=2)
    depth_mm: float = Field(0.1, ge=0, le=20)
    scale: float = Field(5e-5, ge=0, le=0.02)
    temperature_k: float = Field(5.0, ge=0, le=50)


class Cell(Section):
    """One cell, as its file describes it."""

    name: str
    devices: DevicesSection
    calibration: dict[CalibrationName, CalibrationReference] = Field(default_factory=dict)
    clock: Path | None = None  # of the emulator whose addresses are given in `devices`
    timing: TimingSection = TimingSection()
    table: TableSection
    cameras: CamerasSection
    station: StationSection
    lamps: dict[str, LampSection]
    arm: Annotated[UmiSection | OtherArmSection, BeforeValidator(_arm_section)]
    fixed_gripper: FixedGripperSection = Field(
        validation_alias=AliasChoices("fixed_gripper", "fixture"), serialization_alias="fixture"
    )
    obstacles: dict[str, Box] = Field(default_factory=dict)
    chute: ChuteSection | None = None
    trays: TraysSection
    interlocks: InterlocksSection = InterlocksSection()
    interlock_rules: InterlockRules = Field(default_factory=dict)
    accuracy: AccuracySection = AccuracySection()
    faults: FaultsSection = FaultsSection()
    detection: DetectionSection = DetectionSection()
    on_alarm: tuple[str, ...] = Field((), max_length=50)  # program and arguments
    _folder: Path = PrivateAttr(default=Path())

    @model_validator(mode="before")
    @classmethod
    def _is_no_recipe(cls, tree: Any) -> Any:  # noqa: ANN401 - pydantic's signature
        if is_recipe(tree):
            raise ValueError("is a recipe, not a cell file; name the cell file of this cell")
        return tree

    @model_validator(mode="after")
    def _lamps_are_all_there(self) -> "Cell":
        missing = [lamp for lamp in REQUIRED_LAMPS if lamp not in self.lamps]
        if missing:
            raise ValueError(f"`lamps` lacks {', '.join(missing)}")
        _all_different("`lamps`: analog channel", {n: x.analog for n, x in self.lamps.items()})
        _all_different("`lamps`: relay", {n: x.relay for n, x in self.lamps.items()})
        return self

    @model_validator(mode="after")
    def _cameras_see_what_they_are_for(self) -> "Cell":
        area = self.table.drop_area
        middle = (sum(area.x) / 2, sum(area.y) / 2, 0.0)
        for name, camera, point, what in (
            ("overhead", self.cameras.overhead, middle, "the middle of `table.drop_area`"),
            ("inspection", self.cameras.inspection, self.station.position, "`station.position`"),
        ):
            if not camera.sees(np.array(point)):
                raise WrongKeyError(
                    ("cameras", name, "pose"), f"{what} is not in its picture; {IN_MM}"
                )
        return self

    @property
    def folder(self) -> Path:
        """Folder of the cell file, where it was read from one."""
        return self._folder

    def read_from(self, path: Path) -> Self:
        """Return this cell, which knows that it was read from ``path``."""
        self._folder = path.absolute().parent
        return self

    @property
    def emulated_devices(self) -> tuple[str, ...]:
        """The names of the devices to be emulated."""
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


__all__ = ["EMULATED", "Cell", "ConfigError"]
