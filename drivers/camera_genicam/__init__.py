"""GenICam cameras (GigE Vision, USB3 Vision) by the system library aravis.

A frame is triggered by software after the lamps have settled; everything that its grey levels and
its geometry depend on is set and read back. Not responsible for light, lens or the content of
pictures. Needs libaravis, and no Python package.
"""

from dataclasses import dataclass

from messages import say

from .. import kinds
from ..kinds import Driver, Site
from ._aravis import Aravis, AravisError, DeviceFault, Handle, Listed, Received, Stream
from ._camera import Camera, load_library
from ._features import STEP_SHARE
from ._formats import FORMATS, PixelFormat, decode, wanted_formats
from ._session import Library
from ._types import CameraConfig, CameraIdentity, CameraStats, Frame, Setting

__all__ = [
    "DRIVER",
    "FORMATS",
    "STEP_SHARE",
    "Aravis",
    "AravisError",
    "Camera",
    "CameraConfig",
    "CameraIdentity",
    "CameraStats",
    "DeviceFault",
    "Frame",
    "GenICamSettings",
    "Handle",
    "Library",
    "Listed",
    "PixelFormat",
    "Received",
    "Setting",
    "Stream",
    "decode",
    "load_library",
    "wanted_formats",
]

MIN_PACKET_SIZE = 576  # every IPv4 link carries packets of that size
MAX_PACKET_SIZE = 16384


@dataclass(frozen=True, slots=True)
class GenICamSettings:
    """The camera expected, and the settings that a cell file has no key for.

    Attributes
    ----------
    model, serial : model and serial number that the camera must have; empty for any
    offset_px : of the picture on the sensor: column, row
    gain : in the camera's own unit, mostly dB; None for its lowest
    black_level : in the camera's own unit; None for 0, or its lowest where that is above 0
    packet_size : of a GigE Vision stream [bytes]; 9000 where every switch and card on the way
        carries jumbo frames
    """

    model: str = ""
    serial: str | int = ""
    offset_px: tuple[int, int] = (0, 0)
    gain: float | None = None
    black_level: float | None = None
    packet_size: int = 1500

    def __post_init__(self) -> None:
        if not MIN_PACKET_SIZE <= self.packet_size <= MAX_PACKET_SIZE:
            raise ValueError(
                f"packet_size must be {MIN_PACKET_SIZE} to {MAX_PACKET_SIZE} bytes, not "
                f"{self.packet_size}"
            )
        if min(self.offset_px) < 0:
            raise ValueError(f"offset_px must not be negative, as {list(self.offset_px)} is")


def _build(site: Site, settings: GenICamSettings) -> Camera:
    capture = site.capture
    if capture is None:
        raise ValueError(f"{site.name}: no settings for this camera")
    config = CameraConfig(
        address=site.address,
        width=capture.width,
        height=capture.height,
        formats=wanted_formats(capture.formats),
        exposure_s=capture.exposure_s,
        fps=capture.fps,
        settle_frame_count=capture.settle_frames,
        frame_late_s=capture.frame_late_s,
        model=settings.model,
        serial=str(settings.serial),
        offset_px=settings.offset_px,
        gain=settings.gain,
        black_level=settings.black_level,
        packet_size=settings.packet_size,
    )
    return Camera(config, site.clock, wires=site.wires, name=site.name)


def _needs() -> str:
    return say("aravis {version}", version=load_library().version)


DRIVER: Driver[kinds.Camera, GenICamSettings] = Driver(GenICamSettings, _build, needs=_needs)
