"""A requirement, and the possible results of a try on a device."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator, Mapping
from contextlib import AbstractAsyncContextManager, contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, Final

from drivers.attendance import BEAT_WALL_S, JITTER_WALL_S, Attendance
from drivers.clock import CellClock

from .lines import DeviceLine

ANSWER_S: Final = 3.0
"""Contract of all kinds: a silent device is reported, and one that is back answers, by then [s]."""
HANG_FACTOR: Final = 4.0  # multiple of its bound after which an operation is cut off
BEATS_PER_WINDOW: Final = 4  # checks for lateness of this process per window of a shared clock
JITTER_SHARE: Final = 0.1  # share of its window up to which a delay counts as none
# delays after which an exchange is cancelled
STEP_WAITS_S: Final = (0.0, 0.0, 0.002, 0.005, 0.01, 0.02)


# Verbs that change nothing on any device. `connect` is one by the contract of all kinds.
READS: Final = frozenset(
    (
        *("connect", "aclose", "close"),
        *("status", "hold", "wait_lost"),
        *("read_q", "read_kept_q", "read_opening_mm", "read_jaws"),
        *("signal", "watch", "wait_for"),
        *("frame_after", "pause", "resume"),
    )
)


class NotMetError(Exception):
    """A device fails a requirement; the message has its behaviour."""


class NotTriedError(Exception):
    """A requirement could not be tried; the message has the reason."""


@dataclass(frozen=True, slots=True)
class MeasuredFigure:
    """Measured value.

    Attributes
    ----------
    value : None where the outcome is yes or no
    unit : unit of the value
    limit : largest value allowed
    remark : further remark
    """

    value: float | None = None
    unit: str = ""
    limit: float | None = None
    remark: str = ""

    def __str__(self) -> str:
        words = []
        if self.value is not None:
            words.append(f"{self.value:.4g} {self.unit}".strip())
            if self.limit is not None:
                words.append(f"(at most {self.limit:.4g})")
        return " ".join([*words, self.remark]).strip()


@dataclass(frozen=True, slots=True)
class TimeLimits:
    """Time limits from the cell file [cell s].

    Attributes
    ----------
    stop_s : longest time from a stop until it is confirmed
    arm_silent_s : longest time until a silent line of the arm is noticed
    stale_s : longest time until an unread input counts as unknown
    poll_s : period of the input readings
    frame_late_s : longest delay of a frame beyond what rate and exposure explain
    answer_s : longest time until a silent device of another kind is noticed, or one that is back
        answers
    """

    stop_s: float
    arm_silent_s: float
    stale_s: float
    poll_s: float
    frame_late_s: float
    answer_s: float = ANSWER_S


class Stopwatch:
    """Measures the time of a device, by its cell's clock.

    It omits the time that this process missed, and the time for which a clock shared with an
    emulated cell went on during a last look (`CellClock.held`): neither is the device's fault. The
    device's own delays are not excused.

    Parameters
    ----------
    clock : the cell's clock
    """

    def __init__(self, clock: CellClock) -> None:
        self._clock = clock
        shared = clock.shared if clock.waits else None
        if shared is None:  # `CellClock.attending` measures it there, and finds more than this
            own = Attendance(clock.unheld_s, BEAT_WALL_S, clock.speed, JITTER_WALL_S * clock.speed)
        else:
            # it waits for this process, but is up to a window ahead of it each time
            beat_wall_s = shared.window_s / BEATS_PER_WINDOW / clock.speed
            jitter_s = shared.window_s * JITTER_SHARE
            own = Attendance(clock.unheld_s, beat_wall_s, clock.speed, jitter_s)
        self._attendance = own

    def now_s(self) -> float:
        """Return the present instant [cell s]; valid only in differences."""
        return self._clock.unheld_s() - self._attendance.lost_s()

    def attending(self) -> AbstractAsyncContextManager[None]:
        """Return a gauge of this process's lateness while its block runs."""
        return self._attendance.beating()


