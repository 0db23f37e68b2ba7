"""The cameras of the emulated cell, each of the kind that the cell file's driver speaks to."""

import asyncio
import logging
from collections.abc import Hashable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, Literal, Protocol

from emulators.camera_genicam import CameraConfig as GenicamConfig
from emulators.camera_genicam import GenicamDevice, GenicamServer, Sensor
from emulators.camera_v4l2 import CameraConfig, CameraServer, PixelFormat, V4l2Device
from emulators.clock import WorldClock
from emulators.world import CameraLayout, DriverChoice, LayoutError, Picture, PictureDesk

log = logging.getLogger(__name__)

_V4L2: Final = "v4l2"
_GENICAM: Final = "genicam"


class EmulatedCamera(Protocol):
    """A camera of either kind.

    Attributes
    ----------
    faults : a frozen dataclass, the kind's own
    """

    faults: Any

    @property
    def is_plugged(self) -> bool:
        """Whether the camera is there."""
        ...

    @property
    def lost_count(self) -> int:
        """Frames lost since pictures were last asked for."""
        ...

    @property
    def oldest_due_s(self) -> float | None:
        """The end of the oldest exposure whose picture is on its way; None without one."""
        ...

    def unplug(self) -> None:
        """Pull its cable."""

    def plug(self) -> None:
        """Put its cable back."""


class _V4l2View:
    """One camera's view, as a V4L2 camera orders it."""

    def __init__(self, desk: PictureDesk, camera: int, *, is_deep: bool) -> None:
        self._desk, self._camera = desk, camera
        self._bits = 16 if is_deep else 8
        self.device: V4l2Device | None = None

    def expose(
        self, start_s: float, end_s: float, exposure_s: float, gain: float
    ) -> Hashable | None:
        """Order the picture of an exposure; it shows the world at its middle."""
        middle_s = (start_s + end_s) / 2.0
        return self._desk.order(self._camera, middle_s, exposure_s, gain, self._bits, self._deliver)

    def _deliver(self, ticket: Hashable, picture: Picture) -> None:
        if self.device is not None:
            self.device.deliver(ticket, picture)


class _GenicamView:
    """One camera's view, as a GigE Vision camera orders it, on its event loop."""

    def __init__(self, desk: PictureDesk, camera: int) -> None:
        self._desk, self._camera = desk, camera
        self._loop: asyncio.AbstractEventLoop | None = None
        self.device: GenicamDevice | None = None

    def expose(
        self, start_s: float, end_s: float, exposure_s: float, gain: float, bits: int
    ) -> Hashable | None:
        """Order the picture of an exposure; it shows the world at its middle."""
        self._loop = asyncio.get_running_loop()
        middle_s = (start_s + end_s) / 2.0
        return self._desk.order(self._camera, middle_s, exposure_s, gain, bits, self._deliver)

    def _deliver(self, ticket: Hashable, picture: Picture) -> None:
        """Hand a picture from the desk's thread to the camera's loop."""
        if self._loop is not None and self.device is not None:
            with suppress(RuntimeError):  # the loop is closed, and the camera with it
                self._loop.call_soon_threadsafe(self.device.deliver, ticket, picture)


