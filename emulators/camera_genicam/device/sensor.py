"""The camera's sensor: triggers in, pictures out, each with its exposure's settings.

World time is handed in. A picture is ordered when its exposure begins and shows the world at its
middle; it is given out once the exposure is over, and the picture is there.
"""

import logging
from collections import deque
from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from typing import Any, Final, Protocol

import numpy as np
import numpy.typing as npt

from ..features import PixelFormat, Sensor
from ..features.table import (
    MAX_EXPOSURE_US,
    MAX_GAIN_DB,
    MIN_EXPOSURE_US,
    PEDESTAL_GREY,
)
from ..protocol.gvsp import LAST_BLOCK, Image
from .faults import Faults
from .registers import Registers

log = logging.getLogger(__name__)

Picture = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

TICKS_PER_S: Final = 1_000_000_000
_US_PER_S: Final = 1e6
_FLIGHTS_MAX: Final = 4  # pictures that the camera has memory for
_AUTO_TARGET: Final = 118.0 / 255.0  # mean brightness that the automatic functions steer to
_AUTO_FACTOR_MAX: Final = 2.0  # largest change a frame
_AUTO_DONE: Final = 0.05  # relative error at which Once ends
_OFF, _ONCE = 0, 1
_ON = 1
_CONTINUOUS_MODE, _SINGLE_MODE, _MULTI_MODE = 0, 1, 2
_SOFTWARE: Final = 1


class Clock(Protocol):
    """The world's time, as `emulators.clock.WorldClock` keeps it."""

    def now_s(self) -> float:
        """Return the world's instant [world s]."""
        ...

    def to_monotonic_s(self, world_s: float) -> float:
        """Return the CLOCK_MONOTONIC reading [wall s] of a world instant [world s]."""
        ...


class PictureSource(Protocol):
    """A source of pictures."""

    def expose(
        self, start_s: float, end_s: float, exposure_s: float, gain: float, bits: int
    ) -> Hashable | None:
        """Order the picture of an exposure that has begun; return its ticket at once.

        The picture goes to `GenicamDevice.deliver` with the ticket, later, in any order.

        Parameters
        ----------
        start_s, end_s : the exposure [world s]; `end_s` may be in the future
        exposure_s : its length [s]
        gain : linear, 1 or more
        bits : of a pixel, 8 or 16

        Returns
        -------
        None loses the frame.
        """
        ...


@dataclass(slots=True, eq=False)
class Frame:
    """A picture under way.

    Attributes
    ----------
    block : its number on the wire
    image : what the leader says of it
    pixel_format : of its bytes
    start_s, end_s : exposure [world s]
    due_s : it is not given out before [world s]
    black_shift, gamma : what the camera does to the pixels
    is_sent : its last packet has left
    """

    ticket: Hashable
    block: int
    image: Image
    pixel_format: PixelFormat
    start_s: float
    end_s: float
    due_s: float
    black_shift: float
    gamma: float
    picture: Picture | None = None
    is_given: bool = False
    is_sent: bool = False

    @property
    def pixels(self) -> bytes:
        """Its bytes as they are sent."""
        assert self.picture is not None
        return _pixels(self.picture, self)


