"""Build and connect all devices of the cell. Each has its kind's protocol; no decisions here."""

import asyncio
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, cast

from controller.config import EMULATED, Cell, ConfigError
from controller.config.cell import DeviceSection, LineSection
from controller.setup.drivers import KIND_OF, find_driver, read_settings, read_shape
from drivers.clock import CellClock
from drivers.errors import DeviceError
from drivers.kinds import (
    Arm,
    Camera,
    Capture,
    Driver,
    FixedGripper,
    IoBlock,
    JawReading,
    Lamp,
    LampUnit,
    MotorWatchdog,
    Polling,
    SignalOutputs,
    Site,
    Stop,
)
from drivers.modbus_link import (
    Address,
    ModbusLink,
    RtuAddress,
    RtuOverTcpAddress,
    TcpAddress,
)
from drivers.wires import UNTAPPED, Wires

from .measured_gripper import MeasuredGripper, OpeningScale

Addresses = Mapping[str, Any]

_LINE_AS_BEFORE = {
    key: field.default
    for key, field in LineSection.model_fields.items()
    if key not in DeviceSection.model_fields
}
IO_POLL_WALL_S = 0.02  # period of polls of an emulated block, however fast its time runs
STALE_POLLS = 5


def _modbus_address(device: str, section: Mapping[str, Any]) -> Address:
    address, transport = section["address"], section["transport"]
    if transport == "rtu":
        baudrate, parity = section["baudrate"], section["parity"]
        return RtuAddress(address, baudrate, parity, echoes=section["echo"])
    host, _, port = address.rpartition(":")
    if not host or not port.isdigit():
        raise ConfigError(
            f"devices.{device}.address: `{address}` is not host:port, which {transport} requires"
        )
    if transport == "tcp":
        return TcpAddress(host, int(port), section["returns_ids"])
    return RtuOverTcpAddress(host, int(port), section["echo"])


def polling_of(cell: Cell, clock: CellClock) -> Polling:
    """Return the polling period of the inputs, on a clock that may run faster than the wall's."""
    timing = cell.timing
    return Polling(
        # a faster clock does not shorten the host's own pauses
        poll_s=max(timing.io_poll_s, IO_POLL_WALL_S * clock.speed),
        stale_s=max(timing.io_stale_s, STALE_POLLS * IO_POLL_WALL_S * clock.speed),
    )


def resolve(cell: Cell, emulated: Addresses) -> dict[str, dict[str, Any]]:
    """Return each device's address: from the cell file, or as printed by the emulator.

    Parameters
    ----------
    cell : the cell file
    emulated : the emulator's output under ``devices``

    Raises
    ------
    ConfigError : a device is emulated and no emulator offers it
    """
    found: dict[str, dict[str, Any]] = {}
    for name in type(cell.devices).model_fields:
        section = getattr(cell.devices, name)
        settings = section.model_dump()
        if section.address == EMULATED:
            if name not in emulated:
                raise ConfigError(
                    f"devices.{name}: is `{EMULATED}`, but the emulator does not offer it; give "
                    "its address"
                )
            offered = emulated[name]
            if isinstance(offered, str):
                settings["address"] = offered
            else:
                where = offered.get("path") or f"{offered['host']}:{offered['port']}"
                settings |= {k: v for k, v in offered.items() if k in settings}
                if "path" in offered:
                    settings["transport"] = "rtu"
                settings["address"] = where
        found[name] = settings | {"emulated": section.address == EMULATED}
    return found


