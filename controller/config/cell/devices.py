"""The devices' addresses, the meaning of the inputs, and the time-outs of the controller."""

from typing import Annotated, Any, Literal, Self

from pydantic import AliasChoices, Field, model_validator

from ..yaml_models import Section, WrongKeyError
from .values import require_all_different

EMULATED = "emulated"
Parity = Literal["N", "E", "O"]  # of a serial line: none, even, odd
DriverName = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_.-]*$", max_length=80)]


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

    @property
    def has_own_driver(self) -> bool:
        """True if its driver is the one that a cell file without `driver` gets."""
        return bool(self.driver == type(self).model_fields["driver"].default)


class ArmDevice(DeviceSection):
    """The arm, on a line of its own."""

    driver: DriverName = "umi_rtx"


class CameraDevice(DeviceSection):
    """A camera node."""

    driver: DriverName = "v4l2"


class LineSection(DeviceSection):
    """A device on a Modbus line: `host:port` for tcp and rtu-tcp, a serial device for rtu.

    All devices on a line must have the same settings for it.

    Attributes
    ----------
    transport : framing and transport of requests
    baudrate, parity : baudrate and parity of a serial line
    echo : the line brings back what is sent, as an RS-485 adapter with local echo does
    returns_ids : answers over TCP have the transaction number and unit id of their request; false
        for a gateway that puts its own
    reply_s : one that takes longer to answer counts as silent [s of cell time]; None:
        `timing.modbus_reply_s`
    retries : a read without an answer is repeated so often
    """

    transport: Literal["tcp", "rtu", "rtu-tcp"] = "tcp"
    baudrate: int = Field(115200, ge=1200, le=1_000_000)
    parity: Parity = "N"
    echo: bool = False
    returns_ids: bool = True
    reply_s: float | None = Field(None, ge=0.05, le=5)
    retries: int = Field(1, ge=0, le=5)

    @model_validator(mode="after")
    def _fits_the_transport(self) -> Self:
        if self.echo and self.transport == "tcp":
            raise ValueError("`echo` is for rtu and rtu-tcp only; Modbus TCP has none")
        if not self.returns_ids and self.transport != "tcp":
            raise ValueError("`returns_ids` is for Modbus TCP only; RTU has no transaction numbers")
        return self


class ModbusSection(LineSection):
    """A Modbus device with one unit id.

    Attributes
    ----------
    unit : its id on the line
    """

    unit: int = Field(1, ge=1, le=247)


class GripperDevice(ModbusSection):
    """The fixed gripper."""

    driver: DriverName = "robotiq_2f"


class IoDevice(ModbusSection):
    """The I/O block."""

    driver: DriverName = "moxa_e1214"


class LightsSection(LineSection):
    """The two light modules on one line.

    Attributes
    ----------
    analog_unit, relay_unit : unit ids of the module that dims, of the one that switches
    """

    driver: DriverName = "waveshare"
    analog_unit: int = Field(1, ge=1, le=247)
    relay_unit: int = Field(2, ge=1, le=247)
    baudrate: int = Field(9600, ge=1200, le=1_000_000)

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

    @model_validator(mode="after")
    def _share_no_wire(self) -> "DevicesSection":
        """Refuse what this project's drivers cannot share; others read addresses as they like."""
        owner: dict[tuple[str, int | None], str] = {}
        for name, device, unit in (
            ("gripper", self.gripper, self.gripper.unit),
            ("lights", self.lights, self.lights.analog_unit),
            ("lights", self.lights, self.lights.relay_unit),
            ("io", self.io, self.io.unit),
            ("arm", self.arm, None),
            ("overhead", self.overhead, None),
            ("inspection", self.inspection, None),
        ):
            if device.address == EMULATED or not device.has_own_driver:
                continue
            of_line = [taken for (where, _), taken in owner.items() if where == device.address]
            if unit is None and of_line:
                raise ValueError(f"{of_line[0]} and {name} have {device.address}, both")
            taken = owner.setdefault((device.address, unit), name)
            if taken != name:
                raise ValueError(f"{taken} and {name} have unit {unit} at {device.address}, both")
        return self


class InterlocksSection(Section):
    """Inputs of the I/O block, counted from 0.

    Attributes
    ----------
    emergency_stop, door, supply : the copy of the emergency stop, the door, the
        motors' supply; 1 is healthy
    part_in_nest, part_in_fixed_gripper : sensors of a part
    acknowledge : the button that acknowledges
    """

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
        require_all_different("input", self.model_dump())
        return self


Output = Annotated[int, Field(ge=0, le=15)]


class OutputsSection(Section):
    """Outputs of the I/O block that tell a PLC at 24 V what is so, counted from 0; None: not wired.

    All are off while no run is on, and once a run is killed or its computer stops.

    Attributes
    ----------
    ready : the run looks for its next part
    busy : the run is at anything else: homing, a part, a pause, a question
    result_valid : `accept` and `reject` are of the part that was placed last; with neither on, it
        is in quarantine
    accept, reject : the tray in which that part was placed
    held : the run asks a person
    fault : the run aborts
    """

    ready: Output | None = None
    busy: Output | None = None
    result_valid: Output | None = None
    accept: Output | None = None
    reject: Output | None = None
    held: Output | None = None
    fault: Output | None = None

    @property
    def wired(self) -> dict[str, int]:
        """The output of each signal that is wired."""
        return self.model_dump(exclude_none=True)

    @model_validator(mode="after")
    def _outputs_differ(self) -> "OutputsSection":
        require_all_different("output", self.wired)
        return self


class TimingSection(Section):
    """The controller's time-outs for the devices, in seconds of cell time.

    Attributes
    ----------
    io_poll_s : period of the input readings
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
    """The longest times until a loss is noticed, in seconds of cell time.

    Attributes
    ----------
    arm_silent_s : a silent line of the arm, at rest and in motion
    arm_beat_s : period of polls of the arm at rest; part of `arm_silent_s`
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