class _Guarded:
    """A driver whose verbs can be called only where its bench may command the device.

    A verb is whatever can be called and is not among `READS`, so that a verb which a kind gains
    later is guarded, too.
    """

    def __init__(self, driver: Any, bench: TestBench) -> None:  # noqa: ANN401  (of any kind)
        self._driver = driver
        self._bench = bench

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401
        found = getattr(self._driver, name)
        if callable(found) and name not in READS and not self._bench.may_act:
            raise NotTriedError(f"`{name}` commands the device, which nobody has agreed to")
        return found


@dataclass(slots=True)
class TestBench:
    """A device of a cell, and the means to try it.

    Attributes
    ----------
    name, kind : name and kind of the device in the cell file, and of `drivers.kinds`
    build : function that returns a new driver of it, not open
    clock : the cell's clock
    stopwatch : measures what is compared with a limit
    bounds : time limits
    line : line between driver and device, with means to disturb it
    facts : values of the cell file for it: ``lamps``, ``inputs``, ``capture``, ``arm_model``
    release : lets go of the lines that drivers were built on
    may_act : whether the device may be commanded; else its verbs raise `NotTriedError`
    device : the driver that is open now, behind that guard; None between two
    answered : last result of `connect`
    """

    name: str
    kind: str
    build: Callable[[], Any]
    clock: CellClock
    stopwatch: Stopwatch
    bounds: TimeLimits
    line: DeviceLine
    facts: Mapping[str, Any] = field(default_factory=dict)
    release: Callable[[], Awaitable[None]] | None = None
    may_act: bool = True
    device: Any = None
    answered: Any = None

    async def opened(self) -> Any:  # noqa: ANN401  (a device of any kind)
        """Return the connected driver; a new one if none is open."""
        if self.device is None:
            await self.close()
            device = self.build()
            self.answered = await device.connect()
            self.device = _Guarded(device, self)
        return self.device

    async def close(self) -> None:
        """Release the driver, whatever its state."""
        device, self.device = self.device, None
        closing = getattr(device, "aclose", None) or getattr(device, "close", None)
        if closing is not None:
            with suppress(Exception):  # it may be gone, and its driver may raise anything
                await closing()
        if self.release is not None:
            await self.release()


Trial = Callable[[TestBench], Awaitable[MeasuredFigure]]


@dataclass(frozen=True, slots=True)
class Requirement:
    """One thing that every device of a kind must do.

    Attributes
    ----------
    name : short, unique within a kind
    text : the requirement, a sentence
    trial : tries it; raises `NotMetError`, `NotTriedError` or what the driver raises
    moves : whether metal moves
    acts : whether it calls a verb that commands the device, though no metal should move; a real
        device is commanded only after a person has agreed
    cuts : whether the line has to be disturbed
    """

    name: str
    text: str
    trial: Trial
    moves: bool = False
    acts: bool = False
    cuts: bool = False


def require(holds: bool, message: str) -> None:
    """Check that something holds.

    Raises
    ------
    NotMetError : it does not; has the message
    """
    if not holds:
        raise NotMetError(message)


@contextmanager
def naming(when: str) -> Iterator[None]:
    """Record the instant at which a driver raised an error.

    Raises
    ------
    NotMetError : raised in place of any error of the driver within
    """
    try:
        yield
    except (NotMetError, NotTriedError):
        raise
    except Exception as error:
        raise NotMetError(f"{when}: {type(error).__name__}: {error}") from error


