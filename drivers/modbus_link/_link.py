"""The policy of a Modbus line: turns, and the meaning of silence.

Rules (modbus_devices.md 8.1, 8.7, 9): one request at a time; a pause between requests to one
device; reads are repeated after silence, writes never; after an answer of "later" the request is
repeated within its time, a write only if its caller allows it; after a time-out on RTU no command
is sent until a harmless read has proved that its answer is not an older one; reconnecting backs
off.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, field
from typing import Final, Self

from pymodbus.pdu import ExceptionResponse, ModbusPDU

from messages import key, say

from ..clock import REAL_TIME, CellClock
from ..errors import (
    BadReplyError,
    LaterError,
    LinkError,
    RefusedError,
    ReplyTimeoutError,
    UnpluggedError,
)
from ..supervisor import BlindLook, BlindStop
from ..wires import LineTap
from ._address import Address, TcpAddress
from ._blind import coil_frame, inputs_frame, inputs_mask, place_of, write_frame
from ._connection import Connection, Lost, NoAnswer, Trace
from ._request import FunctionCode, Request
from ._seen import seen_instead

log = logging.getLogger(__name__)

REPLY_TIMEOUT_S: Final = 0.3  # modbus_devices.md 9.1: 0.1 to 0.3 s
RETRY_COUNT: Final = 1  # the same, for reads
BACK_OFF_FIRST_S: Final = 0.1
BACK_OFF_MAX_S: Final = 2.0
SILENCES_UNTIL_REOPENED: Final = 3  # a half-open connection looks like silent devices
OVERDUE_TIMEOUTS: Final = 10.0  # reply time-outs after which no answer comes any more
RESYNC_TRIES: Final = 3
BLIND_SPACING_WALL_S: Final = 0.02  # spacing from the last frame, ours or the late link's
GATEWAY_SILENCE: Final = {
    0x0A: key("no path to it"),
    0x0B: key("it did not answer the gateway"),
}  # Modbus application protocol V1.1b3, 7
LATER: Final = {
    0x05: "it is still at work on it",
    0x06: "it is busy",
}  # the same: the client is to ask again
LATER_PAUSES: Final = 10  # repeated requests within a reply time-out

Again = Callable[[], Awaitable[bool]]
"""Whether a write that was answered "later" is to be sent again, by looking at the device."""


async def always() -> bool:
    """Return True: a write that sets a state and starts no motion may always be repeated."""
    return True


class _LateReplyError(ReplyTimeoutError):
    """The answer to an earlier request came in the place of this one's."""


@dataclass(slots=True)
class _Turn:
    """One caller's use of the line."""

    request: Request
    who: ModbusUnit
    is_abandoned: bool = False


@dataclass(slots=True)
class _Memory:
    """The link's memory of one unit."""

    ready_at_s: float = 0.0
    quiet_until_s: float = 0.0
    # unanswered requests, with their times
    owed: list[tuple[Request, float]] = field(default_factory=list)