class DeviceBuilder:
    """Makes the drivers of a cell, one by one; devices on one Modbus line share it.

    Parameters
    ----------
    cell : as its file describes it
    where : address of each device, as `resolve` returns it
    clock : the clock of the devices
    wires : recorder or player of the devices' wires
    """

    def __init__(
        self,
        cell: Cell,
        where: Mapping[str, dict[str, Any]],
        clock: CellClock,
        wires: Wires = UNTAPPED,
    ) -> None:
        self._cell = cell
        self._where = where
        self._clock = clock
        self._wires = wires
        self._links: dict[Address, ModbusLink] = {}
        self._lines: dict[str, tuple[str, object]] = {}  # first device, what it says of it

    @property
    def links(self) -> tuple[ModbusLink, ...]:
        """The lines of the devices made so far; close them together with the devices."""
        return tuple(self._links.values())

    def arm(self) -> Arm:
        """Return the arm."""
        return cast(Arm, self.device("arm"))

    def gripper(self) -> FixedGripper:
        """Return the fixed gripper, its openings as its calibration measured them."""
        device = cast(FixedGripper, self.device("gripper"))
        section = self._cell.fixed_gripper
        openings = OpeningScale(section.opening_zero_mm, section.opening_scale)
        return device if openings == OpeningScale() else MeasuredGripper(device, openings)

    def lights(self) -> LampUnit:
        """Return the lamp unit."""
        return cast(LampUnit, self.device("lights"))

    def io(self) -> IoBlock:
        """Return the I/O block.

        Raises
        ------
        ConfigError : as `device`, or it has no outputs and the cell file names some
        """
        block = cast(IoBlock, self.device("io"))
        if self._cell.outputs.wired and not isinstance(block, SignalOutputs):
            raise ConfigError(
                f"outputs: the driver `{self._where['io']['driver']}` of the I/O block switches no "
                "outputs; leave them out"
            )
        return block

    def camera(self, name: str) -> Camera:
        """Return a camera, ``overhead`` or ``inspection``."""
        return cast(Camera, self.device(name))

    def device(self, name: str) -> object:
        """Return a device by its name in the cell file, not open yet.

        Raises
        ------
        ConfigError : no such driver is installed, or its settings or its address are wrong
        """
        section = self._where[name]
        kind = KIND_OF[name]
        driver = find_driver(kind, section["driver"])
        where = f"devices.{name}"
        settings = read_settings(driver, section["settings"], where)
        try:
            return driver.build(self._site(name, kind, section, driver), settings)
        except ValueError as error:
            raise ConfigError(f"{where}: {error}") from error

    def _site(
        self, name: str, kind: str, section: Mapping[str, Any], driver: Driver[Any, Any]
    ) -> Site:
        polling = polling_of(self._cell, self._clock)
        lamps = tuple(
            Lamp(lamp, s.analog, s.relay, s.drive, s.settle_s)
            for lamp, s in self._cell.lamps.items()
        )
        return Site(
            name=name,
            address=section["address"],
            section=section,
            clock=self._clock,
            open_link=lambda: self._link(name),
            polling=polling if kind == "io" else None,
            inputs=self._inputs() if kind == "io" else {},
            outputs=self._cell.outputs.wired if kind == "io" else {},
            lamps=lamps if kind == "lights" else (),
            capture=self._capture(name) if kind == "camera" else None,
            silence_s=self._cell.detection.arm_silent_s - self._cell.detection.arm_beat_s,
            wires=self._wires,
            folder=self._cell.folder,
            shape=read_shape(driver, self._cell) if kind == "arm" else None,
        )

    def _inputs(self) -> dict[str, int]:
        """Return the input number of each signal, from the cell file."""
        wired = self._cell.interlocks
        return {
            "estop_ok": wired.emergency_stop,
            "guard_closed": wired.door,
            "part_in_nest": wired.part_in_nest,
            "part_in_gripper": wired.part_in_fixed_gripper,
            "supply_ok": wired.supply,
            "acknowledge": wired.acknowledge,
        }

    def _capture(self, name: str) -> Capture:
        section = getattr(self._cell.cameras, name)
        width, height = section.size_px
        return Capture(
            width=width,
            height=height,
            formats=section.formats,
            fps=section.fps,
            exposure_s=section.exposure_s,
            settle_frames=section.settle_frames,
            margin_s=section.margin_s,
            frame_late_s=self._cell.timing.frame_late_s,
        )

    def _link(self, name: str) -> ModbusLink:
        # what an older recording does not say is as it was then
        section = _LINE_AS_BEFORE | self._where[name]
        address = _modbus_address(name, section)
        said = (address, section["reply_s"], section["retries"])
        first, of_first = self._lines.setdefault(section["address"], (name, said))
        if said != of_first:
            raise ConfigError(
                f"devices.{name} and devices.{first}: both are on the line {section['address']}; "
                "make transport, baudrate, parity, echo, returns_ids, reply_s and retries the same"
            )
        if address not in self._links:
            through, tap = self._wires.modbus(address)
            reply_s = section["reply_s"]
            self._links[address] = ModbusLink(
                through,
                self._clock,
                reply_timeout_s=self._cell.timing.modbus_reply_s if reply_s is None else reply_s,
                retry_count=section["retries"],
                tap=tap,
            )
        return self._links[address]


