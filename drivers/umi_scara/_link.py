"""The line to the arm: one request in flight, paced, in step, and always the right IP listening.

Follows umi_rtx.md 1.2 (pacing), 1.4 (handing the line over, non-toggle mode), 1.6 (opening) and
1.7 (back in step after a lost, short or long reply). It knows no motor: what a request does to
the metal is the caller's business, and so is repeating anything but a read.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from drivers.clock import CellClock
from drivers.errors import (
    BadReplyError,
    DeviceError,
    LinkError,
    PositionLostError,
    RefusedError,
    ReplyTimeoutError,
    WrongDeviceError,
)

from . import _constants as c
from ._codec import Identity, Reply, ReplyReader, encode_simple, looks_like_text
from ._constants import Ip, Simple
from ._tasks import Turns, run_to_end
from ._transport import Transport

log = logging.getLogger(__name__)
wire_log = logging.getLogger("cellctl.wire.arm")

SILENT: Final = "nothing answers: check power, cable, boards"  # 8.8
_ATTEMPT_COUNT: Final = 3  # 1.7
_DRAIN_LIMIT_S: Final = 2.0  # a line that talks longer than that is no arm's
# A host that is busy delivers what has arrived a little late, however fast the cell's clock runs.
_MIN_SILENCE_WALL_S: Final = 0.02


@dataclass(frozen=True, slots=True)
class WireExchange:
    """One request and what came back for it.

    Attributes
    ----------
    at_s : instant of the request [cell s]
    ip : the IP that the link believes to listen; None where it does not know
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
    spacing_s : start of request to start of request; the arm wants 8 ms (1.2), and a USB adapter
        sends in frames of 1 ms, so that what leaves 9 ms apart arrives at least 8 ms apart
    reply_timeout_s : a reply is complete by then, or lost (1.2)
    """

    spacing_s: float = c.MIN_SPACING_S + 0.001
    reply_timeout_s: float = c.REPLY_TIMEOUT_S

    def __post_init__(self) -> None:
        if self.spacing_s < c.MIN_SPACING_S:
            raise ValueError(f"the arm wants {c.MIN_SPACING_S} s between requests (1.2)")


Trace = Callable[[WireExchange], None]
Guard = Callable[[], None]


def breaks_step(error: DeviceError) -> bool:
    """Tell whether an error leaves it open what the arm and the host have heard (2.9)."""
    if isinstance(error, RefusedError):
        return error.code in c.FRAME_CODES
    return isinstance(error, ReplyTimeoutError | BadReplyError)


class Link:
    """The line, over a transport, on the cell's clock; `trace` sees every exchange."""

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
        self._suspect = b""  # what a reply that made no sense consisted of

    @property
    def listening(self) -> Ip | None:
        """The IP that hears the next request, where that is known."""
        return self._listening

    async def open(self) -> frozenset[Ip]:
        """Bring both IPs to running, non-toggle mode (1.6, steps 1-6); return the restarted ones.

        Raises
        ------
        LinkError : an IP is silent
        WrongDeviceError : text instead of the protocol (8.7), or twice the same IP
        BadReplyError : bytes that make no sense
        """
        async with self._turns.take():
            return await run_to_end(self._open())

    async def ask(
        self, ip: Ip, *frames: bytes, repeats: bool = False, guard: Guard | None = None
    ) -> tuple[Reply, ...]:
        """Send requests to one IP without anything in between; return their replies.

        Parameters
        ----------
        repeats : the frames only read, so that they may be sent again after a resync
        guard : called right before each request; what it raises keeps the request from going out

        Raises
        ------
        ReplyTimeoutError, BadReplyError : done or not is unknown; the line is back in step
        RefusedError : the IP's own no, with its code (2.9)
        PositionLostError : an IP has restarted (1.5)
        LinkError : the line could not be brought back in step
        """
        async with self._turns.take():
            return await run_to_end(self._ask(ip, frames, repeats, guard))

    async def halt(self, request: bytes) -> None:
        """Send a stop to BOTH IPs, ahead of all that waits, whatever state they are in (2.3).

        The second IP gets its stop even if the first fails; the failure is raised afterwards.
        """
        async with self._turns.take(urgent=True):
            await run_to_end(self._halt(request))

    async def aclose(self) -> None:
        """Let go of the line."""
        await self._transport.aclose()

    # ---- one exchange --------------------------------------------------------------------------
    async def _exchange(self, request: bytes) -> Reply:
        """Send one request and read its reply, patient with codes 01, 02 and 04 (2.9)."""
        for _ in range(_ATTEMPT_COUNT):
            try:
                return await self._exchange_once(request)
            except RefusedError as error:
                if error.code not in c.RETRY_CODES:
                    raise
                last = error
                await self._clock.sleep(c.BUSY_RETRY_S)
        raise last

    async def _exchange_once(self, request: bytes) -> Reply:
        await self._pace()
        if stale := await self._transport.read(0):
            self._suspect = stale
            raise BadReplyError(f"arm: {stale.hex(' ').upper()} came unasked")
        started_s = self._last_start_s = self._clock.now_s()
        ip = self._listening
        reader = ReplyReader(request)
        self._transport.write(request)
        try:
            return await self._read(reader, request)
        except BadReplyError:
            self._suspect = reader.data
            raise
        finally:
            wire_log.debug("%s -> %s", request.hex(" ").upper(), reader.data.hex(" ").upper())
            if self._trace is not None:
                self._trace(WireExchange(started_s, ip, request, reader.data))

    async def _pace(self) -> None:
        due_s = self._last_start_s + self._config.spacing_s
        while (left_s := due_s - self._clock.now_s()) > 0:
            await self._clock.sleep(left_s)

    async def _read(self, reader: ReplyReader, request: bytes) -> Reply:
        until_s = self._clock.attended_s() + self._clock.patience_s(self._config.reply_timeout_s)
        while True:
            left_s = until_s - self._clock.attended_s()
            # at the end, what has arrived is taken in before it counts as missing
            data = await self._transport.read(max(0.0, self._clock.to_wall_s(left_s)))
            if data and (reply := reader.feed(data)) is not None:
                return reply
            if not data and left_s <= 0:
                break
        got = f"only {reader.data.hex(' ').upper()} of a" if reader.data else "no"
        raise ReplyTimeoutError(
            f"arm: {got} reply to {request.hex(' ').upper()} "
            f"within {self._config.reply_timeout_s:.3f} s"
        )

    # ---- who listens ---------------------------------------------------------------------------
    async def _identify(self) -> Ip:
        reply = await self._exchange(encode_simple(Simple.IDENTIFY))
        assert isinstance(reply, Identity)  # the reader lets nothing else through
        return reply.ip

    async def _select(self, ip: Ip) -> None:
        """Have `ip` listen; a hand-over is never repeated without asking who listens (1.7)."""
        if self._listening is None:
            await self._resync()
        for _ in range(_ATTEMPT_COUNT):
            if self._listening is ip:
                return
            await self._hand_over(to=ip)
        raise BadReplyError(f"arm: IP{ip:d} does not take the line")

    async def _hand_over(self, to: Ip) -> None:
        self._listening = None
        try:
            await self._exchange(encode_simple(Simple.TOGGLE_ONCE))
            self._listening = to
        except DeviceError as error:
            if not breaks_step(error):
                raise
            await self._resync()

    # ---- opening, and back in step -------------------------------------------------------------
    async def _open(self) -> frozenset[Ip]:
        self._suspect = b""
        await self._drain()
        return await self._meet_both(allow_restart=True)

    async def _meet_both(self, *, allow_restart: bool) -> frozenset[Ip]:
        """Meet the listening IP, hand over, meet the other one (1.6, steps 2-6)."""
        self._listening = None
        first, first_restarted = await self._meet(allow_restart, "neither IP")
        for _ in range(2):  # a second time only if the first hand-over turns out not to have been
            try:
                await self._exchange(encode_simple(Simple.TOGGLE_ONCE))
            except DeviceError as error:
                if not breaks_step(error):
                    raise
                await self._drain()
            second, second_restarted = await self._meet(allow_restart, f"the IP beside IP{first:d}")
            if second is not first:
                self._listening = second
                restarted = {first: first_restarted, second: second_restarted}
                return frozenset(ip for ip, was_restarted in restarted.items() if was_restarted)
        raise WrongDeviceError(f"arm: both boards say that they are IP{first:d}")

    async def _meet(self, allow_restart: bool, who: str) -> tuple[Ip, bool]:
        """Switch off automatic toggling in whoever listens; return who it is and if it restarted.

        A restarted IP is given GO where that is allowed (1.5).
        """
        for attempt in range(_ATTEMPT_COUNT):
            try:
                return await self._greet(allow_restart)
            except DeviceError as error:
                if not breaks_step(error):
                    raise
                last = error
                await self._drain()
                if attempt and isinstance(error, ReplyTimeoutError):
                    raise LinkError(f"arm: {who} speaks; {SILENT}") from error
        raise last

    async def _greet(self, allow_restart: bool) -> tuple[Ip, bool]:
        try:
            await self._exchange(encode_simple(Simple.TOGGLE_OFF))
        except PositionLostError:
            if not allow_restart:
                raise
        try:
            return await self._identify(), False
        except PositionLostError:
            if not allow_restart:
                raise
        await self._exchange(encode_simple(Simple.GO))
        return await self._identify(), True

    async def _drain(self) -> None:
        """Discard input until the line is silent; text in it means a strange ROM (8.7).

        Silence is longer than the 8 ms after which an IP gives up on a broken request (2.9).
        """
        clock = self._clock
        # every opening waits this long: it is no time-out, to be generous with
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
                f"arm: unsupported ROM or monitor mode: it says {self._suspect[:60]!r}"
            )
        self._suspect = b""

    async def _resync(self) -> None:
        """Find out who listens and that both IPs still run (1.7); moves nothing."""
        self._listening = None
        for _ in range(_ATTEMPT_COUNT):
            await self._drain()
            try:
                await self._identify()
                await self._drain()
                break
            except DeviceError as error:
                if not breaks_step(error):
                    raise
                last = error
        else:
            if isinstance(last, ReplyTimeoutError):
                raise LinkError(f"arm: {SILENT}") from last
            raise last
        await self._meet_both(allow_restart=False)
        log.warning("the line to the arm is back in step, IP%d listens", self._listening)

    # ---- transactions --------------------------------------------------------------------------
    async def _ask(
        self, ip: Ip, frames: tuple[bytes, ...], repeats: bool, guard: Guard | None
    ) -> tuple[Reply, ...]:
        for _ in range(_ATTEMPT_COUNT):
            try:
                await self._pace()
                if await self._transport.read(0):  # an earlier exchange has left bytes behind
                    await self._resync()
                await self._select(ip)
                replies = []
                for frame in frames:
                    if guard is not None:
                        guard()
                    replies.append(await self._exchange(frame))
                return tuple(replies)
            except DeviceError as error:
                if isinstance(error, PositionLostError):
                    self._listening = None
                if not breaks_step(error):
                    raise
                log.warning("out of step: %s", error)
                await self._resync()
                if not repeats:
                    raise
                last = error
        raise last

    async def _halt(self, request: bytes) -> None:
        first = self._listening if self._listening is not None else Ip.ARM
        failures: list[DeviceError] = []
        for ip in (first, first.other):
            try:
                await self._halt_one(ip, request)
            except DeviceError as error:
                log.warning("the stop of IP%d: %s", ip, error)
                failures.append(error)
        # a lost position outlasts any trouble of the line, so it is what the caller must hear
        failures.sort(key=lambda error: not isinstance(error, PositionLostError))
        if failures:
            raise failures[0]

    async def _halt_one(self, ip: Ip, request: bytes) -> None:
        lost: PositionLostError | None = None
        for _ in range(_ATTEMPT_COUNT):
            try:
                await self._ask(ip, (request,), repeats=True, guard=None)
                break
            except PositionLostError as error:
                # an IP that has restarted does not hand the line over (1.5): without GO, the
                # other IP could not be stopped; GO alone leaves its motors without power (8.10)
                lost = error
                await self._exchange(encode_simple(Simple.GO))
        if lost is not None:
            raise lost
