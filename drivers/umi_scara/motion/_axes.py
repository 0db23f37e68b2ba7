"""The seven motors as the line offers them: parameters, status, go, stop (umi_rtx.md 2).

Knows the IP of each motor, the values already written, and the way to find out after a broken
exchange if it was carried out. Knows nothing of limits, homing or joints.

Sections (§) are those of umi_rtx.md.
"""

import logging
from collections.abc import Callable, Iterable, Mapping
from typing import NoReturn, TypeVar

from drivers.clock import CellClock
from drivers.errors import BadReplyError, DeviceError, PositionLostError, RefusedError
from messages import key, say

from ..line import Guard, LineUncertainError, Link, breaks_step
from ..protocol import codec
from ..protocol import constants as c
from ..protocol.codec import Reply, Status, Value, Version
from ..protocol.constants import ADDRESSES, Axis, Drive, Ip, Mode, Parameter, Simple, StatusBits

log = logging.getLogger(__name__)
R = TypeVar("R", Status, Value, Version)

BUSY_LIMIT_S = 10.0  # a motor that is busy (§2.9 code 03) for longer is stuck
# A fast emulated cell shares the host: polling more often would slow it down.
MIN_POLL_WALL_S = 0.004
_DITHER_COUNTS = 2
_READ_COUNT = 8  # reads until two agree; an arm at rest needs one
_FASTEST_FIRST = sorted(Axis, key=lambda axis: -c.NOMINAL_COUNTS_PER_S[axis])


class ReadingsDifferError(BadReplyError):
    """No two readings in a row agree: something moves, or the line is disturbed."""


def _the(kind: type[R], reply: Reply) -> R:
    if not isinstance(reply, kind):
        raise BadReplyError(
            say("arm: {reply} where a {name} was due", reply=reply, name=kind.__name__)
        )
    return reply