@dataclass(slots=True)
class Devices:
    """The cell's devices, connected.

    Attributes
    ----------
    links : the Modbus lines they are on
    jaws_found : state of the arm gripper at the arm's first reply
    wires : recorder or player of the devices' wires
    """

    arm: Arm
    gripper: FixedGripper
    lights: LampUnit
    io: IoBlock
    overhead: Camera
    inspection: Camera
    links: tuple[ModbusLink, ...] = field(default=())
    jaws_found: JawReading | None = None
    wires: Wires = UNTAPPED

    @classmethod
    def build(
        cls,
        cell: Cell,
        where: Mapping[str, dict[str, Any]],
        clock: CellClock,
        wires: Wires = UNTAPPED,
    ) -> "Devices":
        """Return the drivers, none of them open yet. Needs a running event loop.

        Parameters
        ----------
        cell : as its file describes it
        where : address of each device, as `resolve` returns it
        clock : the clock of the devices
        wires : recorder or player of the devices' wires

        Raises
        ------
        ConfigError : no such driver is installed, or its settings or its address are wrong
        """
        builder = DeviceBuilder(cell, where, clock, wires)
        devices = cls(
            arm=builder.arm(),
            gripper=builder.gripper(),
            lights=builder.lights(),
            io=builder.io(),
            overhead=builder.camera("overhead"),
            inspection=builder.camera("inspection"),
        )
        devices.links = builder.links
        devices.wires = wires
        return devices

    async def connect(self) -> dict[str, str]:
        """Open every device, halt all motion; return the devices' identities.

        Raises
        ------
        DeviceError : a device does not answer or is not what it should be; the first one is named
        """
        who = await self.connect_grippers()
        await self.lights.connect()
        await self.overhead.connect()
        await self.inspection.connect()
        await self.overhead.pause()
        await self.inspection.pause()
        return {
            **who,
            "lights": self.lights.model,
            "overhead": self.overhead.model,
            "inspection": self.inspection.model,
        }

    async def connect_grippers(self) -> dict[str, str]:
        """Open the arm, the fixed gripper and the I/O block; halt motion; return their identities.

        The last motion ordered by a killed controller continues without it. A stop opens no jaw.

        Raises
        ------
        DeviceError : a device does not answer or is not what it should be; the first one is named
        """
        await self.io.connect()
        await self.arm.connect()
        # read before the stop, which may clear the jaws' status (umi_rtx.md 2.8)
        self.jaws_found = await self.arm.read_jaws()
        await self.arm.stop(Stop.DEAD)
        if isinstance(self.io, MotorWatchdog):  # not before the stop: it takes a second
            await self.io.prove_watchdog()
        gripper = await self.gripper.connect()
        if gripper.is_moving:
            await self.gripper.stop()
        return {
            "arm": self.arm.model,
            "gripper": self.gripper.model + (", active" if gripper.is_activated else ""),
            "io": self.io.model,
        }

    async def aclose(self) -> None:
        """Close everything in any state; opens no jaw and moves nothing."""
        for closing in (
            self.overhead.close,
            self.inspection.close,
            self.gripper.aclose,
            self.io.aclose,
            self.arm.aclose,
            *(one.aclose for one in self.links),
        ):
            # a device that is gone fails to close; the others must still be closed
            with suppress(DeviceError, OSError, asyncio.TimeoutError):
                await closing()
