"""One arm's session: connection, motor power, one motion at a time, and its end.

Sections (§) are those of umi_rtx.md.
"""

import asyncio
import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Final, TypeVar

from drivers.clock import CellClock
from drivers.errors import DeviceError, LinkError, PositionLostError, SilentLineError
from drivers.kinds import Stop
from drivers.tasks import run_to_end
from drivers.wires import LineTap
from messages import key

from .line import (
    Guard,
    LineUncertainError,
    Link,
    LinkConfig,
    SerialTransport,
    Trace,
    Transport,
)
from .model import OutOfRangeError
from .motion import Axes, AxisStalledError, MotionStoppedError, Positions, ReadingsDifferError
from .protocol.codec import encode_controller_status
from .protocol.constants import ADDRESSES, Axis, Ip, Simple, StatusBits

log = logging.getLogger(__name__)
T = TypeVar("T")

# Tries of a verb on a line that noise makes uncertain. With 3, 15 of 20 sessions that noise struck
# three times or more ended in homing, 1000 exchanges long: docs/measurements.md.
_TRY_COUNT: Final = 5


class PowerOffError(DeviceError):
    """A motion without motor power: the arm would acknowledge it and do nothing (§8.10)."""


_STOP_COMMANDS: Final = {  # §2.3
    Stop.DEAD: Simple.DEAD_STOP,
    Stop.RAMP: Simple.RAMP_STOP,
    Stop.FREE: Simple.FREE_STOP,  # axes may sink (§8.6)
}


@dataclass(frozen=True, slots=True)
class ArmIdentity:
    """The identity of the arm that answered `connect`.

    Attributes
    ----------
    rom_versions : per IP, (revision, version); the order of the two bytes is a guess (§9.4)
    restarted_ips : those that had lost their positions and were given GO (§1.5)
    """

    rom_versions: Mapping[Ip, tuple[int, int]]
    restarted_ips: frozenset[Ip]

    @property
    def was_restarted(self) -> bool:
        """Whether any IP came out of a restart."""
        return bool(self.restarted_ips)


