"""The arm as a recording of its line: past requests and answers, for a driver of today.

A recording is of one run, and no two runs are alike: the number of polls for an arrival depends on
the host. So reads are answered with the arm's last answer to them, by the recording's time since
the last order; and orders have to be the recorded ones, in their order. The first different one
ends the recording. Nothing moves.

Sections (§) are those of umi_rtx.md.
"""

import asyncio
from bisect import bisect_left, bisect_right
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from drivers.clock import CellClock
from drivers.errors import LinkError, UnpluggedError
from drivers.wire_file import WireFileError, WireReader
from messages import say

from ..protocol import constants as c
from ..protocol.codec import is_query
from ..protocol.constants import Simple
from ._transport import Transport

_STOPS: Final = frozenset(
    bytes([stop]) for stop in (Simple.DEAD_STOP, Simple.RAMP_STOP, Simple.FREE_STOP)
)
_TOGGLE_ONCE: Final = bytes([Simple.TOGGLE_ONCE])
_TOGGLE_OFF: Final = bytes([Simple.TOGGLE_OFF])
_GO: Final = bytes([Simple.GO])
_IDENTIFY: Final = bytes([Simple.IDENTIFY])
_VERSION: Final = bytes([Simple.VERSION])
_RESTARTED: Final = b"\x0f"
_ACKNOWLEDGED: Final = b"\x00"
_USUAL_S: Final = 0.004  # delay of an answer that was not recorded in this form

Key = tuple[int, bytes, bytes]


@dataclass(frozen=True, slots=True)
class Exchanged:
    """One request of the recording, and its answer.

    Attributes
    ----------
    at_s : instant of the request [cell s]
    request, reply : bytes; no reply if none came
    took_s : until the reply was there [cell s]
    """

    at_s: float
    request: bytes
    reply: bytes
    took_s: float = _USUAL_S


@dataclass(frozen=True, slots=True)
class _Placed:
    """A request of the recording with the IP that heard it (§1.4), and the IP's selection."""

    said: Exchanged
    ip: int
    selected: bytes

    @property
    def key(self) -> Key:
        return _key(self.ip, self.said.request, self.selected)


def _key(ip: int, request: bytes, selected: bytes) -> Key:
    is_deferred = c.DEFERRED_READ <= request[0] < c.SELECT_WRITE
    return ip, request, selected if is_deferred else b""


def _is_select(request: bytes) -> bool:
    return request[0] == c.SELECT_READ


def _is_order(request: bytes) -> bool:
    """Return whether a request does more than read or hand the line over."""
    return not (is_query(request) or _is_select(request) or request in (_TOGGLE_ONCE, _TOGGLE_OFF))


def _is_restart(reply: bytes) -> bool:
    return bool(reply) and reply[0] in c.RESTARTED_CODES


