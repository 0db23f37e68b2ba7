"""The arm's state by RTDE: read in a task of its own, with silence and loss made visible.

Sections (§) are those of ur.md.
"""

import asyncio
import logging
from collections import deque
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from drivers.clock import CellClock
from drivers.errors import DeviceError, RefusedError, SilentLineError, WrongDeviceError
from messages import key, say

from ..protocol import (
    OPTIONAL_FIELDS,
    REQUIRED_FIELDS,
    Package,
    PackageReader,
    PackageType,
    Recipe,
    decode_accepted,
    decode_recipe,
    decode_text,
    decode_version,
    encode_outputs,
    encode_request,
    encode_version,
)
from ._stream import Stream, open_stream

__all__ = ["RtdePort", "UrState"]

log = logging.getLogger(__name__)

REPLY_S: Final = 1.0  # for one step of the set-up [cell s]
LAG_PERIODS: Final = 5  # a gap this long in the controller's own time is worth a line in the log
TEXT_COUNT: Final = 8  # messages kept


@dataclass(frozen=True, slots=True, eq=False)
class UrState:
    """The arm at one instant (§2.3).

    Attributes
    ----------
    timestamp_s : the controller's time
    q, qd : (6,) joints, as its encoders have them [rad, rad/s]
    robot_mode, safety_mode, runtime_state : their numbers (§5)
    speed_share : share of the ordered speed at which a program runs now: slider and limiter
    payload_kg, centre_mm, tcp_mm : mass on the flange, its centre, and the TCP's position; None
        where the controller does not say
    """

    timestamp_s: float
    q: NDArray[np.float64]
    qd: NDArray[np.float64]
    robot_mode: int
    safety_mode: int
    runtime_state: int
    speed_share: float
    payload_kg: float | None = None
    centre_mm: NDArray[np.float64] | None = None
    tcp_mm: NDArray[np.float64] | None = None