class ModbusLink:
    """One line or connection, shared by every device behind it.

    It connects when it is first used and again, with back-off, after it was lost. Every duration
    is in cell seconds.

    Parameters
    ----------
    address : the transport and where it is
    clock : the cell's clock
    reply_timeout_s : time limit of a unit's answer [cell s], which may consist of further "later"
        answers
    retry_count : a read without an answer is repeated so often
    trace : called with (sending, bytes) for everything on the wire
    tap : tap of the line, None for none

    Attributes
    ----------
    tap : the same, for whoever keeps an order of its own on the line
    """

    def __init__(
        self,
        address: Address,
        clock: CellClock = REAL_TIME,
        *,
        reply_timeout_s: float = REPLY_TIMEOUT_S,
        retry_count: int = RETRY_COUNT,
        trace: Trace | None = None,
        tap: LineTap | None = None,
    ) -> None:
        self.address = address
        self.clock = clock
        self.reply_timeout_s = reply_timeout_s
        self.retry_count = retry_count
        self._has_no_numbers = not (isinstance(address, TcpAddress) and address.returns_ids)
        self._trace = trace
        self.tap = tap
        self._lock = asyncio.Lock()
        self._memories: dict[int, _Memory] = {}
        self._connection: Connection | None = None
        self._is_closed = False
        self._was_connected = False
        self._silence_count = 0
        self._back_off_s = BACK_OFF_FIRST_S
        self._next_try_at_s = 0.0
        self._reason = ""

    async def __aenter__(self) -> Self:
        await self.connect()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.aclose()

    @property
    def is_connected(self) -> bool:
        """Whether the line is open at this moment; devices may be silent all the same."""
        return self._connection is not None and self._connection.is_open

    def unit(
        self,
        unit: int,
        name: str,
        *,
        spacing_s: float = 0.0,
        probes: tuple[Request, ...] = (),
        check: str = key("its power, its unit id and its wiring"),
    ) -> ModbusUnit:
        """Return the handle of one device.

        Parameters
        ----------
        unit : unit id, or slave id on RS-485, 1..247
        name : name of the device in messages
        spacing_s : least pause between two exchanges with it [cell s]
        probes : harmless reads with answers of different shape, to resynchronise RTU with
        check : advice in a message on what to check when it is silent
        """
        return ModbusUnit(self, unit, name, spacing_s, probes, check)

    @property
    def _patience_s(self) -> float:
        """The real length of the reply time-out [cell s]."""
        return self.clock.patience_s(self.reply_timeout_s)

    async def connect(self) -> None:
        """Open the line now, without regard to back-off; nothing to do when it is open.

        Raises
        ------
        LinkError : it cannot be opened; the message has where, why and what to check
        """
        async with self._lock:
            self._next_try_at_s = 0.0
            await self._opened()

    async def aclose(self) -> None:
        """Close the line for good. A request under way is allowed to finish first."""
        self._is_closed = True
        async with self._lock:
            await self._drop()

    async def exchange(
        self, request: Request, who: ModbusUnit, again: Again | None = None
    ) -> tuple[int, ...]:
        """Send a request; return the registers or bits of a read, nothing of a write.

        A read is repeated when no answer came; a write never is. After an answer of "later" the
        request is repeated until its reply time-out is over: a read always, a write where ``again``
        allows it.

        Parameters
        ----------
        request : request to send
        who : the unit
        again : asked before a write that was answered "later" is sent again; None: it is not.
            A stop may have come between, which the repeated command would undo

        Raises
        ------
        LinkError : not connected, and it cannot be reached now
        UnpluggedError : the connection ended while the answer was due
        ReplyTimeoutError : the unit is silent, or its gateway reports it so
        LaterError : it is busy (05, 06), and was until its time was over
        BadReplyError : something answered that is no answer to this
        RefusedError : the unit answered with a Modbus exception, which is its ``code``
        """
        retries_left = self.retry_count if request.is_read else 0
        until_s = self.clock.attended_s() + self._patience_s
        while True:
            try:
                return await self._take_turn(_Turn(request, who))
            except LaterError as error:
                if self.clock.attended_s() >= until_s:
                    raise
                log.debug("asking again: %s", error)
                await self.clock.sleep(self._patience_s / LATER_PAUSES)
                if not request.is_read and (again is None or not await again()):
                    raise
            except (ReplyTimeoutError, UnpluggedError) as error:
                if not retries_left:
                    raise
                retries_left -= 1
                log.debug("asking again: %s", error)

    async def _take_turn(self, turn: _Turn) -> tuple[int, ...]:
        """Wait for the line and use it once.

        A caller that is cancelled before its request is out sends nothing. One that is cancelled
        later leaves at once, but the line stays taken until the answer is in: otherwise the next
        request, most likely a stop, would have to wait for a resynchronisation.
        """
        what = say("unit {unit} {request}", unit=turn.who.unit, request=turn.request)
        if self.tap is not None:
            await self.tap.turn(what)
        await self._lock.acquire()
        if self.tap is not None:
            self.tap.taken(what)
        task = asyncio.ensure_future(self._use_line(turn))
        task.add_done_callback(self._line_is_free)
        try:
            return await asyncio.shield(task)
        except asyncio.CancelledError:
            turn.is_abandoned = True
            if self._connection is None or not self._connection.is_asking:
                task.cancel()
            raise

    async def _use_line(self, turn: _Turn) -> tuple[int, ...]:
        request, who = turn.request, turn.who
        connection = await self._opened()
        memory = self._memories.setdefault(who.unit, _Memory())
        if memory.owed:
            await self._resync(connection, memory, turn)
        reply = await self._ask(connection, request, memory, turn)
        if isinstance(reply, ExceptionResponse):
            raise self._refusal(reply.exception_code, request, who)
        if request.function in (FunctionCode.READ_COILS, FunctionCode.READ_DISCRETE_INPUTS):
            return tuple(int(bit) for bit in reply.bits[: request.count])
        return tuple(reply.registers) if request.is_read else ()

    def _line_is_free(self, task: asyncio.Task[tuple[int, ...]]) -> None:
        # A callback, because a task that is cancelled before its first step runs no finally.
        self._lock.release()
        if not task.cancelled():
            task.exception()  # seen, even if the caller has left

    async def _ask(
        self, connection: Connection, request: Request, memory: _Memory, turn: _Turn
    ) -> ModbusPDU:
        """Return a reply of the right shape, a Modbus exception included."""
        who = turn.who
        await self.clock.sleep(memory.ready_at_s - self.clock.now_s())
        if turn.is_abandoned:
            raise asyncio.CancelledError
        if self._has_no_numbers:
            memory.owed.append((request, self.clock.now_s()))
        try:
            reply = await connection.exchange(request, who.unit, self.clock, self.reply_timeout_s)
        except NoAnswer as error:
            raise await self._silence(error, request, who) from None
        except Lost:
            await self._drop()
            raise UnpluggedError(
                say(
                    "{name}: the connection to {address} ended before unit {unit} "
                    "answered {request}; {check}",
                    name=who.name,
                    address=self.address,
                    unit=who.unit,
                    request=request,
                    check=self.address.check,
                )
            ) from None
        finally:
            now_s = self.clock.now_s()
            memory.ready_at_s = now_s + who.spacing_s
            memory.quiet_until_s = now_s + self._patience_s
        self._silence_count = 0
        if request.is_answered_by(reply):
            memory.owed = [owed for owed in memory.owed if owed[0] is not request]
            return reply
        message = say(
            "{name}: unit {unit} at {address} was sent {request}, got {reply}",
            name=who.name,
            unit=who.unit,
            address=self.address,
            request=request,
            reply=reply,
        )
        if self._has_no_numbers:
            raise _LateReplyError(
                say("{message}, the late answer to something earlier", message=message)
            )
        raise BadReplyError(message)

    async def _resync(self, connection: Connection, memory: _Memory, turn: _Turn) -> None:
        """Wait until every answer the unit still owes has come or can no longer be mistaken.

        A device answers in the order it was asked. So once a read whose answer looks like none
        of the owed ones has been answered properly, those will not come any more.
        """
        who = turn.who
        overdue_s = OVERDUE_TIMEOUTS * self._patience_s
        for _ in range(RESYNC_TRIES):
            await self._quiet(connection, memory)
            now_s = self.clock.now_s()
            memory.owed = [owed for owed in memory.owed if now_s - owed[1] < overdue_s]
            if not memory.owed or not who.probes:
                memory.owed.clear()
                return
            probe = next(
                (
                    probe
                    for probe in who.probes
                    if not any(probe.looks_like(request) for request, _ in memory.owed)
                ),
                who.probes[0],
            )
            try:
                await self._ask(connection, probe, memory, turn)
            except _LateReplyError as error:
                log.info("%s", error)
                continue
            memory.owed.clear()
            return
        raise ReplyTimeoutError(
            say(
                "{name}: unit {unit} at {address} keeps answering earlier "
                "requests; look for a second master on the line or a gateway that "
                "stores requests",
                name=who.name,
                unit=who.unit,
                address=self.address,
            )
        )

    async def _quiet(self, connection: Connection, memory: _Memory) -> None:
        """Wait one reply time after a time-out, or until the late reply is in."""
        remaining_s = memory.quiet_until_s - self.clock.now_s()
        if remaining_s <= 0 or connection.late_reply.is_set():
            return
        try:
            async with self.clock.timeout(remaining_s):
                await connection.late_reply.wait()
        except TimeoutError:
            return

    async def _silence(self, what: NoAnswer, request: Request, who: ModbusUnit) -> LinkError:
        self._silence_count += 1
        if self._silence_count >= SILENCES_UNTIL_REOPENED:
            log.warning("%s: no answer, reopening it", self.address)
            await self._drop()
        is_tcp = isinstance(self.address, TcpAddress)
        seen, check = seen_instead(what.sent, what.received, is_tcp=is_tcp)
        return ReplyTimeoutError(
            say(
                "{name}: no answer from unit {unit} at {address} within "
                "{reply_timeout_s:g} s to {request}",
                name=who.name,
                unit=who.unit,
                address=self.address,
                reply_timeout_s=self.reply_timeout_s,
                request=request,
            )
            + (
                say("; {seen}; check {check}", seen=seen, check=check)
                if seen
                else say("; check {check}", check=who.check)
            )
        )

    def _refusal(
        self, code: int, request: Request, who: ModbusUnit
    ) -> RefusedError | ReplyTimeoutError:
        if code in GATEWAY_SILENCE:
            return ReplyTimeoutError(
                say(
                    "{name}: the gateway at {address} cannot reach unit {unit}: "
                    "{gateway_silence} (exception {code:02X} to {request}); check "
                    "{check}",
                    name=who.name,
                    address=self.address,
                    unit=who.unit,
                    gateway_silence=GATEWAY_SILENCE[code],
                    code=code,
                    request=request,
                    check=who.check,
                )
            )
        if code in LATER:
            return LaterError(
                say(
                    "{name}: unit {unit} at {address} answered {request} with `later`: "
                    "{later} (exception {code:02X}); check for a second master, or "
                    "give it longer (`reply_s` of this device)",
                    name=who.name,
                    unit=who.unit,
                    address=self.address,
                    request=request,
                    later=LATER[code],
                    code=code,
                )
            )
        return RefusedError(
            say(
                "{name}: unit {unit} at {address} refused {request} with exception {code:02X}",
                name=who.name,
                unit=who.unit,
                address=self.address,
                request=request,
                code=code,
            ),
            code,
        )

    async def _opened(self) -> Connection:
        """Return an open connection, opening it if back-off allows. Call with the lock held."""
        if self._is_closed:
            raise LinkError(say("{address}: this link has been closed", address=self.address))
        if self._connection is not None:
            if self._connection.is_open:
                return self._connection
            await self._drop()
        now_s = self.clock.now_s()
        if now_s < self._next_try_at_s:
            raise LinkError(
                say(
                    "{address}: not connected ({reason}), next try in {wait_s:.1f} s; {check}",
                    address=self.address,
                    reason=self._reason,
                    wait_s=self._next_try_at_s - now_s,
                    check=self.address.check,
                )
            )
        connection = Connection(self.address, self._trace, self.tap)
        try:
            reason = await connection.open(self.clock)
            if self.tap is not None:
                self.tap.opened(reason)
        except asyncio.CancelledError:
            await connection.aclose()
            raise
        if reason is not None:
            await connection.aclose()
            self._reason = reason
            self._next_try_at_s = self.clock.now_s() + self._back_off_s
            self._back_off_s = min(2 * self._back_off_s, BACK_OFF_MAX_S)
            raise LinkError(
                say(
                    "{address}: cannot connect: {reason}; {check}",
                    address=self.address,
                    reason=reason,
                    check=self.address.check,
                )
            )
        if self._was_connected:
            log.warning("%s: connected again", self.address)
        self._was_connected = True
        self._back_off_s = BACK_OFF_FIRST_S
        self._next_try_at_s = 0.0
        self._silence_count = 0
        self._connection = connection
        return connection

    async def _drop(self) -> None:
        if self._connection is not None:
            connection, self._connection = self._connection, None
            await connection.aclose()


