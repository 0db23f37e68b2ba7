"""The line to the arm: one request in flight, paced, in step, and always the right IP listening.

Follows umi_rtx.md 1.2 (pacing), §1.4 (handing the line over, non-toggle mode), §1.6 (opening) and
§1.7 (back in step after a lost, short or long reply). It knows no motor: what a request does to
the metal is the caller's business, and so is repeating anything but a read.

A request carries no checksum, so that one wrong bit can make another command of it (ADR 15). A
reply that another command may have caused is answered with a dead stop before anything else.

Sections (§) are those of umi_rtx.md.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NoReturn

from drivers.clock import CellClock
from drivers.errors import (
    BadReplyError,
    DeviceError,
    LinkError,
    PositionLostError,
    RefusedError,
    ReplyTimeoutError,
    SilentLineError,
    WrongDeviceError,
)

from ..protocol import constants as c
from ..protocol.codec import (
    Identity,
    Reply,
    ReplyReader,
    Status,
    Version,
    encode_simple,
    is_go,
    is_query,
    looks_like_text,
)
from ..protocol.constants import Ip, Simple, StatusBits
from ._tasks import Turns, run_to_end
from ._transport import Transport

log = logging.getLogger(__name__)
wire_log = logging.getLogger("cellctl.wire.arm")

SILENT: Final = "nothing answers: check power, cable, boards"  # §8.8
_ATTEMPT_COUNT: Final = 3  # §1.7
_STAY_AWAY: Final = (
    "whether the arm has stopped is unknown, and a motion that was started may go on to its "
    "target. Press the emergency stop if anything moves, then"
)
_STRAY_STOP_COUNT: Final = 12  # 0.1 s
_DEAD_STOP_LIMIT_S: Final = 0.1  # by then a stopped board shows that it stands still
_RAMP_LIMIT_S: Final = 0.6  # 7: a ramp takes 0.25 s
_DRAIN_LIMIT_S: Final = 2.0  # no arm sends for longer than that
# A busy host delivers bytes a little late, however fast the cell's clock runs.
_MIN_SILENCE_WALL_S: Final = 0.02


@dataclass(frozen=True, slots=True)
class WireExchange:
    """One request and what came back for it.

    Attributes
    ----------
    at_s : instant of the request [cell s]
    ip : the IP that is taken to listen; None where that is unknown
    reply : all bytes received, in error too; empty when none came
    """

    at_s: float
    ip: Ip | None
    request: bytes
    reply: bytes


@dataclass(frozen=True, slots=True)
class LinkConfig:
    """Timing of the line [cell s].

    Attributes
    ----------
    spacing_s : start of request to start of request; the arm wants 8 ms (§1.2), and a USB adapter
        sends in frames of 1 ms, so that what leaves 9 ms apart arrives at least 8 ms apart
    reply_timeout_s : a reply is complete by then, or lost (§1.2)
    silence_s : a line on which no byte has come back for so long is silent; three tries fit in
    """

    spacing_s: float = c.MIN_SPACING_S + 0.001
    reply_timeout_s: float = c.REPLY_TIMEOUT_S
    silence_s: float = 0.5

    def __post_init__(self) -> None:
        if self.spacing_s < c.MIN_SPACING_S:
            raise ValueError(f"the arm wants {c.MIN_SPACING_S} s between requests (1.2)")


Trace = Callable[[WireExchange], None]
Guard = Callable[[], None]


class LineUncertainError(DeviceError):
    """A request may have reached the arm as another command; both IPs have had a dead stop.

    Registers and counters may have changed: trust none until it has been read.

    Attributes
    ----------
    may_have_zeroed : define home (`21`) is among what may have been carried out
    """

    def __init__(self, message: str, *, may_have_zeroed: bool = False) -> None:
        super().__init__(message)
        self.may_have_zeroed = may_have_zeroed


def breaks_step(error: DeviceError) -> bool:
    """Return whether host and arm may be out of step after an error (§2.9).

    They may after a refusal, too: an arm refuses nothing that this driver sends, but a go while it
    moves.
    """
    if isinstance(error, RefusedError):
        return error.code != c.AXIS_BUSY
    return isinstance(error, ReplyTimeoutError | BadReplyError)


def _heals(error: DeviceError) -> bool:
    """Return whether the link can go on by finding out anew which IP listens."""
    return breaks_step(error) or isinstance(error, LineUncertainError)


def may_be_another_command(request: bytes, received: bytes) -> bool:
    """Return whether, by the bytes that came back, another command may have run (ADR 15).

    A request of three bytes may have lost its first one, and its data are then commands. A query
    has become a command only if it is acknowledged. A command is checked by its effect.
    """
    if not received:
        return False
    return len(request) == 3 or (is_query(request) and received[0] == 0x00)


def may_be_define_home(request: bytes) -> bool:
    """Return whether one wrong, lost or late byte turns a request into `21`: all counters zero."""
    if len(request) == 3:  # its data are commands once its first byte is lost
        return Simple.DEFINE_HOME in request[1:]
    return bool(request) and (request[0] ^ Simple.DEFINE_HOME).bit_count() == 1


class Link:
    """The line of both IPs.

    Parameters
    ----------
    transport : bytes to and from the arm
    clock : the cell's clock, by which requests are spaced and replies given up
    config : timing of the line
    trace : called with every exchange on the wire
    """

    def __init__(
        self,
        transport: Transport,
        clock: CellClock,
        config: LinkConfig | None = None,
        trace: Trace | None = None,
    ) -> None:
        self._transport = transport
        self._clock = clock
        self._config = config or LinkConfig()
        self._trace = trace
        self._turns = Turns()
        self._listening: Ip | None = None
        self._last_start_s = float("-inf")
        self._last_request = b""
        self._owes_reply = False  # a reply that timed out may still come
        self._mute_since_s: float | None = None
        self._has_given_go = False  # to the IP that is being greeted
        self._is_silent = False  # the last transaction ended in silence
        self._heard_nothing = False
        self._suspect = b""  # the bytes of the last reply that made no sense

    @property
    def listening(self) -> Ip | None:
        """The IP that hears the next request, where that is known."""
        return self._listening

    async def open(self) -> frozenset[Ip]:
        """Bring both IPs to running, non-toggle mode (§1.6, steps 1-6); return the restarted ones.

        Raises
        ------
        LinkError : an IP is silent
        WrongDeviceError : text instead of the protocol (§8.7), or twice the same IP
        BadReplyError : bytes that make no sense
        """
        async with self._turns.take():
            return await run_to_end(self._open())

    async def exchange(
        self,
        ip: Ip,
        *frames: bytes,
        repeats: bool = False,
        guard: Guard | None = None,
        proves: bool = False,
    ) -> tuple[Reply, ...]:
        """Send requests to one IP without anything in between; return their replies.

        Parameters
        ----------
        ip : the board; the line is handed over first where another one listens
        frames : the requests, in order; each is answered before the next goes out
        repeats : the frames only read, so that they may be sent again after a resync
        guard : called right before each request; if it raises, the request is not sent
        proves : check which IP listens right before the frames, even if no hand-over was needed

        Raises
        ------
        ReplyTimeoutError, BadReplyError : done or not is unknown; the line is back in step
        LineUncertainError : something else may have been done; both IPs were stopped
        SilentLineError : nothing has come back for `silence_s`
        RefusedError : the IP's own no, with its code (§2.9)
        PositionLostError : an IP has restarted (§1.5)
        LinkError : the line could not be brought back in step
        """
        async with self._turns.take():
            self._listen_anew()
            return await run_to_end(self._exchange_all(ip, frames, repeats, guard, proves))

    async def halt(self, request: bytes, *, verifies: bool = True) -> None:
        """Send a stop to BOTH IPs, ahead of all that waits, whatever state they are in (§2.3).

        The second IP gets its stop even if the first fails; the failure is raised afterwards. A
        silent line gets both stops all the same: perhaps it is only the way back that is cut.

        Parameters
        ----------
        verifies : check that nothing moves on either IP, and stop it again if it does
        """
        async with self._turns.take(urgent=True):
            self._listen_anew()
            await run_to_end(self._halt(request, verifies))

    async def aclose(self) -> None:
        """Let go of the line."""
        await self._transport.aclose()

    # ---- one exchange --------------------------------------------------------------------------
    def _listen_anew(self) -> None:
        """Start timing silence; a line that was silent before gets one more try, not three."""
        self._mute_since_s = None
        self._heard_nothing, self._is_silent = self._is_silent, False

    async def _exchange(self, request: bytes) -> Reply:
        """Send one request and read its reply; repeat a query after 01, 02 or 04 (§2.9)."""
        for _ in range(_ATTEMPT_COUNT):
            try:
                return await self._exchange_once(request)
            except RefusedError as error:
                if error.code == c.AXIS_BUSY and not is_go(request):
                    raise BadReplyError(str(error)) from error
                if error.code not in c.RETRY_CODES or not is_query(request):
                    raise
                last = error
                await self._clock.sleep(c.BUSY_RETRY_S)
        raise last

    async def _exchange_once(self, request: bytes) -> Reply:
        await self._pace()
        if stale := await self._transport.read(0):
            await self._judge_stale(stale)
            raise BadReplyError(f"arm: {stale.hex(' ').upper()} came unasked")
        started_s = self._last_start_s = self._clock.now_s()
        ip = self._listening
        reader = ReplyReader(request)
        self._last_request = request
        self._transport.write(request)
        try:
            return await self._read(reader, request)
        except PositionLostError:
            raise
        except (BadReplyError, ReplyTimeoutError, RefusedError) as error:
            self._suspect = reader.data if isinstance(error, BadReplyError) else b""
            is_busy = isinstance(error, RefusedError) and error.code == c.AXIS_BUSY
            if (
                not is_busy
                and not self._owes_reply
                and may_be_another_command(request, reader.data)
            ):
                await self._stop_stray(request, reader.data)
            raise
        finally:
            wire_log.debug("%s -> %s", request.hex(" ").upper(), reader.data.hex(" ").upper())
            if self._trace is not None:
                self._trace(WireExchange(started_s, ip, request, reader.data))

    async def _judge_stale(self, stale: bytes) -> None:
        """Raise LineUncertainError if bytes that came unasked report a command nobody sent."""
        self._suspect = stale
        is_owed, self._owes_reply = self._owes_reply, False
        if not is_owed and (len(self._last_request) == 3 or stale[0] == 0x00):
            await self._stop_stray(self._last_request, stale)

    async def _stop_stray(self, request: bytes, received: bytes) -> NoReturn:
        """Dead-stop the listening IP before anything else; raise LineUncertainError.

        The stop is sent many times: a late byte may still arrive, take the next two for its data
        and move something by a step (§2.7).
        """
        self._listening = None
        for _ in range(_STRAY_STOP_COUNT):
            await self._pace()
            await self._transport.read(0)
            self._last_start_s = self._clock.now_s()
            self._transport.write(encode_simple(Simple.DEAD_STOP))
        raise LineUncertainError(
            f"arm: {received.hex(' ').upper()} came back for {request.hex(' ').upper()}: it may "
            "have reached the arm as another command; both boards were stopped",
            may_have_zeroed=may_be_define_home(request),
        )

    async def _pace(self) -> None:
        due_s = self._last_start_s + self._config.spacing_s
        while (left_s := due_s - self._clock.now_s()) > 0:
            await self._clock.sleep(left_s)

    async def _read(self, reader: ReplyReader, request: bytes) -> Reply:
        clock = self._clock
        began_s = clock.attended_s()
        if self._mute_since_s is None:
            self._mute_since_s = began_s
        until_s = began_s + clock.patience_s(self._config.reply_timeout_s)
        if not self._heard_nothing:
            until_s = min(until_s, self._mute_since_s + self._silence_limit_s())
        while True:
            left_s = until_s - clock.attended_s()
            if left_s > 0:
                data = await self._transport.read(clock.to_wall_s(left_s))
            else:  # bytes on their way through the kernel count as in time
                with clock.held() as look_wall_s:
                    data = await self._transport.read(look_wall_s)
            if data:
                self._mute_since_s, self._heard_nothing = None, False
                if (reply := reader.feed(data)) is not None:
                    return reply
            elif left_s <= 0:
                break
        if self._mute_since_s is not None:
            mute_s = clock.attended_s() - self._mute_since_s
            if self._heard_nothing or mute_s >= self._silence_limit_s() - 1e-6:
                self._is_silent, self._listening = True, None
                raise SilentLineError(
                    f"arm: no byte came back for {mute_s:.2f} s (last request "
                    f"{request.hex(' ').upper()}): {_STAY_AWAY} {SILENT.partition(': ')[2]}"
                )
        self._owes_reply = self._owes_reply or not reader.data
        got = f"only {reader.data.hex(' ').upper()} of a" if reader.data else "no"
        raise ReplyTimeoutError(
            f"arm: {got} reply to {request.hex(' ').upper()} "
            f"within {self._config.reply_timeout_s:.3f} s"
        )

    def _silence_limit_s(self) -> float:
        """Return how long a line may be mute [cell s]; two tries fit in on any host."""
        reply_s = self._clock.patience_s(self._config.reply_timeout_s)
        return self._config.silence_s if 1.6 * reply_s <= self._config.silence_s else 2 * reply_s

    # ---- who listens ---------------------------------------------------------------------------
    async def _identify(self) -> Ip:
        reply = await self._exchange(encode_simple(Simple.IDENTIFY))
        assert isinstance(reply, Identity)  # the reader lets nothing else through
        return reply.ip

    async def _who(self) -> Ip:
        """Return which IP listens, by the one query that no single bit turns into harm (ADR 15)."""
        for _ in range(_ATTEMPT_COUNT):
            try:
                reply = await self._exchange(encode_simple(Simple.VERSION))
                assert isinstance(reply, Version)
                return reply.ip
            except DeviceError as error:
                if not breaks_step(error):
                    raise
                last = error
                await self._drain()
        raise last

    async def _select(self, ip: Ip) -> None:
        """Make `ip` listen; a hand-over is not repeated before checking which IP listens (§1.7)."""
        if self._listening is None:
            await self._resync()
        for _ in range(_ATTEMPT_COUNT):
            if self._listening is ip:
                return
            await self._hand_over(to=ip)
        raise BadReplyError(f"arm: IP{ip:d} does not take the line")

    async def _hand_over(self, to: Ip) -> None:
        """Hand the line over once, and check who has it: the acknowledgement proves nothing.

        Raises
        ------
        LineUncertainError : acknowledged, and the same IP listens: something else was carried out
        """
        self._listening = None
        request = encode_simple(Simple.TOGGLE_ONCE)
        is_acknowledged = True
        try:
            await self._exchange(request)
        except DeviceError as error:
            if not breaks_step(error):
                raise
            is_acknowledged = 0x00 in self._suspect
            await self._drain()
        who = await self._who()
        if who is not to and is_acknowledged:
            await self._stop_stray(request, b"\x00")
        self._listening = who

    async def _prove(self, ip: Ip) -> None:
        """Make sure that `ip` listens, right before a request that moves metal."""
        if (who := await self._who()) is not ip:
            await self._stop_stray(self._last_request, bytes([0x20 | who]))

    # ---- opening, and back in step -------------------------------------------------------------
    async def _open(self) -> frozenset[Ip]:
        self._suspect = b""
        await self._drain()
        return await self._meet_both(allow_restart=True)

    async def _meet_both(self, *, allow_restart: bool) -> frozenset[Ip]:
        """Meet the listening IP, hand over, meet the other one (§1.6, steps 2-6)."""
        self._listening = None
        first, first_restarted = await self._meet(allow_restart, "neither IP")
        for _ in range(2):  # a second time only if the first hand-over did not take place
            try:
                await self._exchange(encode_simple(Simple.TOGGLE_ONCE))
            except DeviceError as error:
                if not _heals(error):
                    raise
                await self._drain()
            second, second_restarted = await self._meet(allow_restart, f"the IP beside IP{first:d}")
            if second is not first:
                self._listening = second
                restarted = {first: first_restarted, second: second_restarted}
                return frozenset(ip for ip, was_restarted in restarted.items() if was_restarted)
            first_restarted = first_restarted or second_restarted
        raise WrongDeviceError(f"arm: both boards answer as IP{first:d}")

    async def _meet(self, allow_restart: bool, who: str) -> tuple[Ip, bool]:
        """Switch off automatic toggling in the listening IP; return it and whether it restarted.

        A restarted IP is given GO where that is allowed (§1.5).
        """
        self._has_given_go = False
        for attempt in range(_ATTEMPT_COUNT):
            try:
                return await self._greet(allow_restart), self._has_given_go
            except DeviceError as error:
                if isinstance(error, SilentLineError):
                    raise LinkError(f"arm: {who} speaks; {SILENT}") from error
                if not _heals(error):
                    raise
                last = error
                await self._drain()
                if attempt and isinstance(error, ReplyTimeoutError):
                    raise LinkError(f"arm: {who} speaks; {SILENT}") from error
        raise last

    async def _greet(self, allow_restart: bool) -> Ip:
        try:
            await self._exchange(encode_simple(Simple.TOGGLE_OFF))
        except PositionLostError:
            if not allow_restart:
                raise
        try:
            ip = await self._identify()
        except PositionLostError:
            if not allow_restart:
                raise
            self._has_given_go = True
            await self._exchange(encode_simple(Simple.GO))
            ip = await self._identify()
        if allow_restart:
            await self._expect_rest()
        return ip

    async def _expect_rest(self) -> None:
        """Stop what moves while the line is opened: no motion has been commanded yet."""
        request = encode_simple(Simple.GENERAL_STATUS)
        reply = await self._exchange(request)
        assert isinstance(reply, Status)
        if reply.bits & StatusBits.MOVING:
            await self._stop_stray(request, bytes([Simple.GENERAL_STATUS, reply.bits]))

    async def _drain(self) -> None:
        """Discard input until the line is silent; text in it means an unknown ROM (§8.7).

        Silence is longer than the 8 ms after which an IP gives up on a broken request (§2.9).
        """
        clock = self._clock
        if self._owes_reply:  # the line has been silent for much longer than that already
            if not (data := await self._transport.read(0)):
                return
            self._suspect += data
        # every opening waits this long, so it is kept short
        silence_s = max(c.SILENCE_S, _MIN_SILENCE_WALL_S * clock.speed)
        until_s = clock.attended_s() + max(_DRAIN_LIMIT_S, 10 * silence_s)
        silent_at_s = clock.attended_s() + silence_s
        while (left_s := silent_at_s - clock.attended_s()) > 0:
            if data := await self._transport.read(clock.to_wall_s(left_s)):
                silent_at_s = clock.attended_s() + silence_s
                self._suspect += data
                if clock.attended_s() > until_s:
                    raise BadReplyError("arm: the line never falls silent")
        if looks_like_text(self._suspect):
            raise WrongDeviceError(
                f"arm: unsupported ROM or monitor mode: it answered {self._suspect[:60]!r}"
            )
        self._suspect = b""

    async def _resync(self) -> None:
        """Find out which IP listens and that both still run (§1.7); moves nothing."""
        self._listening = None
        for _ in range(_ATTEMPT_COUNT):
            await self._drain()
            try:
                await self._identify()
                await self._drain()
                break
            except DeviceError as error:
                if not _heals(error):
                    raise
                last = error
        else:
            if isinstance(last, ReplyTimeoutError):
                raise LinkError(f"arm: {SILENT}") from last
            raise last
        await self._meet_both(allow_restart=False)
        self._owes_reply = False
        log.warning("the line to the arm is back in step, IP%d listens", self._listening)

    # ---- transactions --------------------------------------------------------------------------
    async def _exchange_all(
        self,
        ip: Ip,
        frames: tuple[bytes, ...],
        repeats: bool,
        guard: Guard | None,
        proves: bool = False,
    ) -> tuple[Reply, ...]:
        for _ in range(_ATTEMPT_COUNT):
            try:
                await self._settle()
                await self._select(ip)
                if proves:
                    await self._prove(ip)
                replies = []
                for frame in frames:
                    if guard is not None:
                        guard()
                    replies.append(await self._exchange(frame))
                return tuple(replies)
            except DeviceError as error:
                if isinstance(error, PositionLostError):
                    self._listening = None
                if isinstance(error, SilentLineError):
                    await self._halt_blindly(encode_simple(Simple.DEAD_STOP))
                if isinstance(error, LineUncertainError):
                    log.warning("in doubt: %s", error)
                    await self._end_uncertainty()
                    raise
                if not breaks_step(error):
                    raise
                log.warning("out of step: %s", error)
                await self._resync()
                if not repeats:
                    raise
                last = error
        raise last

    async def _settle(self) -> None:
        """Make sure that no late reply to an earlier request is left on the line."""
        await self._pace()
        if stale := await self._transport.read(0):
            await self._judge_stale(stale)
            await self._resync()

    async def _end_uncertainty(self) -> None:
        """Find out which IP listens, and wait until both rest; that IP has been stopped before."""
        await self._resync()
        await self._halt(encode_simple(Simple.DEAD_STOP), verifies=True)

    async def _halt(self, request: bytes, verifies: bool) -> None:
        first = self._listening if self._listening is not None else Ip.ARM
        failures: list[DeviceError] = []
        for ip in (first, first.other):
            try:
                await self._halt_one(ip, request)
            except SilentLineError:
                await self._halt_blindly(request)
                raise
            except DeviceError as error:
                log.warning("the stop of IP%d: %s", ip, error)
                failures.append(error)
        if verifies and not failures:
            for ip in (first.other, first):
                await self._see_at_rest(ip, request)
        # a lost position matters longer than a line error, so it is raised first
        failures.sort(key=lambda error: not isinstance(error, PositionLostError))
        if failures:
            raise failures[0]

    async def _halt_one(self, ip: Ip, request: bytes) -> None:
        lost: PositionLostError | None = None
        for _ in range(_ATTEMPT_COUNT):
            try:
                await self._ask_to_halt(ip, request)
                break
            except PositionLostError as error:
                # an IP that has restarted does not hand the line over (§1.5): without GO, the
                # other IP could not be stopped; GO alone leaves its motors without power (§8.10)
                lost = error
                await self._exchange(encode_simple(Simple.GO))
        if lost is not None:
            raise lost

    async def _ask_to_halt(self, ip: Ip, request: bytes) -> None:
        """Send a stop to one IP; uncertainty on the way is no reason to leave it moving."""
        for _ in range(_ATTEMPT_COUNT):
            try:
                await self._settle()
                await self._select(ip)
                await self._exchange(request)
                return
            except DeviceError as error:
                if not _heals(error):
                    raise
                log.warning("out of step: %s", error)
                last = error
                await self._resync()
        raise last

    async def _see_at_rest(self, ip: Ip, request: bytes) -> None:
        """Wait until nothing of an IP moves; if a stop had no effect, send a dead stop."""
        is_ramp = request == encode_simple(Simple.RAMP_STOP)
        limit_s = self._clock.patience_s(_RAMP_LIMIT_S if is_ramp else _DEAD_STOP_LIMIT_S)
        general_status = encode_simple(Simple.GENERAL_STATUS)
        for _ in range(_ATTEMPT_COUNT):
            until_s = self._clock.attended_s() + limit_s
            while True:
                replies = await self._exchange_all(ip, (general_status,), repeats=True, guard=None)
                assert isinstance(replies[0], Status)
                if not replies[0].bits & StatusBits.MOVING:
                    return
                if self._clock.attended_s() > until_s:
                    break
                if not is_ramp:
                    await self._halt_one(ip, request)
            log.warning("IP%d moves after its stop", ip)
            is_ramp, limit_s = False, self._clock.patience_s(_DEAD_STOP_LIMIT_S)
            request = encode_simple(Simple.DEAD_STOP)
            await self._halt_one(ip, request)
        raise BadReplyError(f"arm: IP{ip:d} moves after its stop: press the emergency stop")

    async def _halt_blindly(self, request: bytes) -> None:
        """Send a stop to the listening IP, hand over, and send it again; read no answer."""
        self._listening = None
        for blind in (request, encode_simple(Simple.TOGGLE_ONCE), request):
            await self._pace()
            self._last_start_s = self._clock.now_s()
            self._last_request = blind
            self._transport.write(blind)