class Acquisition:
    """Frames of one power-up of a camera.

    Parameters
    ----------
    sensor : size and rate
    source : source of pictures
    registers : the camera's settings
    faults : returns the faults in force; `spend` changes them
    spend : sets the faults that are left
    """

    def __init__(
        self,
        sensor: Sensor,
        source: PictureSource,
        registers: Registers,
        faults: Callable[[], Faults],
        spend: Callable[[Faults], None],
    ) -> None:
        self._sensor, self._source, self._registers = sensor, source, registers
        self._faults, self._spend = faults, spend
        self._frames: deque[Frame] = deque()
        self._next_block = 1
        self._next_start_s: float | None = None
        self._left = 0  # frames of this acquisition, 0 for any number
        self._last_picture: Picture | None = None
        self.is_running = False
        self.lost_count = 0
        self.powered_s = 0.0

    # --- commands ---------------------------------------------------------------------------------

    def open_stream(self) -> None:
        """Count blocks from 1 again."""
        self._next_block = 1

    def start(self, now_s: float) -> None:
        """Take pictures from now on [world s]."""
        mode = self._registers.number("AcquisitionMode")
        counts = {
            _CONTINUOUS_MODE: 0,
            _SINGLE_MODE: 1,
            _MULTI_MODE: self._registers.number("AcquisitionFrameCount"),
        }
        self._left, self.is_running, self.lost_count = counts[mode], True, 0
        self._next_start_s = None

    def stop(self) -> None:
        """Begin no more pictures; those that are exposed already still come."""
        self.is_running = False

    def abort(self) -> None:
        """Begin no more pictures, and forget those under way."""
        self.is_running = False
        self._frames.clear()

    def trigger(self, now_s: float) -> None:
        """Take a software trigger: expose from now on, if the camera waits for one."""
        faults, registers = self._faults(), self._registers
        if (
            not self.is_running
            or registers.number("TriggerMode") != _ON
            or registers.number("TriggerSource") != _SOFTWARE
        ):
            return
        if faults.missed_trigger_count > 0:
            self._spend(replace(faults, missed_trigger_count=faults.missed_trigger_count - 1))
            return
        if any(now_s < frame.end_s for frame in self._frames):
            self.lost_count += 1  # a trigger during an exposure has no effect
            return
        self._expose(now_s)

    # --- time -------------------------------------------------------------------------------------

    def advance(self, now_s: float) -> float | None:
        """Begin the exposure that is due; return when to call again [world s], None for never."""
        due = [frame.due_s for frame in self._frames if frame.picture is not None]
        due = [due_s for due_s in due if due_s > now_s]
        if not self.is_running or self._registers.number("TriggerMode") == _ON:
            self._next_start_s = None
        else:
            start_s = self._next_start_s if self._next_start_s is not None else now_s
            if now_s >= start_s:
                period_s = self._period_s()
                behind = int((now_s - start_s) / period_s)
                self.lost_count += behind
                start_s += behind * period_s
                if self._unsent():
                    self.lost_count += 1
                else:
                    self._expose(start_s)
                start_s += period_s
            self._next_start_s = start_s
            if self.is_running:
                due.append(start_s)
        return min(due, default=None)

    def take(self, now_s: float) -> Frame | None:
        """Return the oldest frame, if it can be sent now."""
        waiting = [frame for frame in self._frames if not frame.is_given]
        if not waiting or waiting[0].picture is None or now_s < waiting[0].due_s:
            return None
        frame = waiting[0]
        frame.is_given = True
        return frame

    def sent(self, frame: Frame) -> None:
        """Note that a frame's last packet has left."""
        frame.is_sent = True
        while self._frames and self._frames[0].is_sent:
            self._frames.popleft()

    @property
    def oldest_due_s(self) -> float | None:
        """The end of the oldest exposure whose frame is not sent; late ones hold nothing up."""
        unsent = self._unsent()
        return unsent[0].end_s if unsent and unsent[0].due_s == unsent[0].end_s else None

    def deliver(self, ticket: Hashable, picture: Picture) -> None:
        """Take the picture of a ticket; one whose frame is forgotten is let go."""
        frame = next((one for one in self._frames if one.ticket == ticket), None)
        if frame is None or frame.picture is not None:
            log.debug("picture of %r: its acquisition has ended", ticket)
            return
        faults = self._faults()
        old = self._last_picture if faults.is_frozen else None
        frame.picture = picture if old is None else old
        if faults.is_dark:
            frame.picture = np.zeros_like(frame.picture)
        self._last_picture = frame.picture
        self._steer(frame.picture)

    # --- an exposure ------------------------------------------------------------------------------

    def _unsent(self) -> list[Frame]:
        return [frame for frame in self._frames if not frame.is_sent]

    def _period_s(self) -> float:
        period_s = self._registers.value("ExposureTime") / _US_PER_S
        if self._registers.number("AcquisitionFrameRateEnable"):
            period_s = max(period_s, 1.0 / self._registers.value("AcquisitionFrameRate"))
        return period_s

    def _expose(self, start_s: float) -> None:
        faults, registers = self._faults(), self._registers
        if faults.is_stalled:
            self.lost_count += 1
            return
        block = self._next_block
        self._next_block = 1 if block == LAST_BLOCK else block + 1
        if self._left:
            self._left -= 1
            self.is_running = self._left > 0
        if faults.lost_count > 0 or len(self._frames) >= _FLIGHTS_MAX:
            self._spend(replace(faults, lost_count=max(0, faults.lost_count - 1)))
            self.lost_count += 1
            return
        exposure_s = registers.value("ExposureTime") / _US_PER_S
        end_s = start_s + exposure_s
        pixel_format = PixelFormat(registers.number("PixelFormat"))
        bits = 8 if pixel_format is PixelFormat.Mono8 else 16
        gain = 10.0 ** (registers.value("Gain") / 20.0)
        ticket = self._source.expose(start_s, end_s, exposure_s, gain, bits)
        if ticket is None:
            self.lost_count += 1
            return
        late_s = 0.0
        if faults.late_count > 0:
            late_s = faults.late_s
            self._spend(replace(faults, late_count=faults.late_count - 1))
        image = Image(
            timestamp=round((start_s - self.powered_s) * TICKS_PER_S),
            pixel_format=int(pixel_format),
            width_px=registers.number("Width"),
            height_px=registers.number("Height"),
            x_px=registers.number("OffsetX"),
            y_px=registers.number("OffsetY"),
        )
        self._frames.append(
            Frame(
                ticket,
                block,
                image,
                pixel_format,
                start_s,
                end_s,
                end_s + late_s,
                registers.value("BlackLevel") - PEDESTAL_GREY,
                registers.value("Gamma"),
            )
        )

    def _steer(self, picture: Picture) -> None:
        """Let the automatic functions choose exposure and gain of frames to come."""
        registers = self._registers
        autos = {name: registers.number(name) for name in ("ExposureAuto", "GainAuto")}
        if not any(autos.values()):
            return
        full = float(np.iinfo(picture.dtype).max)
        factor = _AUTO_TARGET / max(float(picture.mean()) / full, 1.0 / 255.0)
        factor = min(_AUTO_FACTOR_MAX, max(1.0 / _AUTO_FACTOR_MAX, factor))
        left = factor
        if autos["ExposureAuto"]:
            before = registers.value("ExposureTime")
            longest_us = min(MAX_EXPOSURE_US, _US_PER_S / registers.value("AcquisitionFrameRate"))
            after = min(longest_us, max(MIN_EXPOSURE_US, before * factor))
            registers.put("ExposureTime", after)
            left = factor * before / after
        if autos["GainAuto"]:
            db = registers.value("Gain") + 20.0 * float(np.log10(left))
            registers.put("Gain", min(MAX_GAIN_DB, max(0.0, db)))
        if abs(factor - 1.0) < _AUTO_DONE:
            for name, auto in autos.items():
                if auto == _ONCE:
                    registers.put(name, _OFF)


def _pixels(picture: Picture, frame: Frame) -> bytes:
    """Return a frame's bytes: its region, black level, gamma and depth."""
    image = frame.image
    rows = slice(image.y_px, image.y_px + image.height_px)
    region: npt.NDArray[Any] = picture[rows, image.x_px : image.x_px + image.width_px]
    full = int(np.iinfo(region.dtype).max)
    if frame.black_shift or frame.gamma != 1.0:
        levels = np.arange(full + 1) / full + frame.black_shift / 255.0
        levels = np.clip(levels, 0.0, 1.0) ** frame.gamma
        region = np.rint(levels * full).astype(region.dtype)[region]
    if frame.pixel_format is PixelFormat.Mono8:
        return region.astype(np.uint8).tobytes()
    shift = 16 - frame.pixel_format.depth_bits
    return (region.astype("<u2") >> shift).astype("<u2").tobytes()
