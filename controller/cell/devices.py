"""All devices of the cell behind their drivers' public names; nothing here decides anything."""

import asyncio
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from controller.config import EMULATED, Cell, ConfigError
from drivers.camera_v4l2 import Camera, CameraConfig
from drivers.clock import CellClock
from drivers.errors import DeviceError
from drivers.gripper_modbus import Gripper, GripperConfig, ObjectState
from drivers.io_modbus import CellIo, IoConfig
from drivers.lighting_modbus import LampChannel, Lights, LightsConfig
from drivers.modbus_link import (
    Address,
    ModbusLink,
    RtuAddress,
    RtuOverTcpAddress,
    TcpAddress,
)
from drivers.umi_scara import JawReading, Stop, UmiScara

Addresses = Mapping[str, Any]

IO_POLL_WALL_S = 0.02  # an emulated block is not asked more often, however fast time runs
STALE_POLLS = 5


def _modbus_address(device: str, address: str, transport: str, baudrate: int) -> Address:
    if transport == "rtu":
        return RtuAddress(address, baudrate)
    host, _, port = address.rpartition(":")
    if not host or not port.isdigit():
        raise ConfigError(
            f"devices.{device}.address: `{address}` is not host:port, which {transport} asks for"
        )
    return TcpAddress(host, int(port)) if transport == "tcp" else RtuOverTcpAddress(host, int(port))


def resolve(cell: Cell, emulated: Addresses) -> dict[str, dict[str, Any]]:
    """Return where every device is: from the cell file, or from the emulator's own word.

    Parameters
    ----------
    emulated : what the emulator printed under ``devices``

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
                raise ConfigError(f"devices.{name}: is emulated, but no emulator offers it")
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


@dataclass(slots=True)
class Devices:
    """The cell's devices, connected.

    Attributes
    ----------
    jaws_found : how the arm gripper stood when the arm answered first
    """

    arm: UmiScara
    gripper: Gripper
    lights: Lights
    io: CellIo
    overhead: Camera
    inspection: Camera
    links: tuple[ModbusLink, ...]
    jaws_found: JawReading | None = None

    @classmethod
    def build(cls, cell: Cell, where: Mapping[str, dict[str, Any]], clock: CellClock) -> "Devices":
        """Make the drivers; nothing is opened yet. Needs a running event loop."""
        links: dict[Address, ModbusLink] = {}
        timing = cell.timing

        def link(name: str) -> ModbusLink:
            device = where[name]
            address = _modbus_address(
                name, device["address"], device["transport"], device["baudrate"]
            )
            if address not in links:
                links[address] = ModbusLink(address, clock, reply_timeout_s=timing.modbus_reply_s)
            return links[address]

        def camera(name: str) -> Camera:
            section = getattr(cell.cameras, name)
            return Camera(
                CameraConfig(
                    device=where[name]["address"],
                    width=section.size_px[0],
                    height=section.size_px[1],
                    pixel_formats=section.formats,
                    fps=section.fps,
                    exposure_s=section.exposure_s,
                    buffer_count=2,
                    settle_frame_count=section.settle_frames,
                    frame_margin_s=section.margin_s,
                    frame_timeout_s=timing.frame_late_s,
                ),
                clock=clock,
            )

        # the cell file counts channels from 0, the modules' print from 1
        lamps = tuple(
            LampChannel(name=name, analog_channel=lamp.analog + 1, relay_channel=lamp.relay + 1)
            for name, lamp in cell.lamps.items()
        )
        return cls(
            arm=UmiScara(where["arm"]["address"], clock=clock),
            gripper=Gripper(link("gripper"), GripperConfig(unit=where["gripper"]["unit"])),
            lights=Lights(
                link("lights"),
                LightsConfig(
                    lamps=lamps,
                    analog_unit=where["lights"]["analog_unit"],
                    relay_unit=where["lights"]["relay_unit"],
                ),
            ),
            io=CellIo(
                link("io"),
                IoConfig(
                    unit=where["io"]["unit"],
                    # the host's own pauses do not shrink with a faster clock
                    poll_s=max(timing.io_poll_s, IO_POLL_WALL_S * clock.speed),
                    stale_s=max(timing.io_stale_s, STALE_POLLS * IO_POLL_WALL_S * clock.speed),
                ),
            ),
            overhead=camera("overhead"),
            inspection=camera("inspection"),
            links=tuple(links.values()),
        )

    async def connect(self) -> dict[str, str]:
        """Open every device, halt what still moves; return who answered, by device.

        Raises
        ------
        DeviceError : the first device that is not there or not what it should be
        """
        who = await self.connect_grippers()
        await self.lights.connect()
        await self.overhead.connect()
        await self.inspection.connect()
        await self.overhead.pause()
        await self.inspection.pause()
        return {
            **who,
            "lights": "Waveshare analog output and relays",
            "overhead": f"{self.overhead.identity().card} ({self.overhead.identity().driver})",
            "inspection": f"{self.inspection.identity().card} "
            f"({self.inspection.identity().driver})",
        }

    async def connect_grippers(self) -> dict[str, str]:
        """Open what holds parts, and the I/O block; halt what still moves; return who answered.

        A controller that was killed leaves the last motion it had ordered. A stop opens no jaw.

        Raises
        ------
        DeviceError : the first device that is not there or not what it should be
        """
        await self.io.connect()
        arm = await self.arm.connect()
        # a stop may clear what the jaws say of themselves (umi_rtx.md 2.8)
        self.jaws_found = await self.arm.read_jaws()
        await self.arm.stop(Stop.DEAD)
        gripper = await self.gripper.connect()
        if gripper.is_going and gripper.object is ObjectState.MOVING:
            await self.gripper.stop()
        versions = ", ".join(
            f"{ip.name} ROM {version[1]}.{version[0]}" for ip, version in arm.rom_versions.items()
        )
        return {
            "arm": f"UMI RTX, {versions}",
            "gripper": "Robotiq 2F" + (", active" if gripper.is_activated else ""),
            "io": "Moxa E1214",
        }

    async def aclose(self) -> None:
        """Close everything, whatever state it is in; opens no jaw and moves nothing."""
        for closing in (
            self.overhead.close,
            self.inspection.close,
            self.gripper.aclose,
            self.io.aclose,
            self.arm.aclose,
            *(one.aclose for one in self.links),
        ):
            # a device that left cannot be closed politely, and the others still can
            with suppress(DeviceError, OSError, asyncio.TimeoutError):
                await closing()