@dataclass(frozen=True, slots=True)
class ModbusUnit:
    """One device on a link: its unit id, its timing, reads and writes in its name.

    Got from `ModbusLink.unit`. Each method raises what `ModbusLink.exchange` raises; ``again`` of a
    write is explained there. Addresses are zero based, as on the wire.

    Attributes
    ----------
    link : the line it is on
    unit : its unit id
    name : name used in messages
    spacing_s : least pause between two exchanges [cell s]
    probes : harmless reads to resynchronise with
    check : advice on what to check when it is silent
    """

    link: ModbusLink
    unit: int
    name: str
    spacing_s: float
    probes: tuple[Request, ...]
    check: str

    def __post_init__(self) -> None:
        if not 1 <= self.unit <= 255:
            raise ValueError(f"{self.name}: unit must be 1..255, not {self.unit}")

    def __str__(self) -> str:
        return say(
            "{name} (unit {unit} at {address})",
            name=self.name,
            unit=self.unit,
            address=self.link.address,
        )

    def blind_write(self, register: int, value: int) -> BlindStop:
        """Return a write of one register (FC06), for the supervisor to send.

        Parameters
        ----------
        register : zero based
        value : 0..65535
        """
        return self._blind(write_frame(self.link.address, self.unit, register, value))

    def blind_switch(self, coil: int, *, is_on: bool) -> BlindStop:
        """Return a switch of one coil (FC05), for the supervisor to send.

        Parameters
        ----------
        coil : zero based
        is_on : state to switch it to
        """
        return self._blind(coil_frame(self.link.address, self.unit, coil, is_on=is_on))

    def _blind(self, frame: bytes) -> BlindStop:
        return BlindStop(self.name, place_of(self.link.address), (frame,), BLIND_SPACING_WALL_S, 2)

    def blind_look(self, count: int, wanted: tuple[int, ...]) -> BlindLook | None:
        """Return a reading of the first discrete inputs (FC02), for the supervisor to make.

        None on a line that lets one look alone: only Modbus TCP has room for a second connection.

        Parameters
        ----------
        count : inputs to read
        wanted : names of those that are on while all is well
        """
        address = self.link.address
        if not isinstance(address, TcpAddress):
            return None
        request = inputs_frame(address, self.unit, count)
        return BlindLook(self.name, place_of(address), request, inputs_mask(count, wanted))

    async def read_coils(self, address: int, count: int) -> tuple[bool, ...]:
        """Return the values of coils (FC01)."""
        return await self._bits(FunctionCode.READ_COILS, address, count)

    async def read_discrete_inputs(self, address: int, count: int) -> tuple[bool, ...]:
        """Return the values of discrete inputs (FC02)."""
        return await self._bits(FunctionCode.READ_DISCRETE_INPUTS, address, count)

    async def read_holding_registers(self, address: int, count: int) -> tuple[int, ...]:
        """Return the values of holding registers (FC03)."""
        request = Request(FunctionCode.READ_HOLDING_REGISTERS, address, count)
        return await self.link.exchange(request, self)

    async def read_input_registers(self, address: int, count: int) -> tuple[int, ...]:
        """Return the values of input registers (FC04)."""
        request = Request(FunctionCode.READ_INPUT_REGISTERS, address, count)
        return await self.link.exchange(request, self)

    async def write_coil(self, address: int, value: bool, *, again: Again | None = None) -> None:
        """Write one coil (FC05).

        Parameters
        ----------
        address, value : address and value of the coil
        again : decides after the answer "later" whether it is sent again; None: it is not
        """
        request = Request(FunctionCode.WRITE_COIL, address, 1, (int(value),))
        await self.link.exchange(request, self, again)

    async def write_register(self, address: int, value: int, *, again: Again | None = None) -> None:
        """Write one register (FC06).

        Parameters
        ----------
        address, value : address and value of the register
        again : decides after the answer "later" whether it is sent again; None: it is not
        """
        request = Request(FunctionCode.WRITE_REGISTER, address, 1, (value,))
        await self.link.exchange(request, self, again)

    async def write_coils(
        self, address: int, values: Sequence[bool], *, again: Again | None = None
    ) -> None:
        """Write several coils in one request (FC15).

        Parameters
        ----------
        address, values : address and values of the first coil, and all of them in order
        again : decides after the answer "later" whether it is sent again; None: it is not
        """
        bits = tuple(int(value) for value in values)
        request = Request(FunctionCode.WRITE_COILS, address, len(bits), bits)
        await self.link.exchange(request, self, again)

    async def write_registers(
        self, address: int, values: Sequence[int], *, again: Again | None = None
    ) -> None:
        """Write several registers in one request (FC16).

        Parameters
        ----------
        address, values : address and values of the first register, and all of them in order
        again : decides after the answer "later" whether it is sent again; None: it is not
        """
        words = tuple(values)
        request = Request(FunctionCode.WRITE_REGISTERS, address, len(words), words)
        await self.link.exchange(request, self, again)

    async def _bits(self, function: FunctionCode, address: int, count: int) -> tuple[bool, ...]:
        bits = await self.link.exchange(Request(function, address, count), self)
        return tuple(bool(bit) for bit in bits)
