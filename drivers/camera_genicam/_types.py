"""The input of a camera (its configuration) and its output (frames, identity, tallies)."""

from dataclasses import dataclass

from ._formats import Image, PixelFormat


@dataclass(frozen=True, slots=True)
class CameraConfig:
    """The address and settings of a camera.

    Attributes
    ----------
    address : IP address, serial number, or the name vendor-model-serial
    width, height : of a picture [px]
    formats : pixel formats, the best first
    exposure_s : exposure of a frame [s]
    fps : the camera exposes, reads out and sends so many frames a second, or more
    settle_frame_count : frames taken and thrown away after connecting
    frame_late_s : a frame may come this much later than rate and exposure explain [cell s]
    model, serial : those that the camera must have; empty for any
    offset_px : of the picture on the sensor: column, row
    gain, black_level : in the camera's own units; None for the lowest gain, and for a black level
        of 0 or, where the camera has none so low, its lowest
    packet_size : of a GigE Vision stream [bytes], IP header and all
    """

    address: str
    width: int
    height: int
    formats: tuple[PixelFormat, ...]
    exposure_s: float
    fps: float
    settle_frame_count: int = 0
    frame_late_s: float = 5.0
    model: str = ""
    serial: str = ""
    offset_px: tuple[int, int] = (0, 0)
    gain: float | None = None
    black_level: float | None = None
    packet_size: int = 1500

    @property
    def frame_s(self) -> float:
        """Time from a trigger to the end of its frame [s]: exposure, readout, and the way here."""
        return self.exposure_s + 2.0 / self.fps


@dataclass(frozen=True, slots=True)
class Setting:
    """A feature that the driver relies on.

    Attributes
    ----------
    feature : its name in the camera
    value : value it has now, as text; "absent" if the camera has no such feature
    was : value that the driver found; empty if it was the same
    """

    feature: str
    value: str
    was: str = ""


@dataclass(frozen=True, slots=True)
class CameraIdentity:
    """The identity that the camera reports.

    Attributes
    ----------
    vendor, model, serial : of the camera
    firmware : its version, empty if it has none
    pixel_format : name of the pixel format chosen
    white : the largest value of a pixel
    width, height : of its pictures [px]
    exposure_s : exposure that it took [s]
    packet_size : of its stream [bytes]; 0 on USB
    library : version of aravis
    """

    vendor: str
    model: str
    serial: str
    firmware: str
    pixel_format: str
    white: int
    width: int
    height: int
    exposure_s: float
    packet_size: int
    library: str

    @property
    def words(self) -> str:
        """Vendor, model, serial number."""
        return " ".join(part for part in (self.vendor, self.model, self.serial) if part)


@dataclass(slots=True)
class CameraStats:
    """Tallies since the camera object was made.

    Attributes
    ----------
    delivered_count : frames handed over
    trigger_count : software triggers sent
    stale_count : frames that may be of an earlier trigger
    settling_count : frames thrown away after connecting
    incomplete_count : buffers with packets missing, or with another fault
    out_of_step_count : frames whose number was not the next one
    unanswered_count : triggers whose frame had not come when the next picture was due
    missing_packet_count, resend_request_count, resent_packet_count : packets of a GigE Vision
        stream that were lost for good, asked for again, and sent again
    """

    delivered_count: int = 0
    trigger_count: int = 0
    stale_count: int = 0
    settling_count: int = 0
    incomplete_count: int = 0
    out_of_step_count: int = 0
    unanswered_count: int = 0
    missing_packet_count: int = 0
    resend_request_count: int = 0
    resent_packet_count: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One picture and when it was taken.

    Attributes
    ----------
    image : (height, width) uint8 or uint16, read-only
    white : the largest value a pixel can have
    timestamp_s : when the whole frame was here [cell s]
    earliest_light_s : before its trigger was sent: no light of an earlier instant is in it [cell s]
    exposure_s : exposure that the camera took [s]
    frame_id : the camera's number of the frame
    stamp_ns : the camera's own time stamp, on a clock of its own [ns]
    """

    image: Image
    white: int
    timestamp_s: float
    earliest_light_s: float
    exposure_s: float
    frame_id: int
    stamp_ns: int