class RecordedLine:
    """Both IPs as in a recording: their answers, and the requests they must get.

    A stop may come at any time; readings after an unrecorded one stay as they were then.

    Parameters
    ----------
    exchanges : exchanges of the recording, in their order
    name : name of the recording, for messages
    """

    def __init__(self, exchanges: Sequence[Exchanged], name: str) -> None:
        self._name = name
        self._placed = _placed(exchanges)
        # of each IP: which of two that wait for nothing is first depends on who listens
        self._orders: dict[int, list[int]] = {0: [], 1: []}
        self._answers: dict[Key, list[int]] = defaultdict(list)
        for i, one in enumerate(self._placed):
            if _is_order(one.said.request):
                self._orders[one.ip].append(i)
            elif one.said.reply:
                self._answers[one.key].append(i)
        self._done = {0: 0, 1: 0}  # how many of its orders each has been sent
        self._since = 0  # the exchange from which on time runs
        self._since_s: float | None = None  # and when that was, by the driver's clock
        self._stopped_s: float | None = None  # the recording's instant at a stop of its own
        self._ip = self._placed[0].ip
        self._selected = {0: b"", 1: b""}
        self._is_restarted = {ip: self._begins_restarted(ip) for ip in (0, 1)}

    def _begins_restarted(self, ip: int) -> bool:
        first = next((one.said for one in self._placed if one.ip == ip and one.said.reply), None)
        return first is not None and _is_restart(first.reply)

    def answer(self, request: bytes, now_s: float) -> tuple[bytes, float]:
        """Return the bytes that answer a request, b"" if none came, and their delay [cell s].

        Parameters
        ----------
        request : one whole request
        now_s : instant by the driver's clock [cell s]

        Raises
        ------
        UnpluggedError : it is an order, and not the recorded one; or the recording cannot tell
        """
        if self._since_s is None:
            self._since_s = now_s
        if _is_order(request):
            return self._obey(request, now_s)
        if self._is_restarted[self._ip]:
            return _RESTARTED, _USUAL_S
        if request == _TOGGLE_ONCE:
            self._ip = 1 - self._ip
            return _ACKNOWLEDGED, _USUAL_S
        if request == _TOGGLE_OFF:
            return _ACKNOWLEDGED, _USUAL_S
        if request == _IDENTIFY:
            return bytes([0x20 | self._ip]), _USUAL_S
        if _is_select(request):
            self._selected[self._ip] = request
            return bytes([0xC0 | request[0] & 0x07]), _USUAL_S
        return self._tell(request, now_s)

    def _obey(self, request: bytes, now_s: float) -> tuple[bytes, float]:
        ip, orders = self._ip, self._orders[self._ip]
        place = self._done[ip]
        while place < len(orders):
            due = self._placed[orders[place]].said
            if due.request == request:
                self._done[ip] = place + 1
                self._since, self._since_s = max(self._since, orders[place]), now_s
                self._stopped_s = None
                if request == _GO:
                    self._is_restarted[ip] = False
                return due.reply, due.took_s
            if due.request not in _STOPS:
                break
            place += 1  # a stop that is not needed today
        if request in _STOPS:
            self._stopped_s = self._instant_s(now_s)
            return _RESTARTED if self._is_restarted[ip] else _ACKNOWLEDGED, _USUAL_S
        recorded = self._placed[orders[place]].said if place < len(orders) else None
        raise UnpluggedError(_difference(self._name, ip, request, recorded))

    def _tell(self, request: bytes, now_s: float) -> tuple[bytes, float]:
        """Return the arm's latest answer by now; if none, its first answer from here on."""
        ip, orders, done = self._ip, self._orders[self._ip], self._done[self._ip]
        begin = orders[done - 1] if done else 0
        end = orders[done] if done < len(orders) else len(self._placed)
        found = self._answers.get(_key(ip, request, self._selected[ip]), [])
        low, high = bisect_left(found, begin), bisect_left(found, end)
        passed = bisect_right(
            found, self._instant_s(now_s), low, high, key=lambda i: self._placed[i].said.at_s
        )
        if low < high:
            said = self._placed[found[max(passed - 1, low)]].said
        else:
            said = self._before(request, found, low)
        self._is_restarted[ip] = _is_restart(said.reply)
        return said.reply, said.took_s

    def _before(self, request: bytes, found: Sequence[int], low: int) -> Exchanged:
        """Return the last answer before the last order; of the ROM's version, else a later one."""
        earlier = (self._placed[i].said for i in reversed(found[:low]))
        said = next((one for one in earlier if not _is_restart(one.reply)), None)
        if said is None and request == _VERSION:
            later = (self._placed[i].said for i in found[low:])
            said = next((one for one in later if not _is_restart(one.reply)), None)
        if said is None and c.CONTROLLER_STATUS <= request[0] <= Simple.GENERAL_STATUS:
            return Exchanged(0.0, request, b"")  # opening, either IP may be the one to answer it
        if said is None:
            raise UnpluggedError(
                say(
                    "arm: {name}: up to here the recording has no answer of IP{ip} to {request}",
                    name=self._name,
                    ip=self._ip,
                    request=request.hex(" ").upper(),
                )
            )
        return said

    def _instant_s(self, now_s: float) -> float:
        """Return the recording's progress [its cell s]: up to the next order at the most."""
        if self._stopped_s is not None:
            return self._stopped_s
        assert self._since_s is not None, "time runs from the first request on"
        at_s = self._placed[self._since].said.at_s + now_s - self._since_s
        due = (orders[self._done[ip] : self._done[ip] + 1] for ip, orders in self._orders.items())
        later = [self._placed[one[0]].said.at_s for one in due if one and one[0] > self._since]
        return min((at_s, *later))


def _placed(exchanges: Sequence[Exchanged]) -> list[_Placed]:
    """Return the exchanges with the IP that heard each: hand-overs turn it, identities name it."""
    ip = _first_ip(exchanges)
    placed, selected = [], {0: b"", 1: b""}
    for one in exchanges:
        if (named := _named_ip(one)) is not None:
            ip = named
        if _is_select(one.request):
            selected[ip] = one.request
        placed.append(_Placed(one, ip, selected[ip]))
        if _is_hand_over(one):
            ip = 1 - ip
    return placed


