"""The line to the arm: one transaction at a time, in step, and always the right IP listening.

Follows umi_rtx.md 1.4 (handing the line over, non-toggle mode), §1.6 (opening) and §1.7 (back in
step after a lost, short or long reply). It knows no motor: what a request does to the metal is the
caller's business, and so is repeating anything but a read.

Sections (§) are those of umi_rtx.md.
"""

import logging
from collections.abc import Callable
from contextlib import suppress
from typing import Final

from drivers.clock import CellClock
from drivers.errors import (
    BadReplyError,
    DeviceError,
    LinkError,
    PositionLostError,
    ReplyTimeoutError,
    SilentLineError,
    WrongDeviceError,
)
from drivers.tasks import run_to_end
from drivers.wires import LineTap
from messages import key, say

from ..protocol.codec import (
    Identity,
    Reply,
    Status,
    Version,
    encode_simple,
)
from ..protocol.constants import Ip, Simple, StatusBits
from ._tasks import Turns
from ._transport import Transport
from ._wire import SILENT, LineUncertainError, LinkConfig, Trace, Wire, breaks_step

log = logging.getLogger(__name__)

_ATTEMPT_COUNT: Final = 3  # §1.7
_DEAD_STOP_LIMIT_S: Final = 0.1  # a stopped board shows standstill within this time
_RAMP_LIMIT_S: Final = 0.6  # 7: a ramp takes 0.25 s

Guard = Callable[[], None]


class _StopFirstError(Exception):
    """A stop waits for the line; the request has had no effect and is sent again."""


def _heals(error: DeviceError) -> bool:
    """Return whether the link can go on by finding out again which IP listens."""
    return breaks_step(error) or isinstance(error, LineUncertainError)


