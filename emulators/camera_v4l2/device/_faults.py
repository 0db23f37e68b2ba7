"""The faults of the camera, as ordinary inputs of a test or of a control port."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Faults:
    """Faults in force; counts run down by themselves. Unplugging is the device's own verb.

    Attributes
    ----------
    error_count : so many frames to come carry the ERROR flag
    short_count : so many frames to come end half-way (`bytesused`)
    broken_jpeg_count : so many MJPG frames to come are zeros in their last third, end marker
        included
    lost_count : so many frames to come are lost, their buffers stay queued, their numbers are
        used up
    is_stalled : no frame comes at all until this is taken back; numbers run on
    is_frozen : frames come in time and numbered, with the same old picture in them
    is_dark : no light reaches the sensor: a cap is on the lens
    late_count : so many frames to come reach their buffers late, each at the time of its exposure
    late_s : by how much [world s]
    control_delay_frames : a control's new value shows so many frames later than it could
    timestamp_unknown : buffers are stamped by a clock that is not CLOCK_MONOTONIC, and not flagged
    """

    error_count: int = 0
    short_count: int = 0
    broken_jpeg_count: int = 0
    lost_count: int = 0
    is_stalled: bool = False
    is_frozen: bool = False
    is_dark: bool = False
    late_count: int = 0
    late_s: float = 0.5
    control_delay_frames: int = 0
    timestamp_unknown: bool = False