class Axes:
    """The motors behind a link.

    Parameters
    ----------
    link : the line of both IPs
    clock : the cell's clock
    on_position_lost : called with every 0E and 0F: an IP has restarted
    on_uncertain : called when something else than was asked may have been carried out
    """

    def __init__(
        self,
        link: Link,
        clock: CellClock,
        on_position_lost: Callable[[], None],
        on_uncertain: Callable[[LineUncertainError], None] = lambda _: None,
    ) -> None:
        self.link = link
        self.clock = clock
        self._on_position_lost = on_position_lost
        self._on_uncertain = on_uncertain
        self._written: dict[tuple[Axis, Parameter], int] = {}

    # ---- time ----------------------------------------------------------------------------------
    async def pause(self) -> None:
        """Wait for the time between two polls."""
        await self.clock.sleep(max(c.POLL_S, MIN_POLL_WALL_S * self.clock.speed))

    def deadline_s(self, patience_s: float) -> float:
        """Return the attended instant at which ``patience_s`` from now is over [cell s]."""
        return self.clock.attended_s() + self.clock.patience_s(patience_s)

    # ---- the line ------------------------------------------------------------------------------
    def ips(self, axes: Iterable[Axis] = Axis) -> list[Ip]:
        """Return the IPs of axes, the listening one first: it needs no hand-over."""
        found = {ADDRESSES[axis].ip for axis in axes}
        return sorted(found, key=lambda ip: (ip is not self.link.listening, ip))

    async def _exchange(
        self,
        ip: Ip,
        *frames: bytes,
        repeats: bool = False,
        guard: Guard | None = None,
        proves: bool = False,
    ) -> Reply:
        try:
            return (
                await self.link.exchange(ip, *frames, repeats=repeats, guard=guard, proves=proves)
            )[-1]
        except PositionLostError:
            self._lose()
            raise
        except LineUncertainError as error:
            self._note_uncertain(error)
            raise

    def _note_uncertain(self, error: LineUncertainError) -> None:
        self._written.clear()
        self._on_uncertain(error)

    async def halt_uncertain(self, why: str) -> NoReturn:
        """Dead-stop both IPs for the reason given, and raise LineUncertainError.

        Raises
        ------
        LineUncertainError : always; both IPs have had a dead stop by then
        """
        error = LineUncertainError(say("arm: {why}; both boards were stopped", why=why))
        self._note_uncertain(error)
        await self.halt(Simple.DEAD_STOP)
        raise error

    def forget(self) -> None:
        """Forget all parameter values: each is read again before it is trusted."""
        self._written.clear()

    def _lose(self) -> None:
        self._written.clear()  # what a restart does to parameters is unknown (§9.23)
        self._on_position_lost()

    async def send(self, ip: Ip, request: bytes, guard: Guard | None = None) -> None:
        """Send an absolute command, which may be repeated after a lost reply.

        Not for hand-overs, relative moves and interpolation.

        Parameters
        ----------
        ip : the board to send it to; the line is handed over first where needed
        request : the command's bytes, from `codec`
        guard : called before every request; raises once the motion has been stopped
        """
        try:
            await self._exchange(ip, request, guard=guard)
        except DeviceError as error:
            if not breaks_step(error):
                raise
            log.warning("said again after %s", error)
            await self._exchange(ip, request, guard=guard)

    async def send_both(self, command: Simple, guard: Guard | None = None) -> None:
        """Send an absolute command to both IPs, the listening one first."""
        if command is Simple.LOAD_DEFAULTS:
            for axis, parameter in list(self._written):
                if parameter in c.RELOADED:
                    del self._written[axis, parameter]
        for ip in self.ips():
            await self.send(ip, codec.encode_simple(command), guard)
            await self.expect_rest(ip)

    async def expect_rest(self, ip: Ip) -> None:
        """Make sure that an acknowledged command to an arm at rest has started no motion.

        One wrong bit turns it into a go (`22` and `A2`, `24` and `A4`).
        """
        if await self.general_status(ip) & StatusBits.MOVING:
            await self.halt_uncertain(say("IP{ip:d} moves without an order", ip=ip))

    async def halt(self, command: Simple, *, verifies: bool = True) -> None:
        """Send a stop to both IPs, ahead of everything else."""
        try:
            await self.link.halt(codec.encode_simple(command), verifies=verifies)
        except PositionLostError:
            self._lose()
            raise
        except LineUncertainError as error:
            self._note_uncertain(error)
            raise

    # ---- reading -------------------------------------------------------------------------------
    async def status(self, axis: Axis) -> StatusBits:
        """Return the status of one controller (§2.8)."""
        ip, ctl = ADDRESSES[axis]
        reply = await self._exchange(ip, codec.encode_controller_status(ctl), repeats=True)
        return _the(Status, reply).bits

    async def general_status(self, ip: Ip) -> StatusBits:
        """Return the status of one IP (§2.8)."""
        reply = await self._exchange(ip, codec.encode_simple(Simple.GENERAL_STATUS), repeats=True)
        return _the(Status, reply).bits

    async def version(self, ip: Ip) -> Version:
        """Return the ROM version of one IP (§2.3)."""
        reply = await self._exchange(ip, codec.encode_simple(Simple.VERSION), repeats=True)
        return _the(Version, reply)

    async def read(self, axis: Axis, parameter: Parameter) -> int:
        """Return a parameter, by the transport it takes (§2.5)."""
        ip, ctl = ADDRESSES[axis]
        if parameter in c.IMMEDIATE:
            frames: tuple[bytes, ...] = (codec.encode_immediate_read(parameter, ctl),)
        else:
            frames = codec.encode_deferred_read(parameter, ctl)
        return _the(Value, await self._exchange(ip, *frames, repeats=True)).value

    async def read_actual(self, axis: Axis) -> int:
        """Return a motor's true position [counts]: CURRENT_POSITION less CP_ERROR (§2.5, nr 15)."""
        commanded = await self.read(axis, Parameter.CURRENT_POSITION)
        return commanded - await self.read(axis, Parameter.CP_ERROR)

    async def read_actuals(self, axes: Iterable[Axis]) -> dict[Axis, int]:
        """Return the motors' true positions [counts], with one hand-over at most."""
        wanted = list(axes)
        found = {}
        for ip in self.ips(wanted):
            for axis in wanted:
                if ADDRESSES[axis].ip is ip:
                    found[axis] = await self.read_actual(axis)
        return {axis: found[axis] for axis in wanted}

    # ---- writing -------------------------------------------------------------------------------
    def written(self, axis: Axis, parameter: Parameter) -> int | None:
        """Return the last value set for a parameter in this session; None if it is not known."""
        return self._written.get((axis, parameter))

    async def write(
        self, axis: Axis, parameter: Parameter, value: int, guard: Guard | None = None
    ) -> None:
        """Set a deferred parameter to a value that it does not have yet, and read it back.

        A value it has already is not written: reading back would not show that it went astray.

        Parameters
        ----------
        axis : the motor
        parameter : a parameter with a deferred write (§2.5)
        value : in the parameter's own units, a signed word
        guard : called before every request; raises once the motion has been stopped
        """
        if (axis, parameter) not in self._written:
            self._written[axis, parameter] = await self.read(axis, parameter)
        if self._written[axis, parameter] == value:
            return
        ip, ctl = ADDRESSES[axis]
        frames = codec.encode_deferred_write(parameter, ctl, value)
        self._written.pop((axis, parameter), None)
        is_acknowledged = True
        try:
            await self._exchange(ip, *frames, guard=guard)
        except DeviceError as error:
            if not breaks_step(error):
                raise
            is_acknowledged = False
        # the checksum protects the value alone, neither the parameter nor the motor (§2.2)
        if await self._differs(axis, parameter, value):
            if is_acknowledged:
                await self.halt_uncertain(
                    say("what was written for {name} went elsewhere", name=axis.name.lower())
                )
            await self._exchange(ip, *frames, guard=guard)
            if await self._differs(axis, parameter, value):
                await self.halt_uncertain(
                    say(
                        "{name} of {axis} does not take {value}",
                        name=parameter.name,
                        axis=axis.name.lower(),
                        value=value,
                    )
                )
        self._written[axis, parameter] = value

    async def _differs(self, axis: Axis, parameter: Parameter, value: int) -> bool:
        """Return whether a parameter reads other than `value`, twice."""
        for _ in range(2):
            if await self.read(axis, parameter) == value:
                return False
        return True

    async def label(self, axis: Axis, counts: int, guard: Guard | None = None) -> None:
        """Declare the present position of a motor at rest to be `counts`; nothing moves (§2.5).

        Parameters
        ----------
        axis : the motor; it must be at rest
        counts : new value of its encoder
        guard : called before every request; raises once the motion has been stopped
        """
        ip, ctl = ADDRESSES[axis]
        await self.send(ip, codec.encode_immediate_write(ctl, counts), guard)

    async def set_mode(self, axis: Axis, mode: Mode) -> None:
        """Put a controller into a mode (§2.4)."""
        ip, ctl = ADDRESSES[axis]
        await self.send(ip, codec.encode_mode(mode, ctl))

    # ---- motion --------------------------------------------------------------------------------
    async def manual_go(
        self, ip: Ip, drives: Mapping[Axis, Drive], guard: Guard | None = None
    ) -> None:
        """Drive motors of one IP without end; every other motor of that IP holds (§2.6).

        Parameters
        ----------
        ip : the board
        drives : direction for each of its motors that shall move; empty makes all of them hold
        guard : called before every request; raises once the motion has been stopped
        """
        by_ctl = {ADDRESSES[axis].ctl: drive for axis, drive in drives.items()}
        request = codec.encode_manual_go(by_ctl)
        for _ in range(2):
            try:
                await self._exchange(ip, request, guard=guard, proves=True)
                break
            except DeviceError as error:
                if not breaks_step(error):
                    raise
                last = error
        else:
            raise last
        if not drives:
            await self.expect_rest(ip)
            return
        # these first: a go that was misread as another command may have nudged others (§2.7)
        for axis in drives:
            if not await self.status(axis) & (StatusBits.MOVING | c.FAULT_BITS):
                if guard is not None:
                    guard()
                await self.halt_uncertain(
                    say("{name} was sent off and stands still", name=axis.name.lower())
                )
        for axis in _FASTEST_FIRST:
            if ADDRESSES[axis].ip is not ip or axis in drives:
                continue
            if await self.status(axis) & StatusBits.MOVING:
                await self.halt_uncertain(
                    say("{name} moves without an order", name=axis.name.lower())
                )

    async def numeric_go(self, ip: Ip, axes: Iterable[Axis], guard: Guard) -> None:
        """Start motors of one IP towards their NEW_POSITION (§2.7).

        Waits while one is still busy (code 03). After a lost reply, the motors' status
        shows whether they have started.

        Parameters
        ----------
        ip : the board
        axes : its motors to start; each has had its NEW_POSITION
        guard : called before every request; raises once the motion has been stopped

        Raises
        ------
        RefusedError : still busy after BUSY_LIMIT_S
        BadReplyError : no go got through within BUSY_LIMIT_S, and none of the motors has started
        """
        started = list(axes)
        # A1 is one bit away from 21, which sets every counter of the IP to zero. With the shoulder,
        # whose target is where it stands, the request is A3
        company = [Axis.SHOULDER] if started == [Axis.ELBOW] else []
        request = codec.encode_numeric_go(ADDRESSES[axis].ctl for axis in started + company)
        until_s = self.deadline_s(BUSY_LIMIT_S)
        while True:
            try:
                await self._exchange(ip, request, guard=guard, proves=True)
                return
            except RefusedError as error:
                if error.code == c.AXIS_BUSY:
                    if self.clock.attended_s() > until_s:
                        raise
                    await self.pause()
                    while self.clock.attended_s() <= until_s and await self._any(
                        started, StatusBits.MOVING
                    ):
                        guard()
                        await self.pause()
                    continue
                if not breaks_step(error):
                    raise
            except DeviceError as error:
                if not breaks_step(error):
                    raise
            if self.clock.attended_s() > until_s:
                raise BadReplyError(key("arm: no go gets through"))
            if await self._any(started, StatusBits.MOVING | c.FAULT_BITS):
                return

    async def prove(self, ip: Ip) -> None:
        """Make sure that this IP is the one that answers."""
        await self._exchange(
            ip, codec.encode_simple(Simple.GENERAL_STATUS), repeats=True, proves=True
        )

    async def read_actual_twice(self, axis: Axis) -> int:
        """Return the true position of a motor at rest [counts], from reads that agree.

        A reply names neither its parameter nor its motor (§2.2).
        """
        commanded = await self.read_twice(axis, Parameter.CURRENT_POSITION)
        return commanded - await self.read_twice(axis, Parameter.CP_ERROR)

    async def read_twice(self, axis: Axis, parameter: Parameter) -> int:
        """Return a parameter on which two reads in a row agree to 2 counts.

        Raises
        ------
        ReadingsDifferError : no two do
        """
        before = await self.read(axis, parameter)
        for _ in range(_READ_COUNT):
            now = await self.read(axis, parameter)
            if abs(now - before) <= _DITHER_COUNTS:
                return now
            before = now
        raise ReadingsDifferError(
            say(
                "arm: {name} of {axis} reads differently",
                name=parameter.name,
                axis=axis.name.lower(),
            )
        )

    async def _any(self, axes: Iterable[Axis], bits: StatusBits) -> bool:
        for axis in axes:
            if await self.status(axis) & bits:
                return True
        return False