class ArmSession:
    """One arm's connection and power, and the queue of its motions.

    Parameters
    ----------
    port : the serial port's path, or what opens a transport
    config : timing of the line
    clock : the cell's clock
    trace : called with every exchange on the wire
    tap : tap of the line, None for none
    """

    def __init__(
        self,
        port: str | Callable[[], Transport],
        config: LinkConfig,
        clock: CellClock,
        trace: Trace | None,
        tap: LineTap | None = None,
    ) -> None:
        self._open_transport = (lambda: SerialTransport(port)) if isinstance(port, str) else port
        self._config = config
        self._clock = clock
        self._trace = trace
        self._tap = tap
        self._axes_or_none: Axes | None = None
        self._identity: ArmIdentity | None = None
        self._is_powered = False
        self._jaws_found = StatusBits(0)
        self.positions = Positions(self._lose_position)
        self._stop_count = self._uncertain_count = self._motion_count = 0
        self._one_motion = asyncio.Lock()

    # ---- connection ----------------------------------------------------------------------------
    async def connect(self) -> ArmIdentity:
        """Bring both IPs to running (§1.6, steps 1-7), nothing moves; return the arm's identity.

        Raises
        ------
        LinkError : no port, or silence on it ("check power, cable, boards")
        WrongDeviceError : text instead of the protocol (§8.7), or not two different IPs
        BadReplyError : bytes that make no sense
        """
        return await self.until_certain(self._connect_once)

    async def _connect_once(self) -> ArmIdentity:
        await self._disconnect()
        link = Link(self._open_transport(), self._clock, self._config, self._trace, self._tap)
        axes = Axes(link, self._clock, self._lose_position, self._note_uncertain)
        try:
            gripper = ADDRESSES[Axis.GRIPPER]
            restarted = await link.open(encode_controller_status(gripper.ctl))
            found = link.found(gripper.ip)
            versions = {ip: await axes.version(ip) for ip in axes.ips()}
        except BaseException:
            await link.aclose()
            raise
        self._axes_or_none = axes
        self._jaws_found = StatusBits(0) if found is None else found.bits
        rom_versions = {ip: (v.revision, v.version) for ip, v in sorted(versions.items())}
        self._identity = ArmIdentity(rom_versions, restarted)
        log.info("arm connected: ROM %s, restarted: %s", rom_versions, sorted(restarted))
        return self._identity

    async def aclose(self) -> None:
        """Dead-stop both IPs (§8.20) and release the line; motors keep holding."""
        if self._axes_or_none is not None:
            self._stop_count += 1
            await run_to_end(self.halt_quietly())
        await self._disconnect()

    async def _disconnect(self) -> None:
        axes, self._axes_or_none = self._axes_or_none, None
        self._forget_position()
        if axes is not None:
            await axes.link.aclose()

    @property
    def identity(self) -> ArmIdentity | None:
        """The result of `connect`; None when not connected or after a restart of an IP."""
        return self._identity

    @property
    def jaws_found(self) -> StatusBits:
        """The gripper's status right before `connect` stopped it; empty once anything has moved."""
        return self._jaws_found

    @property
    def is_powered(self) -> bool:
        """Whether motor power has been enabled and nothing is known to have taken it away."""
        return self._is_powered

    @property
    def is_moving(self) -> bool:
        """Whether a motion has the arm."""
        return self._one_motion.locked()

    @property
    def axes(self) -> Axes:
        """The motors.

        Raises
        ------
        LinkError : not connected
        """
        if self._axes_or_none is None:
            raise LinkError(key("arm: not connected"))
        return self._axes_or_none

    def require_connected(self) -> None:
        """Check that no IP has restarted since `connect`.

        Raises
        ------
        PositionLostError : one has
        """
        if self._identity is None and self._axes_or_none is not None:
            raise PositionLostError(key("arm: an IP has restarted; connect, enable power and home"))

    def _lose_position(self) -> None:
        if self.positions.is_homed:
            log.error("arm: positions are lost")
        self._forget_position()

    def _note_uncertain(self, error: LineUncertainError) -> None:
        """Record that another command may have run, whichever request has revealed it."""
        self._uncertain_count += 1
        self.positions.note_failure(error)

    def _forget_position(self) -> None:
        self._jaws_found = StatusBits(0)
        self._is_powered = False
        self._identity = None
        self.positions.forget()

    def require_homed(self) -> None:
        """Check that counts mean positions.

        Raises
        ------
        PositionLostError : they do not
        """
        if not self.positions.is_homed:
            raise PositionLostError(key("arm: not homed, so that no position of it is known"))

    async def enable_power(self) -> None:
        """Allow motor power on both IPs (`27`, §1.6 step 9): only once people agree to motion."""
        self.require_connected()
        await self.until_certain(lambda: self.axes.send_both(Simple.FREE_OFF))
        self._is_powered = True

    # ---- how a motion ends ---------------------------------------------------------------------
    async def stop(self, kind: Stop = Stop.DEAD) -> None:
        """Stop both IPs (§2.3), ahead of all other traffic; a running verb ends with an error.

        Motions that were waiting for their turn end too, before they begin.

        Raises
        ------
        LinkError, PositionLostError : one IP may not have got the stop; the other one has
        """
        self._stop_count += 1
        self.positions.note_stop(is_free=kind is Stop.FREE)
        if kind is Stop.FREE:
            self._is_powered = False
        await self.until_certain(lambda: run_to_end(self.axes.halt(_STOP_COMMANDS[kind])))

    async def until_certain(self, verb: Callable[[], Awaitable[T]]) -> T:
        """Return a verb's result; repeat it if the line has become uncertain (ADR 15).

        Both boards have been stopped and are at rest by then, and the verb begins by proving
        registers and counters. After `stop` nothing begins again but a stop.

        Parameters
        ----------
        verb : says what should be so, so that doing it twice does no more than doing it once

        Raises
        ------
        LineUncertainError : it has become so `_TRY_COUNT` times
        MotionStoppedError : `stop` was called meanwhile
        """
        stop_count = self._stop_count
        for _ in range(_TRY_COUNT - 1):
            try:
                return await verb()
            except LineUncertainError as error:
                if self._stop_count != stop_count:
                    raise MotionStoppedError(
                        key("arm: the motion was stopped on request")
                    ) from error
                log.warning("begun again: %s", error)
        return await verb()

    async def read(
        self, at_rest: Callable[[], Awaitable[T]], in_motion: Callable[[], Awaitable[T]]
    ) -> T:
        """Return a reading of positions.

        Parameters
        ----------
        at_rest : reads until two readings agree, as they do of an arm at rest
        in_motion : reads once

        Raises
        ------
        ReadingsDifferError : readings of an arm at rest do not agree
        """
        while not self.is_moving:
            motion_count = self._motion_count
            try:
                return await self.until_certain(at_rest)
            except ReadingsDifferError:
                if self._motion_count == motion_count:
                    raise
        return await in_motion()

    @asynccontextmanager
    async def motion(self, *, needs_home: bool = True) -> AsyncIterator[Guard]:
        """Yield a guard and hold the arm for one motion; if that fails, both IPs are stopped.

        A refusal before any byte has gone out needs no stop. Yields a guard that raises once `stop`
        has been called, which also ends those motions that were still waiting for the arm.

        Raises
        ------
        PowerOffError : motor power is off
        PositionLostError : not homed, or an IP has restarted
        MotionStoppedError : `stop` was called while the motion waited for the arm
        """
        stop_count, uncertain_count = self._stop_count, self._uncertain_count

        def guard() -> None:
            if self._stop_count != stop_count:
                raise MotionStoppedError(key("arm: the motion was stopped on request"))
            if self._uncertain_count != uncertain_count:
                raise LineUncertainError(
                    key("arm: the line is uncertain; both boards were stopped")
                )

        async with self._one_motion:
            self._motion_count += 1
            uncertain_count = self._uncertain_count
            guard()
            if not self._is_powered:
                self.require_connected()
                raise PowerOffError(key("arm: motor power is off: enable it first"))
            if needs_home:
                self.require_homed()
            self._jaws_found = StatusBits(0)
            try:
                yield guard
            except OutOfRangeError:
                raise  # nothing has been sent
            except (
                MotionStoppedError,
                AxisStalledError,
                LineUncertainError,
                SilentLineError,
            ) as error:
                self.positions.note_failure(error)
                raise  # both IPs have been stopped already
            except BaseException as error:
                self.positions.note_failure(error)
                await run_to_end(self.halt_quietly())
                raise

    async def halt_quietly(self) -> None:
        """Dead-stop both IPs while an earlier error is being raised: log a failure only."""
        try:
            await self.axes.halt(Simple.DEAD_STOP)
        except DeviceError as error:
            log.error("arm: the dead stop failed too: %s", error)