class Link:
    """The line of both IPs.

    Parameters
    ----------
    transport : bytes to and from the arm
    clock : the cell's clock, by which requests are spaced and replies given up
    config : timing of the line
    trace : called with every exchange on the wire
    tap : tap of the line, None for none
    """

    def __init__(
        self,
        transport: Transport,
        clock: CellClock,
        config: LinkConfig | None = None,
        trace: Trace | None = None,
        tap: LineTap | None = None,
    ) -> None:
        self._clock = clock
        self._wire = Wire(transport, clock, config or LinkConfig(), trace)
        self._turns = Turns(tap)
        self._has_given_go = False  # to the IP that is being greeted
        self._found: list[Status] = []  # by the IPs as they were stopped on opening
        self._found_first: Ip | None = None

    @property
    def listening(self) -> Ip | None:
        """The IP that hears the next request, if known."""
        return self._wire.listening

    async def open(self, look: bytes = b"") -> frozenset[Ip]:
        """Bring both IPs to running, non-toggle mode (§1.6, steps 1-6); return the restarted ones.

        Before anything is found out, both get a dead stop: the arm may still move (§8.20).

        Parameters
        ----------
        look : status request to both right before their stop, which may clear what it reports;
            `found` returns the answers. Empty for none

        Raises
        ------
        LinkError : an IP is silent
        WrongDeviceError : text instead of the protocol (§8.7), or twice the same IP
        BadReplyError : bytes that make no sense
        """
        async with self._turns.take("open the line"):
            return await run_to_end(self._open(look))

    def found(self, ip: Ip) -> Status | None:
        """Return an IP's answer on opening, before its stop; None if there was none.

        If only one of them answered, its identity is unknown: its answer then counts for either.
        """
        if len(self._found) < 2:
            return self._found[0] if self._found else None
        # the IP that was stopped last is met first, and the other one listens in the end
        return self._found[0 if ip is self._found_first else 1]

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
        what = f"IP{ip:d} " + ", ".join(frame.hex(" ").upper() for frame in frames)
        while True:
            async with self._turns.take(what):
                self._wire.listen_anew()
                work = self._exchange_all(ip, frames, repeats, guard, proves, gives_way=True)
                with suppress(_StopFirstError):
                    return await run_to_end(work)

    async def halt(self, request: bytes, *, verifies: bool = True) -> None:
        """Send a stop to BOTH IPs, ahead of all waiting requests, in any state (§2.3).

        The second IP gets its stop even if the first fails; the failure is raised afterwards. A
        silent line gets both stops all the same: perhaps it is only the way back that is cut.

        Parameters
        ----------
        request : the bytes of the stop
        verifies : check that nothing moves on either IP, and stop it again if it does
        """
        async with self._turns.take(
            say("stop {request}", request=request.hex().upper()), urgent=True
        ):
            self._wire.listen_anew()
            await run_to_end(self._halt(request, verifies))

    async def aclose(self) -> None:
        """Release the line."""
        await self._wire.aclose()

    # ---- who listens ---------------------------------------------------------------------------
    async def _identify(self) -> Ip:
        reply = await self._wire.exchange(encode_simple(Simple.IDENTIFY))
        assert isinstance(reply, Identity)  # the reader lets nothing else through
        return reply.ip

    async def _who(self) -> Ip:
        """Return the listening IP, by the one query safe under any single-bit error (ADR 15)."""
        for _ in range(_ATTEMPT_COUNT):
            try:
                reply = await self._wire.exchange(encode_simple(Simple.VERSION))
                assert isinstance(reply, Version)
                return reply.ip
            except DeviceError as error:
                if not breaks_step(error):
                    raise
                last = error
                await self._wire.drain()
        raise last

    async def _select(self, ip: Ip, *, gives_way: bool = False) -> None:
        """Make `ip` listen; a hand-over is not repeated before checking which IP listens (§1.7)."""
        if self._wire.listening is None:
            await self._resync()
        for _ in range(_ATTEMPT_COUNT):
            if self._wire.listening is ip:
                return
            if gives_way:
                self._give_way()
            await self._hand_over(to=ip)
        raise BadReplyError(say("arm: IP{ip:d} does not take the line", ip=ip))

    async def _hand_over(self, to: Ip) -> None:
        """Hand the line over once, and check which board has it: an acknowledgement proves nothing.

        Raises
        ------
        LineUncertainError : acknowledged, and the same IP listens: something else was carried out
        """
        self._wire.listening = None
        request = encode_simple(Simple.TOGGLE_ONCE)
        is_acknowledged = True
        try:
            await self._wire.exchange(request)
        except DeviceError as error:
            if not breaks_step(error):
                raise
            is_acknowledged = 0x00 in self._wire.suspect
            await self._wire.drain()
        who = await self._who()
        if who is not to and is_acknowledged:
            await self._wire.stop_stray(request, b"\x00")
        self._wire.listening = who

    async def _prove(self, ip: Ip) -> None:
        """Make sure that `ip` listens, right before a request that moves metal."""
        if (who := await self._who()) is not ip:
            await self._wire.stop_stray(self._wire.last_request, bytes([0x20 | who]))

    # ---- opening, and back in step -------------------------------------------------------------
    async def _open(self, look: bytes) -> frozenset[Ip]:
        self._wire.suspect = b""
        await self._wire.drain()
        is_first_there = await self._stop_as_found(look)
        restarted = await self._meet_both(
            allow_restart=True,
            who=key("no IP beside the one that took the first stop")
            if is_first_there
            else key("neither IP"),
        )
        self._found_first = self._wire.listening
        return restarted

    async def _stop_as_found(self, look: bytes) -> bool:
        """Dead-stop both IPs before their state is known; return whether one handed over.

        A host that was killed leaves axes moving (§8.20), and meeting both IPs takes 0.2 s. Silence
        has put the line in step (§2.9), and a stop harms neither IP. Axes that this stop does not
        reach are found moving, and stopped, when their IP is met: a board behind a restarted one,
        or behind one that toggles automatically.
        """
        stop = encode_simple(Simple.DEAD_STOP)
        strike = (look, stop) if look else (stop,)
        has_handed_over = False
        self._found = []
        try:
            for request in (*strike, encode_simple(Simple.TOGGLE_ONCE), *strike):
                reply = await self._wire.exchange(request)
                if isinstance(reply, Status):
                    self._found.append(reply)
                has_handed_over = has_handed_over or request not in strike
        except PositionLostError:
            pass  # a restarted IP has no power, and does not hand the line over (§1.5)
        except DeviceError as error:
            if not (_heals(error) or isinstance(error, SilentLineError)):
                raise
            log.warning("the stop of both boards on opening: %s; now blindly", error)
            await self._halt_blindly(stop)
            await self._wire.drain()
        return has_handed_over

    async def _meet_both(
        self, *, allow_restart: bool, who: str = key("neither IP")
    ) -> frozenset[Ip]:
        """Meet the listening IP, hand over, meet the other one (§1.6, steps 2-6).

        A silent line is reported as ``who`` that speaks.
        """
        self._wire.listening = None
        first, first_restarted = await self._meet(allow_restart, who)
        for _ in range(2):  # a second time only if the first hand-over did not take place
            try:
                await self._wire.exchange(encode_simple(Simple.TOGGLE_ONCE))
            except DeviceError as error:
                if not _heals(error):
                    raise
                await self._wire.drain()
            second, second_restarted = await self._meet(
                allow_restart, say("no IP beside IP{first:d}", first=first)
            )
            if second is not first:
                self._wire.listening = second
                restarted = {first: first_restarted, second: second_restarted}
                return frozenset(ip for ip, was_restarted in restarted.items() if was_restarted)
            first_restarted = first_restarted or second_restarted
        raise WrongDeviceError(say("arm: both boards answer as IP{first:d}", first=first))

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
                    raise LinkError(
                        say("arm: {who} speaks; {silent}", who=who, silent=SILENT)
                    ) from error
                if not _heals(error):
                    raise
                last = error
                await self._wire.drain()
                if attempt and isinstance(error, ReplyTimeoutError):
                    raise LinkError(
                        say("arm: {who} speaks; {silent}", who=who, silent=SILENT)
                    ) from error
        raise last

    async def _greet(self, allow_restart: bool) -> Ip:
        try:
            await self._wire.exchange(encode_simple(Simple.TOGGLE_OFF))
        except PositionLostError:
            if not allow_restart:
                raise
        try:
            ip = await self._identify()
        except PositionLostError:
            if not allow_restart:
                raise
            self._has_given_go = True
            await self._wire.exchange(encode_simple(Simple.GO))
            ip = await self._identify()
        if allow_restart:
            await self._expect_rest()
        return ip

    async def _expect_rest(self) -> None:
        """Stop any motion while the line is opened: none has been commanded yet."""
        request = encode_simple(Simple.GENERAL_STATUS)
        reply = await self._wire.exchange(request)
        assert isinstance(reply, Status)
        if reply.bits & StatusBits.MOVING:
            await self._wire.stop_stray(request, bytes([Simple.GENERAL_STATUS, reply.bits]))

    async def _resync(self) -> None:
        """Find out which IP listens and that both still run (§1.7); moves nothing."""
        self._wire.listening = None
        for _ in range(_ATTEMPT_COUNT):
            await self._wire.drain()
            try:
                await self._identify()
                await self._wire.drain()
                break
            except DeviceError as error:
                if not _heals(error):
                    raise
                last = error
        else:
            if isinstance(last, ReplyTimeoutError):
                raise LinkError(say("arm: {silent}", silent=SILENT)) from last
            raise last
        await self._meet_both(allow_restart=False)
        self._wire.owes_reply = False
        log.warning("the line to the arm is back in step, IP%d listens", self._wire.listening)

    # ---- transactions --------------------------------------------------------------------------
    async def _exchange_all(
        self,
        ip: Ip,
        frames: tuple[bytes, ...],
        repeats: bool,
        guard: Guard | None,
        proves: bool = False,
        *,
        gives_way: bool = False,
    ) -> tuple[Reply, ...]:
        for _ in range(_ATTEMPT_COUNT):
            try:
                await self._settle()
                await self._select(ip, gives_way=gives_way)
                if proves:
                    await self._prove(ip)
                replies: list[Reply] = []
                for frame in frames:
                    if gives_way and (repeats or not replies):
                        self._give_way()
                    if guard is not None:
                        guard()
                    replies.append(await self._wire.exchange(frame))
                return tuple(replies)
            except DeviceError as error:
                if isinstance(error, PositionLostError):
                    self._wire.listening = None
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

    def _give_way(self) -> None:
        """Raise _StopFirstError if a stop waits: called between whole steps only."""
        if self._turns.is_stop_waiting:
            raise _StopFirstError

    async def _settle(self) -> None:
        """Make sure that no late reply to an earlier request is left on the line."""
        if not await self._wire.is_clean():
            await self._resync()

    async def _end_uncertainty(self) -> None:
        """Find out which IP listens, and wait until both rest; that IP has been stopped before."""
        await self._resync()
        await self._halt(encode_simple(Simple.DEAD_STOP), verifies=True)

    async def _halt(self, request: bytes, verifies: bool) -> None:
        first = self._wire.listening if self._wire.listening is not None else Ip.ARM
        failures: list[DeviceError] = []
        is_proven = await self._strike(request)
        for ip in () if is_proven else (first, first.other):
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

    async def _strike(self, request: bytes) -> bool:
        """Send a stop, hand over, send it again; return whether it is proven to reach both IPs.

        The listening board is found out only afterwards: each query before a stop takes 9 ms, and a
        stop harms neither IP (ADR 15). After any error here, both have to be stopped one by one.
        """
        before, self._wire.listening = self._wire.listening, None
        toggle = encode_simple(Simple.TOGGLE_ONCE)
        try:
            if not await self._wire.is_clean():
                return False
            for blind in (request, toggle, request):
                await self._wire.exchange(blind)
            who = await self._who()
            if before is None:
                return False
            if who is before:
                await self._wire.stop_stray(toggle, b"\x00")
        except SilentLineError:
            await self._halt_blindly(request)
            raise
        except DeviceError as error:
            if not (_heals(error) or isinstance(error, PositionLostError)):
                raise
            log.warning("a stop of both boards: %s; now one by one", error)
            return False
        self._wire.listening = who
        return True

    async def _halt_one(self, ip: Ip, request: bytes) -> None:
        lost: PositionLostError | None = None
        for _ in range(_ATTEMPT_COUNT):
            try:
                await self._request_halt(ip, request)
                break
            except PositionLostError as error:
                # an IP that has restarted does not hand the line over (§1.5): without GO, the
                # other IP could not be stopped; GO alone leaves its motors without power (§8.10)
                lost = error
                await self._wire.exchange(encode_simple(Simple.GO))
        if lost is not None:
            raise lost

    async def _request_halt(self, ip: Ip, request: bytes) -> None:
        """Send a stop to one IP; uncertainty on the way is no reason to leave it moving."""
        for _ in range(_ATTEMPT_COUNT):
            try:
                await self._settle()
                await self._select(ip)
                await self._wire.exchange(request)
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
        raise BadReplyError(
            say("arm: IP{ip:d} moves after its stop: press the emergency stop", ip=ip)
        )

    async def _halt_blindly(self, request: bytes) -> None:
        """Send a stop to the listening IP, hand over, and send it again; read no answer."""
        self._wire.listening = None
        for blind in (request, encode_simple(Simple.TOGGLE_ONCE), request):
            await self._wire.send_blindly(blind)
