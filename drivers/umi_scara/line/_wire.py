"""One request and its reply: paced, timed, and stopped if it may have become another command.

Follows umi_rtx.md 1.2 (pacing) and §1.7 (what a missing or strange reply means). A request carries
no checksum, so that one wrong bit can make another command of it (ADR 15). A reply that another
command may have caused is answered with a dead stop before anything else.

Sections (§) are those of umi_rtx.md.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NoReturn

from drivers import terminals
from drivers.clock import CellClock
from drivers.errors import (
    BadReplyError,
    DeviceError,
    PositionLostError,
    RefusedError,
    ReplyTimeoutError,
    SilentLineError,
    WrongDeviceError,
)
from messages import key, say

from ..protocol import constants as c
from ..protocol.codec import Reply, ReplyReader, encode_simple, is_go, is_query, looks_like_text
from ..protocol.constants import Ip, Simple
from ._transport import Transport

wire_log = logging.getLogger("cellctl.wire.arm")

SILENT: Final = key("nothing answers: check power, cable, boards")  # §8.8
_ATTEMPT_COUNT: Final = 3  # §2.9, for queries
_CHECK: Final = key("check power, cable, boards")
_STAY_AWAY: Final = key(
    "whether the arm has stopped is unknown, and a motion that was started may go on to its "
    "target. Press the emergency stop if anything moves, then"
)
_STRAY_STOP_COUNT: Final = 12  # 0.1 s
_DRAIN_LIMIT_S: Final = 2.0  # longest time for which an arm sends
_WAYS: Final = 2  # ways through the kernel: of a request, of its reply
_ANSWER_WALL_S: Final = 0.1  # time for the arm to answer, and for the driver to read, after each
# A busy host delivers bytes a little late, however fast the cell's clock runs.
_MIN_SILENCE_WALL_S: Final = 0.02


@dataclass(frozen=True, slots=True)
class WireExchange:
    """One request and the reply to it.

    Attributes
    ----------
    at_s : instant of the request [cell s]
    ip : the IP that is taken to listen; None if that is unknown
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
            raise ValueError(
                f"spacing_s: {self.spacing_s} s between requests, the arm wants at least "
                f"{c.MIN_SPACING_S} s (umi_rtx.md 1.2)"
            )


Trace = Callable[[WireExchange], None]


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