def _first_ip(exchanges: Sequence[Exchanged]) -> int:
    """Return the IP that hears the first request, counted back from the first IP named."""
    turn_count = 0
    for one in exchanges:
        if (named := _named_ip(one)) is not None:
            return (named + turn_count) % 2
        turn_count += _is_hand_over(one)
    return 0


def _named_ip(one: Exchanged) -> int | None:
    is_identity = one.request in (_IDENTIFY, _VERSION) and one.reply[:1] in (b"\x20", b"\x21")
    return one.reply[0] & 0x01 if is_identity else None


def _is_hand_over(one: Exchanged) -> bool:
    return one.request == _TOGGLE_ONCE and one.reply == _ACKNOWLEDGED


def _difference(name: str, ip: int, sent: bytes, recorded: Exchanged | None) -> str:
    now = say("IP{ip} is sent {sent}", ip=ip, sent=sent.hex(" ").upper())
    if recorded is None:
        return say("arm: {name}: the recording has ended, and {now}", name=name, now=now)
    return say(
        "arm: {name}: {now}; the recording has {request} there, at "
        "{at_s:.2f} s of its cell time. A recording answers the run that "
        "it is of, and no other",
        name=name,
        now=now,
        request=recorded.request.hex(" ").upper(),
        at_s=recorded.at_s,
    )


def exchanges_of(reader: WireReader, wire: str) -> list[Exchanged]:
    """Return the exchanges of one line of a recorded run.

    Parameters
    ----------
    reader : reader of the recording
    wire : name of the arm in the recorded cell file
    """
    found: list[Exchanged] = []
    for row in reader.rows:
        if row.wire != wire:
            continue
        if row.kind == "sent":
            found.append(Exchanged(row.at_s, reader.data(row), b""))
        elif row.kind == "got" and found:
            last = found[-1]
            reply = last.reply + reader.data(row)
            found[-1] = Exchanged(last.at_s, last.request, reply, row.at_s - last.at_s)
    return found


class RecordedArm:
    """A file of wires as the far end of an arm's line; it goes on from the last opening.

    Parameters
    ----------
    path : path of the file
    wire : name of the arm in the recorded cell file
    clock : clock of the driver
    """

    def __init__(self, path: Path, wire: str, clock: CellClock) -> None:
        self._path = path
        self._wire = wire
        self._clock = clock
        self._line: RecordedLine | None = None

    def open(self) -> Transport:
        """Return the host's end of the line.

        Raises
        ------
        LinkError : the file cannot be read, or has no arm
        """
        if self._line is None:
            try:
                reader = WireReader(self._path)
            except WireFileError as error:
                raise LinkError(say("arm: {error}", error=error)) from error
            try:
                exchanges = exchanges_of(reader, self._wire)
            finally:
                reader.close()
            if not any(one.reply for one in exchanges):
                raise LinkError(
                    say(
                        "arm: {path}: no arm was recorded as `{wire}`",
                        path=self._path,
                        wire=self._wire,
                    )
                )
            self._line = RecordedLine(exchanges, self._path.name)
        return RecordedTransport(self._line, self._clock)


class RecordedTransport:
    """The host's end of a recorded line.

    Parameters
    ----------
    line : line to record
    clock : clock of the driver
    """

    def __init__(self, line: RecordedLine, clock: CellClock) -> None:
        self._line = line
        self._clock = clock
        self._buffer = bytearray()
        self._arrived = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._is_open = True

    def write(self, data: bytes) -> None:
        """Send one request.

        Raises
        ------
        UnpluggedError : it is not the recorded one, or the line is closed
        """
        self._require_open()
        reply, took_s = self._line.answer(data, self._clock.now_s())
        if reply:
            self._loop.call_later(self._clock.to_wall_s(took_s), self._arrive, reply)

    async def read(self, timeout_wall_s: float) -> bytes:
        """Return the bytes received, after waiting [wall s] for a first one; b"" if none came.

        Raises
        ------
        UnpluggedError : the line is closed
        """
        self._require_open()
        if not self._buffer:
            try:
                async with asyncio.timeout(max(0.0, timeout_wall_s)):
                    await self._arrived.wait()
            except TimeoutError:
                return b""
        data = bytes(self._buffer)
        self._buffer.clear()
        self._arrived.clear()
        self._require_open()
        return data

    async def aclose(self) -> None:
        """Release the line."""
        self._is_open = False
        self._arrived.set()

    def _arrive(self, data: bytes) -> None:
        self._buffer += data
        self._arrived.set()

    def _require_open(self) -> None:
        if not self._is_open:
            raise UnpluggedError("arm: the recording is closed")
