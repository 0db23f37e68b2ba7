"""The choice of the frame exposed wholly after an instant: the rule, without a device.

A buffer carries one time stamp and, in its flags, whose clock it is and which end of the exposure
it marks (userspace-api/media/v4l/buffer, "Buffer Flags"). From these follows a bound: no light
before ``earliest_light_s`` is in the picture.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from ..kernel.abi import (
    TIMESTAMP_MASK,
    TIMESTAMP_MONOTONIC,
    TSTAMP_SRC_MASK,
    TSTAMP_SRC_SOE,
    Buffer,
)

_SEQUENCE_SPAN: Final = 1 << 32
_FUTURE_SLACK_S: Final = 0.1  # beyond two periods a "monotonic" stamp comes from another clock


class StampSource(StrEnum):
    """The instant that a frame's time stamp marks."""

    END_OF_FRAME = "end of frame"
    START_OF_EXPOSURE = "start of exposure"
    FIRST_PACKET = "first packet"  # flagged as start of exposure, taken on arrival (uvcvideo)
    DEQUEUED = "dequeued"  # the camera's clock is not ours: stamped when the buffer was taken


@dataclass(frozen=True, slots=True)
class Stamp:
    """The instant at which a frame was taken.

    Attributes
    ----------
    at_s : instant for the record [cell s]
    bound_s : the frame ended (or, by its source, began) no earlier than this [cell s]
    source : instant that the stamp marks
    """

    at_s: float
    bound_s: float
    source: StampSource


def stamp_of(
    buffer: Buffer,
    *,
    stamp_s: float,
    dequeued_s: float,
    last_empty_s: float,
    period_s: float,
    is_start_trusted: bool,
) -> Stamp:
    """Return the instant and the source of a buffer's time stamp.

    Parameters
    ----------
    buffer : as DQBUF gave it
    stamp_s : its time stamp on the cell's scale [s]
    dequeued_s : time at which DQBUF returned it [s]
    last_empty_s : when the queue was last seen empty [s]; a frame without a usable stamp
        ended after that, and that is all that is known about it
    period_s : frame period [s]
    is_start_trusted : whether a stamp flagged "start of exposure" is one
    """
    is_monotonic = buffer.flags & TIMESTAMP_MASK == TIMESTAMP_MONOTONIC
    # a stamp may lie a frame period ahead of now (vivid computes them), but no more
    is_plausible = (
        buffer.timestamp_us > 0 and stamp_s <= dequeued_s + 2 * period_s + _FUTURE_SLACK_S
    )
    if not (is_monotonic and is_plausible):
        return Stamp(dequeued_s, last_empty_s, StampSource.DEQUEUED)
    source = StampSource.END_OF_FRAME
    if buffer.flags & TSTAMP_SRC_MASK == TSTAMP_SRC_SOE:
        source = StampSource.START_OF_EXPOSURE if is_start_trusted else StampSource.FIRST_PACKET
    return Stamp(stamp_s, stamp_s, source)


def earliest_light_s(stamp: Stamp, exposure_s: float, margin_s: float) -> float:
    """Return the instant before which no light reached the frame [cell s].

    Parameters
    ----------
    stamp : stamp of the frame
    exposure_s : its exposure [s]
    margin_s : time between the stamp and the exposure's marked end [s]: readout for an end stamp,
        the camera's and encoder's buffering for a first-packet stamp
    """
    if stamp.source is StampSource.START_OF_EXPOSURE:
        return stamp.bound_s - margin_s
    return stamp.bound_s - exposure_s - margin_s


def default_margin_s(source: StampSource, period_s: float) -> float:
    """Return the margin assumed until it is measured for a camera model [s]."""
    return 2 * period_s if source is StampSource.FIRST_PACKET else period_s


def sequence_gap(previous: int, current: int) -> int:
    """Return the number of frames missing between two sequence numbers (32 bit, they wrap).

    A number that did not advance, or went back, is a restarted count: nothing is missing.
    """
    advance = (current - previous) % _SEQUENCE_SPAN
    return advance - 1 if 0 < advance < _SEQUENCE_SPAN // 2 else 0


@dataclass(slots=True)
class ExposureChange:
    """Frames to let pass after a change of exposure: no buffer names its setting.

    Attributes
    ----------
    changed_s : instant of the change [cell s]
    remaining_count : frames that may still be of the old setting
    """

    changed_s: float = float("-inf")
    remaining_count: int = 0

    def begin(self, at_s: float, frame_count: int) -> None:
        """Note a change: the next ``frame_count`` frames stamped after it are not to be used."""
        self.changed_s, self.remaining_count = at_s, frame_count

    def is_adapting(self, stamp: Stamp) -> bool:
        """Return whether this frame may have the old setting, and count it."""
        if stamp.bound_s < self.changed_s:
            return True
        if self.remaining_count:
            self.remaining_count -= 1
            return True
        return False