class RtdePort:
    """The connection to port 30004, while it is open.

    Parameters
    ----------
    stream : its connection
    clock : the cell's clock
    silence_s : a line on which no package has come for so long is silent [cell s]
    """

    def __init__(self, stream: Stream, clock: CellClock, silence_s: float) -> None:
        self._stream, self._clock, self._silence_s = stream, clock, silence_s
        self._reader = PackageReader()
        self._queue: deque[Package] = deque()
        self._recipe: Recipe | None = None
        self._period_s = 0.0
        self._latest: UrState | None = None
        self._latest_read = self._read_count = 0
        self._news = asyncio.Event()
        self._failure: DeviceError | None = None
        self._task: asyncio.Task[None] | None = None
        self.texts: deque[str] = deque(maxlen=TEXT_COUNT)
        self.version = (0, 0, 0, 0)
        self.lost_count = 0

    @classmethod
    async def open(
        cls, host: str, port: int, clock: CellClock, silence_s: float, frequency_hz: float
    ) -> "RtdePort":
        """Return the port with its states running in.

        Parameters
        ----------
        host, port : where it is
        clock : the cell's clock
        silence_s : a line on which no package has come for so long is silent [cell s]
        frequency_hz : rate of states asked for

        Raises
        ------
        LinkError : nobody answers there, or not in time
        WrongDeviceError : something else than RTDE, or too old a controller
        """
        stream = await open_stream("RTDE", host, port, clock)
        opened = cls(stream, clock, silence_s)
        try:
            await opened._set_up(frequency_hz)
            opened._task = asyncio.create_task(opened._run(), name="arm states")
            await opened.fresh()
        except BaseException:
            await opened.aclose()
            raise
        return opened

    async def _set_up(self, frequency_hz: float) -> None:
        if not decode_accepted(await self._ask(encode_version(), PackageType.VERSION)):
            raise WrongDeviceError(
                key(
                    "arm: the controller does not speak RTDE version 2; PolyScope 3.7 or later does"
                )
            )
        request = encode_request(PackageType.CONTROLLER)
        self.version = decode_version(await self._ask(request, PackageType.CONTROLLER))
        names = REQUIRED_FIELDS + OPTIONAL_FIELDS
        recipe = await self._ask_outputs(frequency_hz, names)
        if recipe.missing:
            lacking = sorted(set(recipe.missing) & set(REQUIRED_FIELDS))
            if lacking:
                raise WrongDeviceError(
                    say(
                        "arm: the controller's RTDE has no {lacking}; PolyScope 3.7 or "
                        "later has it",
                        lacking=", ".join(lacking),
                    )
                )
            log.info("arm: RTDE has no %s: not read back", ", ".join(recipe.missing))
            kept = tuple(name for name in names if name not in recipe.missing)
            recipe = await self._ask_outputs(frequency_hz, kept)
        self._recipe, self._period_s = recipe, 1.0 / frequency_hz
        if not decode_accepted(
            await self._ask(encode_request(PackageType.START), PackageType.START)
        ):
            raise RefusedError(key("arm: RTDE refuses to start"), 0)

    async def _ask_outputs(self, frequency_hz: float, names: tuple[str, ...]) -> Recipe:
        request = encode_outputs(frequency_hz, names)
        return decode_recipe(await self._ask(request, PackageType.OUTPUTS), names)

    async def _ask(self, request: bytes, kind: PackageType) -> bytes:
        self._stream.write(request)
        try:
            async with self._clock.timeout(REPLY_S):
                while True:
                    package = await self._next()
                    if package.type is kind:
                        return package.payload
                    self._note_text(package)
        except TimeoutError as error:
            raise SilentLineError(
                say(
                    "arm: no reply by RTDE within {reply_s:g} s; is the controller's "
                    "port 30004 in use by too many others?",
                    reply_s=REPLY_S,
                )
            ) from error

    async def _next(self) -> Package:
        while not self._queue:
            data = await self._stream.read()
            self._read_count += 1
            self._queue.extend(self._reader.feed(data))
        return self._queue.popleft()

    async def _run(self) -> None:
        try:
            while True:
                package = await self._next()
                if package.type is PackageType.DATA:
                    self._take(package)
                else:
                    self._note_text(package)
        except DeviceError as error:
            self._failure = error
            self._news.set()

    def _take(self, package: Package) -> None:
        assert self._recipe is not None, "set up first"
        values = self._recipe.unpack(package.payload)
        state = _state_of(values)
        if self._latest is not None:
            gap_s = state.timestamp_s - self._latest.timestamp_s
            lost = round(gap_s / self._period_s) - 1
            if lost > 0:
                self.lost_count += lost
                if lost >= LAG_PERIODS:
                    log.warning("arm: no state for %.0f ms of its own time", gap_s * 1000)
        self._latest, self._latest_read = state, self._read_count
        self._news.set()

    def _note_text(self, package: Package) -> None:
        if package.type is PackageType.TEXT and (text := decode_text(package.payload)):
            log.info("arm: %s", text)
            self.texts.append(text)

    async def fresh(self) -> UrState:
        """Return a state that has come since this call, of which none was on its way before.

        What had arrived by then is in the first read of the socket from now on.

        Raises
        ------
        SilentLineError : none comes
        UnpluggedError : the connection has ended
        """
        return await self._since(self._read_count + 1)

    async def next(self) -> UrState:
        """Return the next state to be read, for who looks at one after the other.

        Raises
        ------
        SilentLineError, UnpluggedError : as `fresh`
        """
        return await self._since(self._read_count)

    async def _since(self, read_count: int) -> UrState:
        """Return the first state behind a number of reads of the socket."""
        try:
            async with self._clock.timeout(self._silence_s):
                while self._failure is None:
                    self._news.clear()
                    await self._news.wait()
                    if self._latest is not None and self._latest_read > read_count:
                        break
        except TimeoutError as error:
            raise SilentLineError(
                say(
                    "arm: no state for {silence_s:g} s; check the cable, and that the "
                    "controller runs",
                    silence_s=self._silence_s,
                )
            ) from error
        if self._failure is not None:
            raise self._failure
        assert self._latest is not None, "one has just come"
        return self._latest

    async def aclose(self) -> None:
        """End the task and the connection."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
        await self._stream.aclose()


def _state_of(values: dict[str, float | tuple[float, ...]]) -> UrState:
    def rows(name: str, scale: float = 1.0) -> NDArray[np.float64] | None:
        return np.array(values[name], np.float64) * scale if name in values else None

    def number(name: str) -> float:
        value = values[name]
        assert not isinstance(value, tuple), say("{name} is one number", name=name)
        return float(value)

    tcp = rows("tcp_offset", 1000.0)
    q, qd = rows("actual_q"), rows("actual_qd")
    assert q is not None, "required"
    assert qd is not None, "required"
    return UrState(
        timestamp_s=number("timestamp"),
        q=q,
        qd=qd,
        robot_mode=int(number("robot_mode")),
        safety_mode=int(number("safety_mode")),
        runtime_state=int(number("runtime_state")),
        speed_share=number("speed_scaling") * number("target_speed_fraction"),
        payload_kg=number("payload") if "payload" in values else None,
        centre_mm=rows("payload_cog", 1000.0),
        tcp_mm=None if tcp is None else tcp[:3],
    )
