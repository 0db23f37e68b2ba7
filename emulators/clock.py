"""Time of the emulated cell: world seconds, ``speed`` of which pass in one of the wall clock.

Models never look at a clock: time is handed to them. Only the servers that own a wire, and the
loop that steps the world, ask this one. `SharedClock` is the cell's own: drivers read it too, and
it waits for whoever takes part; its file is described in docs/shared-clock.md.
"""

import asyncio
import fcntl
import mmap
import os
import struct
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

TIMER_GRAIN_WALL_S: Final = 0.0005  # a shorter wait would only spin while time stands still


class WorldClock:
    """Clock of one emulated bench; world time starts at zero when it is made.

    Attributes
    ----------
    speed : world seconds asked for in one second of the wall clock
    started_wall_s : CLOCK_MONOTONIC at world time 0 [wall s]
    monotonic : reads that clock; where the event loop has a time of its own, that one [wall s]
    """

    def __init__(
        self,
        speed: float = 1.0,
        started_wall_s: float | None = None,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        self.speed = speed
        self.monotonic = monotonic
        self.started_wall_s = monotonic() if started_wall_s is None else started_wall_s

    def now_s(self) -> float:
        """Return the world's instant [world s]."""
        return (self.monotonic() - self.started_wall_s) * self.speed

    def to_monotonic_s(self, world_s: float) -> float:
        """Return the CLOCK_MONOTONIC reading [wall s] of a world instant [world s].

        Of an instant to come it is the earliest one possible.
        """
        return self.started_wall_s + world_s / self.speed

    async def sleep(self, duration_s: float) -> None:
        """Wait for a duration [world s]."""
        until_s = self.now_s() + duration_s
        await asyncio.sleep(max(0.0, duration_s) / self.speed)
        while (left_s := until_s - self.now_s()) > TIMER_GRAIN_WALL_S * self.speed:  # noqa: ASYNC110
            await asyncio.sleep(left_s / self.speed)


CLOCK_PREFIX: Final = "cellctl-clock-"
_MAGIC: Final = b"cellclk1"
_SLOT_COUNT: Final = 16
_STALL_COUNT_MAX: Final = 4096
_FILE_BYTES: Final = 8 * (64 + 2 * _STALL_COUNT_MAX)
_LOOK_WALL_S: Final = 0.05
# The same at every speed: an interval between two requests, such as the start of the arm's two
# boards, must not grow with the requested speed of time.
WINDOW_S: Final = 0.05


def clock_folder() -> Path:
    """Return the folder for clocks: in memory, if that is possible."""
    shm = Path("/dev/shm")  # nosec B108: the name in it is made by mkstemp
    return shm if os.access(shm, os.W_OK) else Path(tempfile.gettempdir())


class SharedClock(WorldClock):
    """The clock of an emulated cell, in a file that drivers map; `tick` moves it, `close` ends it.

    It runs with the wall clock, but never further than a window beyond the time that the world and
    every participating process have handled; `tick` reports the world's progress.

    Parameters
    ----------
    speed : world seconds asked for in one second of the wall clock
    folder : folder for the file; by default one in memory
    waits : for processes that take part and for pictures; without, only for the world itself
    """

    def __init__(
        self, speed: float = 1.0, folder: Path | None = None, *, waits: bool = True
    ) -> None:
        super().__init__(speed)
        self.waits = waits
        prefix = f"{CLOCK_PREFIX}{os.getpid()}-"
        self._fd, name = tempfile.mkstemp(prefix=prefix, dir=folder or clock_folder())
        self.path = Path(name)
        os.ftruncate(self._fd, _FILE_BYTES)
        self._map = mmap.mmap(self._fd, _FILE_BYTES)
        words = self._words = memoryview(self._map).cast("q")
        self._millionths = words[1] = max(1, round(speed * 1e6))
        self._window_ns = words[5] = round(WINDOW_S * 1e9)
        self._looked_wall_s = 0.0
        self.begin()
        fcntl.fcntl(self._fd, fcntl.F_OFD_SETLK, _flock(fcntl.F_WRLCK, 0))
        self._map[:8] = _MAGIC  # written last: a reader that finds it may read the rest

    def begin(self) -> None:
        """Let world time 0 be now; to be called before anybody else knows the clock."""
        words = self._words
        self._start_ns = words[2] = time.monotonic_ns()
        self.started_wall_s = self._start_ns * 1e-9
        words[3], words[4], words[6], words[7] = self._window_ns, 0, 0, int(not self.waits)

    def close(self) -> None:
        """Take the file away; a second call does nothing."""
        if self._fd < 0:
            return
        self.path.unlink(missing_ok=True)
        self._words.release()
        self._map.close()
        os.close(self._fd)
        self._fd = -1

    def now_s(self) -> float:
        """Return the world's instant [world s]; never beyond what `tick` allowed last."""
        words = self._words
        limit_ns, lag_ns = words[3], words[4]
        return min(self._linear_ns() - lag_ns, limit_ns) * 1e-9

    def to_monotonic_s(self, world_s: float) -> float:
        """Return the CLOCK_MONOTONIC reading [wall s] at which a world instant was reached."""
        words, lag_ns, world_ns = self._words, 0, round(world_s * 1e9)
        count = words[6]
        for number in range(count - 1, max(-1, count - _STALL_COUNT_MAX), -1):
            place = 64 + 2 * (number % _STALL_COUNT_MAX)
            if words[place] < world_ns:  # time stood still there, before it went on to this one
                lag_ns = words[place + 1]
                break
        return self.started_wall_s + (world_ns + lag_ns) / self._millionths * 1e-3

    @property
    def participant_count(self) -> int:
        """The number of processes the clock waits for, besides the world's own."""
        return sum(1 for slot in self._slots() if self._words[slot])

    def tick(self, done_s: float, not_beyond_s: float | None = None) -> None:
        """Let time go on.

        Parameters
        ----------
        done_s : up to here the world has been stepped and the wires served [world s]
        not_beyond_s : time waits here for something that is due, None for nothing [world s]

        Where the clock waits for nobody, both participants and ``not_beyond_s`` count for nothing.
        """
        words = self._words
        self._look_for_the_dead()
        limit_ns = words[3]
        too_far_ns = self._linear_ns() - words[4] - limit_ns
        if too_far_ns > 0:
            self._note_stall(limit_ns, words[4] + too_far_ns)
        fresh_ns = round(done_s * 1e9) + self._window_ns
        if self.waits:
            reached = [words[slot + 1] for slot in self._slots() if words[slot]]
            fresh_ns = min([fresh_ns, *(ns + self._window_ns for ns in reached)])
        if self.waits and not_beyond_s is not None:
            fresh_ns = min(fresh_ns, round(not_beyond_s * 1e9))
        words[3] = max(limit_ns, fresh_ns)  # after the lag: readers take them the other way round

    def _linear_ns(self) -> int:
        return (time.monotonic_ns() - self._start_ns) * self._millionths // 1_000_000

    def _note_stall(self, at_ns: int, lag_ns: int) -> None:
        words, count = self._words, self._words[6]
        place = 64 + 2 * ((count - 1) % _STALL_COUNT_MAX)
        if count and words[place] == at_ns:
            words[place + 1] = lag_ns
        else:
            place = 64 + 2 * (count % _STALL_COUNT_MAX)
            words[place], words[place + 1] = at_ns, lag_ns
            words[6] = count + 1
        words[4] = lag_ns

    @staticmethod
    def _slots() -> range:
        return range(8, 8 + 2 * _SLOT_COUNT, 2)

    def _look_for_the_dead(self) -> None:
        if time.monotonic() - self._looked_wall_s < _LOOK_WALL_S:
            return
        self._looked_wall_s = time.monotonic()
        for slot in self._slots():
            if self._words[slot]:
                answer = fcntl.fcntl(self._fd, fcntl.F_OFD_GETLK, _flock(fcntl.F_WRLCK, slot))
                if struct.unpack("hhqqi", answer)[0] == fcntl.F_UNLCK:
                    self._words[slot] = 0


def is_kept(path: Path) -> bool:
    """Return whether a running emulator keeps the clock at ``path``."""
    try:
        fd = os.open(path, os.O_RDONLY)
    except FileNotFoundError:
        return False
    try:
        answer = fcntl.fcntl(fd, fcntl.F_OFD_GETLK, _flock(fcntl.F_RDLCK, 0))
    finally:
        os.close(fd)
    return bool(struct.unpack("hhqqi", answer)[0] != fcntl.F_UNLCK)


def _flock(kind: int, word: int) -> bytes:
    return struct.pack("hhqqi", kind, os.SEEK_SET, 8 * word, 1, 0)