def may_be_another_command(request: bytes, received: bytes) -> bool:
    """Return whether another command may have run, by the bytes received (ADR 15).

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


class Wire:
    """The bytes on the line, one exchange after another.

    Parameters
    ----------
    transport : bytes to and from the arm
    clock : the cell's clock, by which requests are spaced and replies given up
    config : timing of the line
    trace : called with every exchange on the wire

    Attributes
    ----------
    listening : the IP that hears the next request; None if that is unknown
    last_request : the request sent last
    owes_reply : a reply that timed out may still come
    suspect : the bytes of the last reply that made no sense
    """

    def __init__(
        self, transport: Transport, clock: CellClock, config: LinkConfig, trace: Trace | None
    ) -> None:
        self._transport = transport
        self._clock = clock
        self._config = config
        self._trace = trace
        self.listening: Ip | None = None
        self.last_request = b""
        self.owes_reply = False
        self.suspect = b""
        self._last_start_s = float("-inf")
        self._mute_since_s: float | None = None
        self._is_silent = False  # the last transaction ended in silence
        self._heard_nothing = False

    async def aclose(self) -> None:
        """Release the transport."""
        await self._transport.aclose()

    def listen_anew(self) -> None:
        """Start timing silence; a line that was silent before gets one more try, not three."""
        self._mute_since_s = None
        self._heard_nothing, self._is_silent = self._is_silent, False

    async def exchange(self, request: bytes) -> Reply:
        """Send one request, return its reply; repeat a query after 01, 02 or 04 (§2.9).

        Raises
        ------
        ReplyTimeoutError, BadReplyError : done or not is unknown
        LineUncertainError : something else may have been done; the listening IP was stopped
        SilentLineError : nothing has come back for `LinkConfig.silence_s`
        RefusedError : the IP's own no, with its code (§2.9)
        PositionLostError : the IP has restarted (§1.5)
        """
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
            raise BadReplyError(say("arm: {stale} came unasked", stale=stale.hex(" ").upper()))
        started_s = self._last_start_s = self._clock.now_s()
        ip = self.listening
        reader = ReplyReader(request)
        self.last_request = request
        self._transport.write(request)
        try:
            return await self._read(reader, request)
        except PositionLostError:
            raise
        except (BadReplyError, ReplyTimeoutError, RefusedError) as error:
            self.suspect = reader.data if isinstance(error, BadReplyError) else b""
            is_busy = isinstance(error, RefusedError) and error.code == c.AXIS_BUSY
            if not is_busy and not self.owes_reply and may_be_another_command(request, reader.data):
                await self.stop_stray(request, reader.data)
            raise
        finally:
            wire_log.debug("%s -> %s", request.hex(" ").upper(), reader.data.hex(" ").upper())
            if self._trace is not None:
                self._trace(WireExchange(started_s, ip, request, reader.data))

    async def _judge_stale(self, stale: bytes) -> None:
        """Raise LineUncertainError if unasked bytes came: something may have run that nobody sent.

        An arm sends nothing by itself. It answers noise on the line between two exchanges as
        commands, and an acknowledgement need not come first. Only if a reply that timed out is
        still owed, bytes are taken for it.
        """
        self.suspect = stale
        is_owed, self.owes_reply = self.owes_reply, False
        if not is_owed:
            await self.stop_stray(self.last_request, stale)

    async def stop_stray(self, request: bytes, received: bytes) -> NoReturn:
        """Dead-stop the listening IP before anything else; raise LineUncertainError.

        The stop is sent many times: a late byte may still arrive, take the next two for its data
        and move something by a step (§2.7).

        Parameters
        ----------
        request : request sent
        received : the bytes that came back, and fit another command

        Raises
        ------
        LineUncertainError : always
        """
        self.listening = None
        for _ in range(_STRAY_STOP_COUNT):
            await self._pace()
            await self._transport.read(0)
            self._last_start_s = self._clock.now_s()
            self._transport.write(encode_simple(Simple.DEAD_STOP))
        raise LineUncertainError(
            say(
                "arm: {received} came back for {request}: it may have reached the "
                "arm as another command; both boards were stopped",
                received=received.hex(" ").upper(),
                request=request.hex(" ").upper(),
            ),
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
            else:
                data = await self._look_again()
            if data:
                self._mute_since_s, self._heard_nothing = None, False
                if (reply := reader.feed(data)) is not None:
                    return reply
            elif left_s <= 0:
                break
        if self._mute_since_s is not None:
            mute_s = clock.attended_s() - self._mute_since_s
            if self._heard_nothing or mute_s >= self._silence_limit_s() - 1e-6:
                self._is_silent, self.listening = True, None
                raise SilentLineError(
                    say(
                        "arm: no byte came back for {mute_s:.2f} s (last request "
                        "{request}): {stay_away} {check}",
                        mute_s=mute_s,
                        request=request.hex(" ").upper(),
                        stay_away=_STAY_AWAY,
                        check=_CHECK,
                    )
                )
        self.owes_reply = self.owes_reply or not reader.data
        got = say("only {data} of a", data=reader.data.hex(" ").upper()) if reader.data else "no"
        raise ReplyTimeoutError(
            say(
                "arm: {got} reply to {request} within {reply_timeout_s:.3f} s",
                got=got,
                request=request.hex(" ").upper(),
                reply_timeout_s=self._config.reply_timeout_s,
            )
        )

    async def _look_again(self) -> bytes:
        """Return the bytes still on their way through the kernel, which count as in time.

        On a clock that can be held, a request and its reply both have to get through a kernel that
        other programs keep busy. One who answers has some time for it after the first.
        """
        with self._clock.held() as look_wall_s:
            data = await self._transport.read(look_wall_s)
            for _ in range(_WAYS if look_wall_s > 0.0 else 0):
                if data:
                    break
                await terminals.through_the_kernel()
                data = await self._transport.read(_ANSWER_WALL_S)
        return data

    def _silence_limit_s(self) -> float:
        """Return the longest silence of the line [cell s]; two tries fit in on any host."""
        reply_s = self._clock.patience_s(self._config.reply_timeout_s)
        return self._config.silence_s if 1.6 * reply_s <= self._config.silence_s else 2 * reply_s

    async def drain(self) -> None:
        """Discard input until the line is silent; text in it means an unknown ROM (§8.7).

        Silence is longer than the 8 ms after which an IP gives up on a broken request (§2.9).

        Raises
        ------
        BadReplyError : the line never falls silent
        WrongDeviceError : text instead of the protocol
        """
        clock = self._clock
        if self.owes_reply:  # the line has been silent for much longer than that already
            if not (data := await self._transport.read(0)):
                return
            self.suspect += data
        # every opening waits this long, so it is kept short
        silence_s = max(c.SILENCE_S, _MIN_SILENCE_WALL_S * clock.speed)
        until_s = clock.attended_s() + max(_DRAIN_LIMIT_S, 10 * silence_s)
        silent_at_s = clock.attended_s() + silence_s
        while (left_s := silent_at_s - clock.attended_s()) > 0:
            if data := await self._transport.read(clock.to_wall_s(left_s)):
                silent_at_s = clock.attended_s() + silence_s
                self.suspect += data
                if clock.attended_s() > until_s:
                    raise BadReplyError(key("arm: the line never falls silent"))
        if looks_like_text(self.suspect):
            raise WrongDeviceError(
                say(
                    "arm: unsupported ROM or monitor mode: it answered {suspect}",
                    suspect=repr(self.suspect[:60]),
                )
            )
        self.suspect = b""

    async def is_clean(self) -> bool:
        """Wait for the next request's turn; return whether the line has been silent since the last.

        Raises
        ------
        LineUncertainError : the reply may belong to a command that nobody sent
        """
        await self._pace()
        if not (stale := await self._transport.read(0)):
            return True
        await self._judge_stale(stale)
        return False

    async def send_blindly(self, request: bytes) -> None:
        """Send a request without waiting for its reply."""
        await self._pace()
        self._last_start_s = self._clock.now_s()
        self.last_request = request
        self._transport.write(request)