async def timed(bench: TestBench, limit_s: float, doing: Awaitable[Any], what: str) -> float:
    """Return a duration [cell s].

    Parameters
    ----------
    bench : bench with the stopwatch
    limit_s : longest duration [cell s]
    doing : activity awaited
    what : for the message

    Raises
    ------
    NotMetError : it took longer, by the patience of the clock
    """
    begun_s = bench.stopwatch.now_s()
    try:
        async with bench.clock.timeout(HANG_FACTOR * limit_s):
            await doing
    except TimeoutError:
        raise NotMetError(f"{what}: not done after {HANG_FACTOR * limit_s:.1f} s") from None
    took_s = bench.stopwatch.now_s() - begun_s
    allowed_s = bench.clock.patience_s(limit_s)
    require(took_s <= allowed_s, f"{what}: took {took_s:.3f} s, {allowed_s:.3f} s are allowed")
    return took_s


async def known_silent(
    bench: TestBench, limit_s: float, reading: Callable[[], Awaitable[Any]], error: type[Exception]
) -> float:
    """Return the time after which a reading of a silent device was given up [cell s].

    Parameters
    ----------
    bench : bench with the device, whose line is silent now
    limit_s : longest duration [cell s]
    reading : function that returns the reading's awaitable
    error : error that it must raise

    Raises
    ------
    NotMetError : it returned something, raised something else, or took too long
    """

    async def read() -> None:
        try:
            found = await reading()
        except error:
            return
        except TimeoutError:
            raise
        except Exception as other:
            raise NotMetError(
                f"raised {type(other).__name__} ({other}), expected {error.__name__}"
            ) from other
        raise NotMetError(f"returned {found!r:.80} from a line on which nothing answers")

    return await timed(bench, limit_s, read(), "a silent line")


async def require_refused(
    bench: TestBench, what: str, call: Callable[[], Awaitable[Any]], tries: int = 3
) -> None:
    """Check that a value out of range is refused with ValueError before anything is sent.

    A driver may have a keep-alive on the same line, so a try during which bytes were sent is
    repeated: once it must be without any.

    Parameters
    ----------
    bench : with the device
    what : the value, for the message
    call : function that returns the awaitable of the verb
    tries : number of tries that may be disturbed

    Raises
    ------
    NotMetError : it was taken, or refused in another form, or only after something was sent
    """
    for _ in range(tries):
        before = bench.line.sent_count
        try:
            await call()
        except ValueError:
            if bench.line.sent_count == before:
                return
            continue
        except Exception as error:
            raise NotMetError(
                f"{what}: raised {type(error).__name__} ({error}), expected ValueError"
            ) from error
        raise NotMetError(f"{what}: was taken")
    raise NotMetError(f"{what}: bytes were sent before it was refused")


async def cancel_often(
    bench: TestBench,
    reading: Callable[[], Awaitable[Any]],
    check: Callable[[], Awaitable[None]],
    limit_s: float,
) -> MeasuredFigure:
    """Cancel an exchange at several instants; return the longest time to the next answer.

    Parameters
    ----------
    bench : with the device
    reading : function that returns the awaitable to cancel
    check : raises NotMetError if the device does not answer as it should
    limit_s : time limit of the check [cell s]

    Raises
    ------
    NotMetError : the cancellation was swallowed, or the device does not answer afterwards
    """
    longest_s = 0.0
    for turns, wait_s in enumerate(STEP_WAITS_S):
        task: asyncio.Future[Any] = asyncio.ensure_future(reading())
        for _ in range(turns + 1):
            await asyncio.sleep(0)
        await bench.clock.sleep(wait_s)
        was_done = task.done()
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        require(was_done or task.cancelled(), "the cancellation was swallowed")
        took_s = await timed(bench, limit_s, check(), "after a cancellation")
        longest_s = max(longest_s, took_s)
    limit_ms = bench.clock.patience_s(limit_s) * 1e3
    return MeasuredFigure(longest_s * 1e3, "ms", limit_ms, "until the next answer")


def require_model(bench: TestBench) -> MeasuredFigure:
    """Check that a connected device has a name for messages; return it as a remark."""
    model = bench.device.model
    require(isinstance(model, str) and model.strip() != "", f"its model is {model!r}")
    return MeasuredFigure(remark=f"{model}")
