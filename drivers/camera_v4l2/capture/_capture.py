"""The blocking half of a camera: open, agree on a format, lock the controls, take frames.

Runs on one thread of its own (see `_camera`), since a control of a USB camera takes milliseconds
and a sick one seconds. Raises the drivers' errors, never ``OSError``.
"""

import errno
import logging
from dataclasses import dataclass
from typing import Final

from drivers.clock import CellClock
from drivers.errors import BadReplyError, FaultError, RefusedError, UnpluggedError
from drivers.pictures import BrokenPictureError
from messages import key, say

from ..kernel import (
    GONE,
    Device,
    SysCalls,
    abi,
    explain,
    explain_open,
    explained,
    find_node,
)
from ..kernel.abi import BufFlag, ControlId
from ._controls import (
    ControlInfo,
    ControlSetting,
    exposure_counts,
    list_controls,
    lock_controls,
    set_and_compare,
)
from ._decode import decode, pixel_kind
from ._negotiate import agree_on_format, agree_on_period, check_kind
from ._stream import Stream
from ._types import CameraConfig, CameraIdentity, CameraStats, Frame
from .selection import (
    ExposureChange,
    Stamp,
    StampSource,
    default_margin_s,
    earliest_light_s,
    sequence_gap,
    stamp_of,
)

log = logging.getLogger(__name__)

_STOPPED: Final = frozenset(
    {errno.EIO, errno.EINVAL, errno.EPIPE}
)  # the stream broke, not the camera
_MAX_LOOKS: Final = 64  # buffers examined in one go, so that a deadline between them is met


@dataclass(frozen=True, slots=True)
class Dequeued:
    """The result of one look into the queue.

    Attributes
    ----------
    frame : the frame that was wanted, if it was there
    dequeued_count : buffers seen
    is_empty : whether nothing is left, so that waiting makes sense
    """

    frame: Frame | None
    dequeued_count: int
    is_empty: bool


