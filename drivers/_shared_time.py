"""An emulated cell's clock, read and held from the drivers' side.

The emulator alone moves the clock; this side reads it and reports its own progress, so that cell
time never runs away from a process that gets no turn. Sections (§) are those of shared-clock.md.
"""

import asyncio
import fcntl
import mmap
import os
import struct
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Final

from messages import say

from .errors import LinkError

# places of the file in words of 8 bytes, §1
_MAGIC, _SPEED, _START, _LIMIT, _LAG, _WINDOW, _STALL_COUNT, _WAITS_FOR_NOBODY = range(8)
_SLOTS: Final = 8
_SLOT_COUNT: Final = 16
_STALLS: Final = 64
_STALL_ROOM: Final = 4096
_WORD_COUNT: Final = _STALLS + 2 * _STALL_ROOM
_WORD_BYTES: Final = 8
_MAGIC_VALUE: Final = int.from_bytes(b"cellclk1", "little")
_SPEED_UNIT: Final = 1_000_000
_NS: Final = 1e-9

_BEATS_PER_WINDOW: Final = 4
_MIN_BEAT_WALL_S: Final = 0.001
_OWNER_LOOK_WALL_S: Final = 0.25
_CREEP: Final = 0.2  # cell seconds per second while time is held
_FLOCK: Final = "hhqqi"  # struct flock of Linux, 64 bit