class Cameras:
    """All cameras of a cell, and their wires.

    Parameters
    ----------
    layouts : the cameras of the cell file
    drivers : the cell file's entries on drivers, by device
    desk : makes the pictures
    clock : the world's time
    seed : decides which packets are lost by chance

    Raises
    ------
    LayoutError : there is no emulated camera for a driver, or a format is unknown
    """

    def __init__(
        self,
        layouts: Mapping[str, CameraLayout],
        drivers: Mapping[str, DriverChoice],
        desk: PictureDesk,
        clock: WorldClock,
        seed: int,
    ) -> None:
        self._clock = clock
        self._v4l2: dict[str, V4l2Device] = {}
        self._genicam: dict[str, GenicamDevice] = {}
        self._v4l2_server: CameraServer | None = None
        self._genicam_server: GenicamServer | None = None
        for number, (name, layout) in enumerate(layouts.items()):
            driver = drivers.get(name, DriverChoice()).driver or _V4L2
            if driver == _V4L2:
                config = _v4l2_config(name, layout, number)
                v4l2_view = _V4l2View(desk, number, is_deep=PixelFormat.Y16 in config.formats)
                self._v4l2[name] = v4l2_view.device = V4l2Device(v4l2_view, clock, config)
            elif driver == _GENICAM:
                view = _GenicamView(desk, number)
                sensor = Sensor(layout.width_px, layout.height_px, layout.fps)
                named = GenicamConfig(sensor=sensor, user_name=name)
                device = GenicamDevice(view, clock, named, seed + number)
                self._genicam[name] = view.device = device
            else:
                raise LayoutError(
                    f"devices.{name}.driver `{driver}` cannot be emulated (emulated: "
                    f"{_GENICAM}, {_V4L2}); give the address of a real one"
                )
            log.info("camera %s: %d x %d px", name, layout.width_px, layout.height_px)

    @property
    def devices(self) -> dict[str, EmulatedCamera]:
        """The cameras by name."""
        return {**self._v4l2, **self._genicam}

    async def start(self, folder: Path, transport: Literal["auto", "fuse", "socket"]) -> None:
        """Open the wires.

        Parameters
        ----------
        folder : a directory of their own
        transport : of V4L2 cameras, as `CameraServer` takes it

        Raises
        ------
        OSError : FUSE was asked for and cannot be had, or no address is free
        """
        if self._v4l2:
            self._v4l2_server = CameraServer(self._v4l2, folder, transport)
            await self._v4l2_server.start()
        if self._genicam:
            self._genicam_server = GenicamServer(self._genicam, self._clock)
            await self._genicam_server.start()

    async def run(self) -> None:
        """Let all cameras take pictures, until cancelled."""
        async with asyncio.TaskGroup() as tasks:
            for server in (self._v4l2_server, self._genicam_server):
                if server is not None:
                    tasks.create_task(server.run())

    async def aclose(self) -> None:
        """Close the wires; may be called half-way through `start`."""
        for server in (self._genicam_server, self._v4l2_server):
            if server is not None:
                await server.aclose()

    @property
    def addresses(self) -> dict[str, str]:
        """The address of each plugged camera: a path, or that of a GigE Vision camera."""
        servers = (self._v4l2_server, self._genicam_server)
        return {k: v for one in servers if one is not None for k, v in one.addresses.items()}

    @property
    def transport(self) -> str | None:
        """The wire of V4L2 cameras, ``fuse`` or ``socket``; None if there are none."""
        return None if self._v4l2_server is None else self._v4l2_server.transport

    @property
    def why_not_fuse(self) -> str | None:
        """The reason for sockets; None with FUSE, or if sockets were asked for."""
        return None if self._v4l2_server is None else self._v4l2_server.why_not_fuse

    def unplug(self, name: str) -> None:
        """Pull a camera's cable.

        Raises
        ------
        ValueError : the cell has not started
        """
        self._server_of(name).unplug(name)

    def plug(self, name: str) -> str:
        """Put an unplugged camera back; return its address.

        Raises
        ------
        ValueError : the cell has not started
        """
        return self._server_of(name).plug(name)

    def _server_of(self, name: str) -> CameraServer | GenicamServer:
        server = self._v4l2_server if name in self._v4l2 else self._genicam_server
        if server is None:
            raise ValueError(f"camera {name} has no cable before the cell starts")
        return server


def _v4l2_config(name: str, camera: CameraLayout, number: int) -> CameraConfig:
    rate_hz = round(camera.fps)
    try:
        formats = tuple(PixelFormat[one] for one in camera.formats)
    except KeyError as error:
        raise LayoutError(f"cameras.{name}.formats: {error} is unknown") from error
    return CameraConfig(
        card=f"Emulated {name}",
        bus_info=f"usb-0000:00:14.0-{1 + number}",
        sizes_px=(
            (camera.width_px, camera.height_px),
            (camera.width_px // 2, camera.height_px // 2),
        ),
        formats=formats,
        rates_hz=tuple(sorted({rate_hz, 5, 2, 1}, reverse=True)),
        default_rate_hz=rate_hz,
        # with a second picture in the making, the one that is wanted would have to wait
        in_flight_max=1,
    )