class CaptureSession:
    """One camera from open to close.

    Parameters
    ----------
    config : address and settings
    clock : the cell's clock
    calls : system calls
    stats : tallies to count in
    """

    def __init__(
        self, config: CameraConfig, clock: CellClock, calls: SysCalls, stats: CameraStats
    ) -> None:
        self._config, self._clock, self._calls, self.stats = config, clock, calls, stats
        self._device: Device | None = None
        self._stream: Stream | None = None
        self._caps = abi.Capability("", "", "", 0, 0, 0)
        self._exposure_change = ExposureChange()
        self._has_restarted = False
        self._last_empty_s = float("-inf")
        self._last_sequence: int | None = None
        self._backlog_count: int | None = None
        self.format = abi.PixFormat(config.width, config.height, 0)
        self.period_s = 1 / config.fps
        self.exposure_s: float | None = None
        self.settings: tuple[ControlSetting, ...] = ()

    # -- opening and closing -----------------------------------------------------------------

    def open(self, exposure_s: float | None) -> None:
        """Find, open, check, set and start the camera; after an error, ``close`` is due."""
        config = self._config
        node = find_node(config.device, config.dev_root, config.sysfs_root)
        try:
            self._device = Device(self._calls, node)
        except OSError as error:
            raise explain_open(error, node) from error
        self._caps = check_kind(self._device)
        self.format = agree_on_format(self._device, config)
        self.period_s = agree_on_period(self._device, 1 / config.fps)
        self._lock(exposure_s)
        self._stream = Stream(self._device, config.buffer_count)
        with explained(node, key("start of the stream")):
            self._stream.start()

    def close(self) -> None:
        """Stop, unmap, close: in this order, and each even if the one before has failed."""
        stream, self._stream = self._stream, None
        device, self._device = self._device, None
        try:
            if stream is not None:
                stream.abandon()
        finally:
            if device is not None:
                try:
                    device.close()
                except OSError as error:
                    log.debug("camera %s: close: %s", device.path, error)

    def readiness_fd(self) -> int:
        """Return the descriptor that polls readable once a frame or an event is there."""
        return self._open_device().readiness_fd()

    def identity(self) -> CameraIdentity:
        """Return the camera's own identity."""
        caps, version = self._caps, self._caps.version
        number = f"{version >> 16}.{version >> 8 & 0xFF}.{version & 0xFF}"
        node = self._open_device().path
        return CameraIdentity(node, caps.driver, caps.card, caps.bus_info, number, caps.node_caps)

    def _open_device(self) -> Device:
        if self._device is None:
            raise UnpluggedError(say("camera {device}: not connected", device=self._config.device))
        return self._device

    def _open_stream(self) -> Stream:
        if self._stream is None:
            raise UnpluggedError(say("camera {device}: not connected", device=self._config.device))
        return self._stream

    # -- controls ------------------------------------------------------------------------------

    def _lock(self, exposure_s: float | None) -> None:
        device, config = self._open_device(), self._config
        with explained(device.path, "controls"):
            self.settings = lock_controls(device, exposure_s, config.gain, config.white_balance_k)
            self.exposure_s = self._read_exposure()
        if any(setting.has_changed for setting in self.settings):
            self._exposure_change.begin(self._clock.now_s(), config.settle_frame_count)
        for setting in self.settings:
            if setting.problem:
                log.warning("camera %s: %s", device.path, setting.problem)

    def _read_exposure(self) -> float | None:
        """Return the exposure [s] if it can be read and no automatic changes it."""
        device = self._open_device()
        for setting in self.settings:
            if setting.control == ControlId.AUTO_EXPOSURE and setting.problem:
                return None
        try:
            if device.query_control(ControlId.EXPOSURE_TIME_ABSOLUTE) is None:
                return None
            counts = device.get_control(ControlId.EXPOSURE_TIME_ABSOLUTE)
        except OSError as error:
            if error.errno in GONE:
                raise
            return None
        return counts * abi.EXPOSURE_UNIT_S

    def set_exposure(self, exposure_s: float) -> float:
        """Set the exposure and return the one the camera took [s].

        Raises
        ------
        RefusedError : the camera refused the value, has no such control, or keeps another one;
            holds the errno, ERANGE where there is none
        """
        device = self._open_device()
        with explained(device.path, "exposure"):
            setting = set_and_compare(
                device, ControlId.EXPOSURE_TIME_ABSOLUTE, exposure_counts(exposure_s)
            )
            if setting.has_changed:
                self._exposure_change.begin(self._clock.now_s(), self._config.settle_frame_count)
                self.exposure_s = self._read_exposure()
        self.settings = (
            *(s for s in self.settings if s.control != ControlId.EXPOSURE_TIME_ABSOLUTE),
            setting,
        )
        if setting.problem or setting.got is None:
            raise RefusedError(
                say(
                    "camera {path}: {problem} (units of 100 µs)",
                    path=device.path,
                    problem=setting.problem,
                ),
                setting.code or errno.ERANGE,
            )
        return setting.got * abi.EXPOSURE_UNIT_S

    def controls(self) -> tuple[ControlInfo, ...]:
        """Return all controls with their values."""
        device = self._open_device()
        with explained(device.path, "controls"):
            return list_controls(device)

    # -- frames --------------------------------------------------------------------------------

    def pause(self) -> None:
        """Stop the frames."""
        stream = self._open_stream()
        with explained(self._open_device().path, "pause"):
            stream.pause()

    def resume(self) -> None:
        """Start the frames again; their numbers restart."""
        stream, self._last_sequence = self._open_stream(), None
        with explained(self._open_device().path, "resume"):
            stream.resume()

    def begin_wait(self) -> None:
        """Note that frames are wanted from now on: frames in the queue are a backlog."""
        self._backlog_count = 0

    def longest_wait_s(self) -> float:
        """Return the longest time until a frame that is wanted from now on [cell s]."""
        period_s = max(self.period_s, self.exposure_s or 0.0)
        margin_s = self._config.frame_margin_s
        frames_s = (self._exposure_change.remaining_count + 4) * period_s
        return frames_s + (
            self._exposure_bound_s() + (2 * period_s if margin_s is None else margin_s)
        )

    def look(self, after_s: float) -> Dequeued:
        """Empty the queue and return the first frame exposed wholly after ``after_s`` [cell s].

        Raises
        ------
        UnpluggedError : the camera is gone
        FaultError : the stream broke, and broke again after a restart
        """
        device = self._open_device()
        try:
            return self._look(device, after_s)
        except OSError as error:
            if error.errno not in _STOPPED:
                raise explain(error, device.path, "dequeue") from error
            if self._has_restarted:
                raise FaultError(
                    say(
                        "camera {path}: the stream broke again after a restart: {error}",
                        path=device.path,
                        error=error,
                    ),
                    error.errno or 0,
                ) from error
            log.warning("camera %s: the stream broke (%s): restarted", device.path, error)
        self._has_restarted, self._last_sequence, self._backlog_count = True, None, None
        with explained(device.path, key("restart of the stream")):
            self._open_stream().restart()
        self.stats.restart_count += 1  # once it is done: whoever counts may go on then
        return Dequeued(None, 0, is_empty=True)

    def _look(self, device: Device, after_s: float) -> Dequeued:
        device.acknowledge()
        for count in range(_MAX_LOOKS):
            asked_s = self._clock.now_s()
            buffer = device.dequeue()
            if buffer is None:
                self._last_empty_s = asked_s
                if self._backlog_count is not None and self._backlog_count < self._ring_count():
                    self._backlog_count = None  # never full: no frame was turned away
                return Dequeued(None, count, is_empty=True)
            frame = self._consider(device, buffer, after_s)
            if frame is not None:
                return Dequeued(frame, count + 1, is_empty=False)
        return Dequeued(None, _MAX_LOOKS, is_empty=False)

    def _ring_count(self) -> int:
        return self._open_stream().buffer_count

    def _consider(self, device: Device, buffer: abi.Buffer, after_s: float) -> Frame | None:
        stream = self._open_stream()
        if buffer.index >= stream.buffer_count:
            raise BadReplyError(
                say(
                    "camera {path}: buffer {index} of {buffer_count}",
                    path=device.path,
                    index=buffer.index,
                    buffer_count=stream.buffer_count,
                )
            )
        stamp = stamp_of(
            buffer,
            stamp_s=self._clock.from_monotonic_s(buffer.timestamp_us * 1e-6),
            dequeued_s=self._clock.now_s(),
            last_empty_s=self._last_empty_s,
            period_s=self.period_s,
            is_start_trusted=self._is_start_trusted(),
        )
        light_s = self._earliest_light_s(stamp)
        self._count(buffer)
        is_wanted = self._is_wanted(buffer, stamp, light_s, after_s)
        data = stream.read(buffer) if is_wanted else b""
        device.queue(buffer.index)  # before the decoding: the camera goes on meanwhile
        if not is_wanted:
            return None
        kind = pixel_kind(self.format)
        try:
            image = decode(data, self.format)
        except BrokenPictureError as error:
            self.stats.broken_count += 1
            log.info("camera %s: frame %d refused: %s", device.path, buffer.sequence, error)
            return None
        self._has_restarted = False
        self.stats.delivered_count += 1
        return Frame(
            image=image,
            white=(1 << kind.bits) - 1 if kind else 0,
            timestamp_s=stamp.at_s,
            earliest_light_s=light_s,
            sequence=buffer.sequence,
            exposure_s=self.exposure_s,
            pixel_format=abi.fourcc_name(self.format.pixelformat),
            flags=buffer.flags,
            stamp_source=stamp.source,
        )

    def _is_wanted(self, buffer: abi.Buffer, stamp: Stamp, light_s: float, after_s: float) -> bool:
        stats, kind = self.stats, pixel_kind(self.format)
        is_raw = kind is not None and kind.bytes_per_px > 0
        is_adapting = self._exposure_change.is_adapting(stamp)  # every frame counts, good or not
        if buffer.flags & BufFlag.ERROR:
            stats.error_count += 1
        elif buffer.bytesused == 0 or (is_raw and buffer.bytesused != self.format.sizeimage):
            stats.short_count += 1
        elif is_adapting:
            stats.adapting_count += 1
        elif light_s < max(after_s, self._exposure_change.changed_s):
            stats.stale_count += 1
        else:
            return True
        return False

    def _count(self, buffer: abi.Buffer) -> None:
        stats = self.stats
        stats.dequeued_count += 1
        if self._last_sequence is not None:
            gap = sequence_gap(self._last_sequence, buffer.sequence)
            if self._backlog_count == self._ring_count():  # the first after a full queue
                stats.idle_gap_count += gap
                self._backlog_count = None
            else:
                stats.lost_count += gap
        if self._backlog_count is not None:
            self._backlog_count += 1
        self._last_sequence = buffer.sequence

    def _is_start_trusted(self) -> bool:
        trusted = self._config.is_start_stamp_trusted
        return self._caps.driver != "uvcvideo" if trusted is None else trusted

    def _exposure_bound_s(self) -> float:
        # unknown: no frame can be exposed for longer than the time between two
        return self.period_s if self.exposure_s is None else self.exposure_s

    def _earliest_light_s(self, stamp: Stamp) -> float:
        margin_s = self._config.frame_margin_s
        if margin_s is None:
            source: StampSource = stamp.source
            margin_s = default_margin_s(source, max(self.period_s, self.exposure_s or 0.0))
        return earliest_light_s(stamp, self._exposure_bound_s(), margin_s)