class SharedTime:
    """The clock at ``path``; `close` unmaps it.

    Raises
    ------
    LinkError : no emulator keeps a clock there
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._fd = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        except OSError as error:
            raise LinkError(
                say(
                    "clock {path}: {strerror}; is the emulator running?",
                    path=path,
                    strerror=error.strerror,
                )
            ) from error
        try:
            if os.fstat(self._fd).st_size != _WORD_COUNT * _WORD_BYTES:
                raise LinkError(
                    say("clock {path}: this is no clock of an emulated cell", path=path)
                )
            self._map = mmap.mmap(self._fd, _WORD_COUNT * _WORD_BYTES)
            self._words = memoryview(self._map).cast("q")
            if self._words[_MAGIC] != _MAGIC_VALUE or self._words[_SPEED] <= 0:
                raise LinkError(
                    say("clock {path}: this is no clock of an emulated cell", path=path)
                )
            self._hold_count = 0
            self._held = (0, 0)  # wall instant at which time began to creep, and its limit then
            self._held_from_ns = self._held_ns = 0
            self._orphaned: tuple[int, int] | None = None
            self._begun: tuple[int, int] | None = None
            self._look_for_owner()
            if self._orphaned is not None:
                raise LinkError(say("clock {path}: the emulator that kept it has ended", path=path))
        except LinkError:
            self.close()
            raise

    def close(self) -> None:
        """Unmap it; a second call does nothing. Later calls get the last values."""
        if self._fd < 0:
            return
        if hasattr(self, "_words"):
            last = bytearray(self._words)
            self._words.release()
            self._map.close()
            self._words = memoryview(last).cast("q")
        os.close(self._fd)
        self._fd = -1

    @property
    def speed(self) -> float:
        """Cell seconds wanted per second of the wall clock."""
        return self._words[_SPEED] / _SPEED_UNIT

    @property
    def waits(self) -> bool:
        """Whether the clock waits for processes that take part."""
        return not self._words[_WAITS_FOR_NOBODY]

    @property
    def window_s(self) -> float:
        """The furthest that the clock may run ahead of the slowest participant [cell s]."""
        return self._words[_WINDOW] * _NS

    def now_s(self) -> float:
        """Return the cell's instant [cell s]."""
        return self._now_ns() * _NS

    def _now_ns(self) -> int:
        if self._orphaned is not None:
            # nobody holds or moves it any more: it goes on, so that time-outs end what waits
            wall_ns, cell_ns = self._orphaned
            return cell_ns + self._linear(time.monotonic_ns() - wall_ns)
        words = self._words
        limit_ns, lag_ns = words[_LIMIT], words[_LAG]  # in this order, §2
        return min(self._linear(time.monotonic_ns() - words[_START]) - lag_ns, limit_ns)

    def _linear(self, wall_ns: int) -> int:
        return wall_ns * self._words[_SPEED] // _SPEED_UNIT

    def from_monotonic_s(self, wall_s: float) -> float:
        """Return the cell instant [cell s] of a past CLOCK_MONOTONIC reading [wall s].

        Stalls are walked back from the latest one, §3.
        """
        words = self._words
        since_start_ns = round(wall_s / _NS) - words[_START]
        linear_ns, limit_ns = self._linear(since_start_ns), words[_LIMIT]
        count = words[_STALL_COUNT]
        for number in range(count - 1, max(-1, count - _STALL_ROOM), -1):
            place = _STALLS + 2 * (number % _STALL_ROOM)
            at_ns, lag_ns = words[place], words[place + 1]
            if linear_ns - lag_ns >= at_ns:
                return min(linear_ns - lag_ns, limit_ns) * _NS
            limit_ns = at_ns
        return min(linear_ns, limit_ns) * _NS

    def hold(self) -> None:
        """Slow time to a creep until `release`, if this process takes part.

        It goes on at a fifth of real time: a request that was long on its way through the kernel is
        still answered, which takes milliseconds of cell time.
        """
        if not self._hold_count:
            self._held = (time.monotonic_ns(), self._words[_LIMIT])
            self._held_from_ns = self._now_ns()
        self._hold_count += 1

    def release(self) -> None:
        """Resume time, once per `hold`."""
        self._hold_count -= 1
        if not self._hold_count:
            self._held_ns += self._now_ns() - self._held_from_ns

    def held_s(self) -> float:
        """Return the total time that passed while time was held [cell s]."""
        since_ns = self._now_ns() - self._held_from_ns if self._hold_count else 0
        return (self._held_ns + since_ns) * _NS

    # --- taking part ----------------------------------------------------------------------------

    def speed_reached(self) -> float | None:
        """Return cell seconds per second since `measure_speed`; None before."""
        if self._begun is None:
            return None
        wall_ns, cell_ns = self._begun
        passed_ns = time.monotonic_ns() - wall_ns
        return (self._now_ns() - cell_ns) / passed_ns if passed_ns > 0 else None

    def measure_speed(self) -> None:
        """Begin to measure the clock's speed."""
        self._begun = (time.monotonic_ns(), self._now_ns())

    @asynccontextmanager
    async def taking_part(self) -> AsyncIterator[None]:
        """Let the clock wait for this process's event loop while the block runs.

        Raises
        ------
        LinkError : too many processes take part already
        """
        slot = self._take_slot()
        self.measure_speed()
        task = asyncio.create_task(self._beat(slot), name="cell clock")
        try:
            yield
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
            self._words[slot] = 0
            self._lock(slot, fcntl.F_UNLCK)

    def _take_slot(self) -> int:
        for number in range(_SLOT_COUNT):
            slot = _SLOTS + 2 * number
            with suppress(BlockingIOError, PermissionError):
                self._lock(slot, fcntl.F_WRLCK)
                self._words[slot + 1] = self._now_ns()  # before the process shows itself
                self._words[slot] = os.getpid()
                return slot
        raise LinkError(
            say(
                "clock {path}: {slot_count} processes take part already",
                path=self.path,
                slot_count=_SLOT_COUNT,
            )
        )

    async def _beat(self, slot: int) -> None:
        speed = self.speed
        pause_wall_s = max(self.window_s / speed / _BEATS_PER_WINDOW, _MIN_BEAT_WALL_S)
        look_wall_s = time.monotonic()
        while True:
            await asyncio.sleep(pause_wall_s)
            self._words[slot + 1] = self._reached_ns(self._words[slot + 1])
            if time.monotonic() - look_wall_s > _OWNER_LOOK_WALL_S:
                look_wall_s = time.monotonic()
                self._look_for_owner()

    def _reached_ns(self, before_ns: int) -> int:
        if not self._hold_count:
            return self._now_ns()
        wall_ns, limit_ns = self._held
        creep_ns = int((time.monotonic_ns() - wall_ns) * _CREEP)
        return max(before_ns, limit_ns + creep_ns - self._words[_WINDOW])

    # --- locks, §4 ------------------------------------------------------------------------------

    def _lock(self, word: int, kind: int) -> None:
        lock = struct.pack(_FLOCK, kind, os.SEEK_SET, word * _WORD_BYTES, 1, 0)
        fcntl.fcntl(self._fd, fcntl.F_OFD_SETLK, lock)

    def _look_for_owner(self) -> None:
        ask = struct.pack(_FLOCK, fcntl.F_RDLCK, os.SEEK_SET, _MAGIC * _WORD_BYTES, 1, 0)
        answer = fcntl.fcntl(self._fd, fcntl.F_OFD_GETLK, ask)
        if struct.unpack(_FLOCK, answer)[0] == fcntl.F_UNLCK and self._orphaned is None:
            self._orphaned = (time.monotonic_ns(), self._now_ns())
