"""The camera's sensor: the frames exposed, and the way of their pictures to the buffers.

World time comes in by `advance`, pictures come in by `deliver`: the world never waits for a
picture. A frame without a buffer is lost, and its number with it.
"""

import logging
import threading
from collections import deque
from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np

from ..kernel import (
    SLOT_BYTES,
    Buffer,
    BufferQueue,
    CameraConfig,
    CaptureSettings,
    ControlBank,
    Picture,
    PixelFormat,
)
from ..kernel import control_specs as ctl
from ..kernel.abi import BufferFlag
from ..kernel.formats import bin_to, brighten, encode, mean_level
from ._faults import Faults
from .shutter import FrameGrid

log = logging.getLogger(__name__)

GAIN_PER_DECADE: Final = 100  # steps of the gain control: 0 is ×1, 100 is ×10, 0.2 dB a step
_AUTO_EXPOSURE_TARGET: Final = 118.0  # mean brightness that aperture priority mode steers to
_AUTO_EXPOSURE_FACTOR_MAX: Final = 2.0  # largest change per frame


class Clock(Protocol):
    """The world's time, as `emulators.clock.WorldClock` keeps it."""

    def now_s(self) -> float:
        """Return the world's instant [world s]."""

    def to_monotonic_s(self, world_s: float) -> float:
        """Return the CLOCK_MONOTONIC reading [wall s] of a world instant [world s]."""


class PictureSource(Protocol):
    """A source of pictures."""

    def expose(
        self, start_s: float, end_s: float, exposure_s: float, gain: float
    ) -> Hashable | None:
        """Order the picture of an exposure that has just ended; return its ticket at once.

        The picture goes to `V4l2Device.deliver` with the ticket, later, in any order; one that
        will never come goes to `V4l2Device.abandon`. It may be of the sensor's size or of
        `V4l2Device.size_px`. Called with the device locked: quick, and nothing delivered within.

        Parameters
        ----------
        start_s, end_s : the exposure [world s]; `end_s` is never in the future
        exposure_s : its length [world s]
        gain : linear, 1 or more

        Returns
        -------
        None loses the frame.
        """


@dataclass(slots=True, eq=False)
class _Flight:
    """A frame whose picture is being made."""

    ticket: Hashable
    buffer: Buffer
    owner: int
    frame: int
    start_s: float
    end_s: float
    pixel_format: PixelFormat
    size_px: tuple[int, int]
    brightness: int
    picture: Picture | None = None


