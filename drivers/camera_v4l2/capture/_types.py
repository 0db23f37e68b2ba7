"""The input of a camera (its configuration) and its output (frames, identity, tallies)."""

from dataclasses import dataclass
from pathlib import Path

from ..kernel import DEV_ROOT, SYSFS_ROOT
from ..kernel.abi import Cap
from ._decode import KINDS, Image
from .selection import StampSource


@dataclass(frozen=True, slots=True)
class CameraConfig:
    """The address and settings of a camera.

    Attributes
    ----------
    device : node path, ``unix:/path.sock``, ``serial:<USB serial>`` or ``usb:<port path>``
    width, height : picture requested [px]; what the camera grants is ``Camera.shape``
    pixel_formats : in the order of preference
    fps : frames a second requested
    exposure_s : exposure to set; None keeps the camera's own, switched to manual
    gain : in the camera's own units; None keeps it
    white_balance_k : colour temperature [K]; None keeps it
    buffer_count : pictures the kernel may hold
    frame_margin_s : time between a frame's stamp and the end of exposure it marks [s]; None assumes
        one frame period, two for a stamp taken at the first packet. Measured once per camera model
        by switching the light and counting frames
    settle_frame_count : frames not to be used after a change of exposure
    frame_timeout_s : patience beyond what frame rate and exposure explain [s]
    is_start_stamp_trusted : whether a stamp flagged "start of exposure" is one; None: unless the
        kernel driver is uvcvideo, which flags so but stamps the first packet's arrival
    dev_root, sysfs_root : folders searched for ``serial:`` and ``usb:``
    """

    device: str
    width: int = 1280
    height: int = 1024
    pixel_formats: tuple[str, ...] = ("GREY", "Y10", "Y12", "Y16", "YUYV", "MJPG")
    fps: float = 30.0
    exposure_s: float | None = None
    gain: int | None = None
    white_balance_k: int | None = None
    buffer_count: int = 4
    frame_margin_s: float | None = None
    settle_frame_count: int = 3
    frame_timeout_s: float = 5.0
    is_start_stamp_trusted: bool | None = None
    dev_root: Path = DEV_ROOT
    sysfs_root: Path = SYSFS_ROOT

    def __post_init__(self) -> None:
        unknown = [name for name in self.pixel_formats if name not in KINDS]
        if unknown or not self.pixel_formats:
            raise ValueError(f"pixel formats {unknown}: this driver reads {', '.join(KINDS)}")
        if self.width < 1 or self.height < 1 or not self.fps > 0:
            raise ValueError(f"{self.width} x {self.height} px at {self.fps} fps is no picture")
        if self.exposure_s is not None and not self.exposure_s > 0:
            raise ValueError(f"an exposure of {self.exposure_s} s")
        if self.buffer_count < 2:
            raise ValueError("a camera needs two buffers: one is filled while one is read")


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One picture and when it was taken.

    Attributes
    ----------
    image : (height, width) uint8 or uint16, read-only
    white : the largest value a pixel can have
    timestamp_s : the camera's stamp, or when it was dequeued; see ``stamp_source`` [cell s]
    earliest_light_s : no light before this instant is in the picture [cell s]
    sequence : the camera's frame number, 32 bit
    exposure_s : None if unknown or automatic [s]
    pixel_format : FourCC it travelled in
    flags : flags of the buffer, ``V4L2_BUF_FLAG_*``
    stamp_source : instant that ``timestamp_s`` marks
    """

    image: Image
    white: int
    timestamp_s: float
    earliest_light_s: float
    sequence: int
    exposure_s: float | None
    pixel_format: str
    flags: int
    stamp_source: StampSource


@dataclass(frozen=True, slots=True)
class CameraIdentity:
    """The identity that the camera reports.

    Attributes
    ----------
    node : path of the opened node
    driver, card, bus : kernel driver, model, where it is plugged in
    version : kernel version of the driver, such as "6.1.0"
    caps : capabilities of the node
    """

    node: str
    driver: str
    card: str
    bus: str
    version: str
    caps: Cap


@dataclass(slots=True)
class CameraStats:
    """Tallies since the camera object was made.

    Attributes
    ----------
    delivered_count : frames handed over
    dequeued_count : buffers taken from the queue, for whatever end
    stale_count : exposed, in part or wholly, before the instant required
    adapting_count : passed over after a change of exposure
    error_count : flagged ERROR by the camera's driver
    short_count : number of buffers with a wrong number of bytes
    broken_count : JPEGs that are not whole, lost data on the way or do not decode
    lost_count : missing by their sequence numbers while the driver waited for frames
    idle_gap_count : missing because nobody waited and the buffers were full
    restart_count : streams started over after an I/O error
    """

    delivered_count: int = 0
    dequeued_count: int = 0
    stale_count: int = 0
    adapting_count: int = 0
    error_count: int = 0
    short_count: int = 0
    broken_count: int = 0
    lost_count: int = 0
    idle_gap_count: int = 0
    restart_count: int = 0