class Sensor:
    """Frames of one power-up of a camera; shares the camera's lock.

    Parameters
    ----------
    source : source of pictures
    clock : the world's time
    config : the camera
    settings : format, size and rate at present
    controls : exposure, gain and whatever else a frame is taken with
    buffers : buffers for finished frames
    lock : the camera's
    store : called with the place in the buffers' memory [bytes] and the bytes of a picture
    wake : called with the number of the handle that has a frame to fetch, None for all
    able : called when frames have somewhere to go again

    Attributes
    ----------
    faults : in force; counts run down here
    lost_count : frames since the stream began for which there was no buffer or no picture
    """

    def __init__(
        self,
        source: PictureSource,
        clock: Clock,
        config: CameraConfig,
        settings: CaptureSettings,
        controls: ControlBank,
        buffers: BufferQueue,
        lock: threading.RLock,
        *,
        store: Callable[[int, bytes], None],
        wake: Callable[[int | None], None],
        able: Callable[[], None],
    ) -> None:
        self._source, self._clock, self._config = source, clock, config
        self._settings, self._controls, self._buffers = settings, controls, buffers
        self._lock = lock
        self._store, self._wake, self._able = store, wake, able
        self._finishing = threading.Lock()  # frames are encoded and stored one at a time
        self._grid = FrameGrid(0.0, 1.0, self._exposure_s)
        self._flights: deque[_Flight] = deque()
        self._last_frame = -1  # the last one that was taken or lost
        self._able_since_s: float | None = None  # a frame that ends later has a place to go
        self._last_picture: Picture | None = None
        self.faults = Faults()
        self.lost_count = 0

    @property
    def oldest_due_s(self) -> float | None:
        """The oldest due time; see `V4l2Device.oldest_due_s`."""
        with self._lock:
            making = (flight.end_s for flight in self._flights if flight.picture is None)
            return next(making, None)

    def start(self) -> None:
        """Begin with frame 0 now."""
        period_s = 1.0 / self._settings.rate_hz
        self._grid = FrameGrid(self._clock.now_s(), period_s, self._exposure_s)
        self._controls.settle()
        self._last_frame, self.lost_count = -1, 0
        self._last_picture = None

    def stop(self) -> None:
        """Take no more frames, forget the pictures being made."""
        self._flights.clear()
        self.review()

    def next_frame(self) -> int:
        """Return the first frame that a control set now can still influence."""
        if not self._buffers.is_streaming:
            return 0
        return self._grid.first_from(self._clock.now_s()) + self.faults.control_delay_frames

    def review(self) -> None:
        """Note whether the next frame has a buffer, after anything that may change that."""
        is_able = (
            self._buffers.is_streaming
            and self._buffers.has_queued
            and len(self._flights) < self._config.in_flight_max
            and not self.faults.is_stalled
        )
        if not is_able:
            self._able_since_s = None
        elif self._able_since_s is None:
            self._able_since_s = self._clock.now_s()
            self._able()

    def advance(self, now_s: float) -> float | None:
        """Return the result of `V4l2Device.advance`; see there."""
        self._finish_flights()
        with self._lock:
            if self._able_since_s is None:
                return self._late_until_s()
            frame = self._grid.latest_ended(now_s)
            if frame > self._last_frame:
                self.lost_count += frame - self._last_frame - 1
                self._last_frame = frame
                if self._grid.end_s(frame) <= self._able_since_s or not self._expose(frame):
                    self.lost_count += 1
                self.review()
            able = self._able_since_s is not None
            again_s = self._grid.end_s(self._last_frame + 1) if able else None
            late_s = self._late_until_s()
        self._finish_flights()
        return again_s if late_s is None else min(late_s, again_s or late_s)

    def _late_until_s(self) -> float | None:
        """Return when the oldest late picture reaches its buffer [world s]; None without one."""
        if not self._flights or self._flights[0].picture is None or self.faults.late_count <= 0:
            return None
        return self._flights[0].end_s + self.faults.late_s

    def deliver(self, ticket: Hashable, picture: Picture) -> None:
        """Deliver; see `V4l2Device.deliver`.

        Raises
        ------
        ValueError : the picture is not (height, width) uint8 or uint16
        """
        if picture.ndim != 2 or picture.dtype.name not in ("uint8", "uint16"):
            raise ValueError(f"a picture is (h, w) uint8 or uint16, not {picture.dtype}")
        with self._lock:
            flight = self._flight_of(ticket)
            if flight is None:
                return
            flight.picture = bin_to(picture, flight.size_px)
        self._finish_flights()
        with self._lock:
            if self._late_until_s() is not None:
                self._able()  # whoever sleeps has an instant to wait for

    def abandon(self, ticket: Hashable) -> None:
        """Abandon a picture; see `V4l2Device.abandon`."""
        with self._lock:
            flight = self._flight_of(ticket)
            if flight is None:
                return
            self._flights.remove(flight)
            self._buffers.give_back(flight.buffer)
            self.lost_count += 1
            self.review()
        self._finish_flights()

    def _expose(self, frame: int) -> bool:
        """Order the picture of a frame; False if the frame is lost."""
        if self.faults.lost_count > 0:
            self.faults = replace(self.faults, lost_count=self.faults.lost_count - 1)
            return False
        start_s, end_s = self._grid.start_s(frame), self._grid.end_s(frame)
        gain = 10.0 ** (self._controls.value_at(ctl.GAIN, frame) / GAIN_PER_DECADE)
        old_picture = self._last_picture if self.faults.is_frozen else None
        ticket: Hashable | None = object()
        if old_picture is None:
            ticket = self._source.expose(start_s, end_s, end_s - start_s, gain)
        if ticket is None or self._buffers.owner is None:
            return False
        self._flights.append(
            _Flight(
                ticket,
                self._buffers.take(),
                self._buffers.owner.number,
                frame,
                start_s,
                end_s,
                self._settings.pixel_format,
                self._settings.size_px,
                self._controls.value_at(ctl.BRIGHTNESS, frame),
                old_picture,
            )
        )
        return True

    def _exposure_s(self, frame: int) -> float:
        units = self._controls.value_at(ctl.EXPOSURE_TIME_ABSOLUTE, frame, default=100)
        return units * ctl.EXPOSURE_UNIT_S

    def _flight_of(self, ticket: Hashable) -> _Flight | None:
        flight = next((flight for flight in self._flights if flight.ticket == ticket), None)
        if flight is None:
            log.debug("picture of %r: its stream has ended", ticket)
        return flight

    def _finish_flights(self) -> None:
        """Finish the frames whose pictures are there, in the order they were exposed."""
        with self._finishing:
            while True:
                with self._lock:
                    if not self._flights or self._flights[0].picture is None:
                        return
                    late_until_s = self._late_until_s()
                    if late_until_s is not None and self._clock.now_s() < late_until_s:
                        return
                    flight, faults = self._flights[0], self.faults
                    picture = self._flights[0].picture
                    if faults.is_dark:
                        picture = np.zeros_like(picture)
                # outside the lock, so that no ioctl waits for a JPEG or for the kernel's copy
                frame = bytes(encode(brighten(picture, flight.brightness), flight.pixel_format))
                frame, flags, faults = _damaged(frame, flight.pixel_format, faults)
                self._store(flight.buffer.index * SLOT_BYTES, frame)
                with self._lock:
                    if not self._flights or self._flights[0] is not flight:
                        continue  # the stream was stopped meanwhile
                    self._flights.popleft()
                    self.faults = faults
                    self._last_picture = picture
                    stamp_us, stamp_flags = self._stamp(flight)
                    self._buffers.finish(
                        flight.buffer, len(frame), flags | stamp_flags, stamp_us, flight.frame
                    )
                    self._steer_exposure(picture, flight)
                    self.review()
                self._wake(flight.owner)

    def _stamp(self, flight: _Flight) -> tuple[int, int]:
        """Return a frame's timestamp [us] and the flags on its kind."""
        is_soe = self._config.stamps_exposure_start
        instant_s = flight.start_s if is_soe else flight.end_s
        if self.faults.timestamp_unknown:
            return int((instant_s - self._grid.started_s) * 1e6), 0
        flags = BufferFlag.TIMESTAMP_MONOTONIC | (BufferFlag.TSTAMP_SRC_SOE if is_soe else 0)
        return int(self._clock.to_monotonic_s(instant_s) * 1e6), flags

    def _steer_exposure(self, picture: Picture, flight: _Flight) -> None:
        """Let aperture priority mode choose the exposure of frames to come."""
        automatic = self._controls.value_set(ctl.EXPOSURE_AUTO, ctl.EXPOSURE_MANUAL)
        if automatic == ctl.EXPOSURE_MANUAL or ctl.EXPOSURE_TIME_ABSOLUTE not in self._controls:
            return
        factor = _AUTO_EXPOSURE_TARGET / max(mean_level(picture), 1.0)
        factor = min(_AUTO_EXPOSURE_FACTOR_MAX, max(1.0 / _AUTO_EXPOSURE_FACTOR_MAX, factor))
        exposure_s = min(self._grid.period_s, (flight.end_s - flight.start_s) * factor)
        self._controls.steer(
            ctl.EXPOSURE_TIME_ABSOLUTE, round(exposure_s / ctl.EXPOSURE_UNIT_S), self.next_frame()
        )


def _damaged(frame: bytes, pixel_format: PixelFormat, faults: Faults) -> tuple[bytes, int, Faults]:
    """Return the frame as the faults leave it, its flags, and the faults that remain."""
    flags = 0
    if faults.late_count > 0:
        faults = replace(faults, late_count=faults.late_count - 1)
    if faults.error_count > 0:
        flags = int(BufferFlag.ERROR)
        faults = replace(faults, error_count=faults.error_count - 1)
    if faults.short_count > 0:
        frame = frame[: len(frame) // 2]
        faults = replace(faults, short_count=faults.short_count - 1)
    if faults.broken_jpeg_count > 0 and pixel_format.is_compressed:
        intact = 2 * len(frame) // 3
        frame = frame[:intact] + bytes(len(frame) - intact)
        faults = replace(faults, broken_jpeg_count=faults.broken_jpeg_count - 1)
    return frame, flags, faults
