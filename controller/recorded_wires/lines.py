"""Lines of bytes played back: replies to the same requests, and the first request that differs.

A caller gets its turn in the recorded order and at the recorded instant. A caller that is not the
next one waits: in the recorded run it was overtaken. If the next one has not come `OVERDUE_S` after
its instant, it never will, and the waiting caller continues: its bytes show the difference. Once
the last deed of a run is done polls may be missing: a busy machine asks devices more often until it
gives them up.
"""

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf
from typing import Any, Final, TypeVar, cast

from drivers.errors import UnpluggedError
from drivers.wire_file import WireReader, WireRow
from messages import say

from .loop import WireLoop
from .recording import LineCallers

Opened = TypeVar("Opened")

PROMPT_S: Final = 0.12  # longest time of a reply that was in time: the arm's time-out is 0.14 s
RENAMED_S: Final = 0.02  # wait for a sender that has been renamed since the recording
OVERDUE_S: Final = 0.2  # in cell time; a recorded loop was never late by this much
ENDED: Final = "the recording has ended"


@dataclass(frozen=True, slots=True)
class Difference:
    """The first request that differs from the recorded one.

    Attributes
    ----------
    wire : wire on which it was sent
    at_s : instant of the recorded one, on its cell's clock [s]
    recorded, sent : their bytes; None if there was no further request
    recorded_words, sent_words : purpose of the bytes recorded, and of those sent
    after_row : number, kind and name of the journal's row that came before, in the recorded run
    """

    wire: str
    at_s: float
    recorded: bytes | None
    sent: bytes | None
    recorded_words: str
    sent_words: str
    after_row: tuple[int, str, str] | None

    @property
    def byte(self) -> int:
        """Number of the first byte that differs, from 0."""
        left, right = self.recorded or b"", self.sent or b""
        pairs = zip(left, right, strict=False)
        same = next((i for i, (a, b) in enumerate(pairs) if a != b), None)
        return min(len(left), len(right)) if same is None else same


class Tape:
    """A recording being played: the wire whose turn it is, and the row at which it stopped.

    Parameters
    ----------
    reader : reader of the file
    loop : loop on whose time it is played
    speed : cell seconds per second of the loop

    Attributes
    ----------
    difference : the first one, None while there is none
    request_count : requests that were the recorded ones
    callers : names who wants a line
    done_s : end of the last motion or grip; after it devices were only polled, the lamps switched
        off and everything stopped [cell s]
    has_run_out : a recording that is not whole has been played to its end
    """

    def __init__(self, reader: WireReader, loop: WireLoop, speed: float) -> None:
        self.reader = reader
        self.loop = loop
        self.speed = speed
        self.difference: Difference | None = None
        self.request_count = 0
        self.has_run_out = False
        self.callers = LineCallers()
        self.done_s = _end_of_deeds_s(reader.rows)

    @property
    def now_s(self) -> float:
        """The present instant [cell s]."""
        return self.loop.time() * self.speed

    def loop_s(self, cell_s: float) -> float:
        """Return an instant [cell s] on the loop's scale [s]."""
        return cell_s / self.speed

    def require_same(self) -> None:
        """Check that the replay goes on: bytes after its end prove nothing.

        Raises
        ------
        UnpluggedError : there is a difference, or nothing more was recorded
        """
        if self.difference is not None or self.has_run_out:
            raise UnpluggedError(ENDED)

    def differ(
        self,
        wire: str,
        row: WireRow | None,
        recorded: bytes | None,
        sent: bytes | None,
        words: tuple[str, str] = ("", ""),
    ) -> None:
        """Note the first difference, and end the playing.

        Parameters
        ----------
        wire : wire on which it is
        row : recorded request; None if there is none
        recorded, sent : bytes
        words : words recorded, and those found instead

        Raises
        ------
        UnpluggedError : always
        """
        if recorded is None and not self.reader.is_whole:
            self.has_run_out = True
        elif self.difference is None:
            at_s = self.now_s if row is None else row.at_s
            before = row or self._last_before(at_s)
            self.difference = Difference(
                wire, at_s, recorded, sent, *words, after_row=self._journal_before(before)
            )
        raise UnpluggedError(ENDED)

    def _last_before(self, at_s: float) -> WireRow | None:
        return next((row for row in reversed(self.reader.rows) if row.at_s <= at_s), None)

    def _journal_before(self, row: WireRow | None) -> tuple[int, str, str] | None:
        last = None
        for one in self.reader.rows:
            if one.wire == "journal":
                last = one.info
            if one is row:
                break
        return None if last is None else (int(last[0]), str(last[1]), str(last[2]))


def _end_of_deeds_s(rows: Sequence[WireRow]) -> float:
    """Return the instant of the first outcome after the last intent; infinite for none."""
    told = [row for row in rows if row.wire == "journal"]
    intents = [k for k, row in enumerate(told) if row.info[1] == "intent"]
    after = told[intents[-1] :] if intents else told
    return next((row.at_s for row in after if row.info[1] == "outcome"), inf)


class PlayedLine:
    """One line of the recording; a `drivers.wires.LineTap`.

    Parameters
    ----------
    tape : tape with its rows
    wire : its name
    """

    def __init__(self, tape: Tape, wire: str) -> None:
        self._tape = tape
        self.wire = wire
        self._rows: Sequence[WireRow] = [row for row in tape.reader.rows if row.wire == wire]
        self._turns = [row for row in self._rows if row.kind == "turn"]
        self._turn_count = 0
        self._taking: WireRow | None = None  # its caller waits for its instant
        self._changed = asyncio.Event()
        self._place = 0  # of the next row that is not a turn
        self._what = ""  # the line was taken for
        self._arrive: Callable[[bytes], None] = lambda data: None
        self._lose: Callable[[str], None] = lambda why: None

    @property
    def left_count(self) -> int:
        """Recorded requests the replay never sent.

        Those after its last deed do not count: a run that ends a little earlier asks less often
        whether a device is still there.
        """
        until_s = self._tape.done_s
        rows = [row for row in self._rows[self._place :] if row.kind in ("sent", "got")]
        return sum(
            a.kind == "sent" and b.kind == "got" and a.at_s < until_s for a, b in pairwise(rows)
        )

    def left_difference(self) -> None:
        """Note the first recorded request that the replay never sent as the difference."""
        row = next(row for row in self._rows[self._place :] if row.kind == "sent")
        data = self._tape.reader.data(row)
        try:
            self._tape.differ(
                self.wire, row, data, None, (self._words_of(row), "the run has ended")
            )
        except UnpluggedError:
            return

    # --- whose turn it is -----------------------------------------------------------------------

    async def turn(self, what: str) -> None:
        """Wait until the recorded run gave this caller the line.

        Raises
        ------
        UnpluggedError : there is a difference
        """
        tape = self._tape
        while True:
            tape.require_same()
            due = self._turns[self._turn_count] if self._turn_count < len(self._turns) else None
            if due is not None and due is not self._taking and self._is_due(due, what):
                await self._take(self._turn_count)
                return
            until_s = (self._end_s if due is None else due.at_s) + OVERDUE_S
            if due is not None and due.info[0] == what:
                until_s = due.at_s + RENAMED_S
            if tape.now_s >= until_s - 1e-6:
                own = self._own_last_turn(what)
                if own is None:
                    self._pass(self._turn_count)
                else:
                    await self._take(own)
                    turn = self._turns[own]
                    self._place = next(k for k, one in enumerate(self._rows) if one is turn)
                return
            changed = self._changed
            try:
                async with asyncio.timeout_at(tape.loop_s(until_s)):
                    await changed.wait()
            except TimeoutError:
                continue

    def _is_due(self, due: WireRow, what: str) -> bool:
        return bool(due.info == [what, self._tape.callers.name()])

    async def _take(self, number: int) -> None:
        """Wait for the instant of a turn; it and those before it are over then."""
        self._taking = self._turns[number]
        try:
            await self._until(self._taking.at_s)
        finally:
            self._pass(number)

    def _pass(self, number: int) -> None:
        """Let those who wait look whether it is their turn, after the one of this number."""
        self._turn_count = max(self._turn_count, number + 1)
        self._changed.set()
        self._changed = asyncio.Event()

    def _own_last_turn(self, what: str) -> int | None:
        """Return the number of a caller's turn behind those of others, the last deed done.

        None if there is none. A busy machine polled a device once more between the end of the last
        part and the stop; those who polled have ended here.
        """
        for number, row in enumerate(self._turns[self._turn_count :], start=self._turn_count):
            if row.at_s < self._tape.done_s:
                return None
            if self._is_due(row, what):
                return number
        return None

    async def _until(self, cell_s: float) -> None:
        wait_s = self._tape.loop_s(cell_s) - self._tape.loop.time()
        if wait_s > 0:
            await asyncio.sleep(wait_s)

    @property
    def _end_s(self) -> float:
        return self._tape.reader.rows[-1].at_s

    def _words_of(self, row: WireRow) -> str:
        """Return the purpose of a recorded request."""
        words = ""
        for one in self._rows:
            if one.kind == "turn":
                words = str(one.info[0])
            if one is row:
                break
        return words

    def taken(self, what: str) -> None:
        """Keep the purpose of the line's use: the words of a difference."""
        self._what = what

    # --- bytes ----------------------------------------------------------------------------------

    def send(self, data: bytes) -> None:
        """Compare a request with the recorded one, and set the replies on their way.

        Raises
        ------
        UnpluggedError : it differs
        """
        tape = self._tape
        tape.require_same()
        row = self._next("sent")
        words = self._what
        if row is None:
            tape.differ(self.wire, None, None, data, ("nothing more", words))
        assert row is not None
        recorded = tape.reader.data(row)
        if recorded != data:
            tape.differ(self.wire, row, recorded, data, (self._words_of(row), words))
        tape.request_count += 1
        now_s, is_given_up = tape.now_s, False
        for reply in self._until_next("sent", "opened"):
            if reply.kind == "unanswered":
                is_given_up = True
                continue
            # when it came; after a late request, as long after it as it took
            at_s = (
                max(reply.at_s, now_s + reply.at_s - row.at_s) if now_s > row.at_s else reply.at_s
            )
            if reply.kind == "got" and not is_given_up:
                # it was accepted, however late that loop was to send or to take it
                at_s = min(at_s, now_s + PROMPT_S)
            if reply.kind in ("got", "late"):
                tape.loop.call_at(tape.loop_s(at_s), self._give, tape.reader.data(reply))
            elif reply.kind in ("lost", "failed"):
                why = str(reply.info or "the line was lost")
                tape.loop.call_at(tape.loop_s(at_s), self._cut, why)

    def _give(self, data: bytes) -> None:
        self._arrive(data)

    def _cut(self, why: str) -> None:
        self._lose(why)

    def _next(self, kind: str) -> WireRow | None:
        for place in range(self._place, len(self._rows)):
            if self._rows[place].kind == kind:
                self._place = place + 1
                return self._rows[place]
        return None

    def _until_next(self, *kinds: str) -> list[WireRow]:
        found = []
        while self._place < len(self._rows) and self._rows[self._place].kind not in kinds:
            row = self._rows[self._place]
            self._place += 1
            if row.kind != "turn":
                found.append(row)
        return found

    # --- a serial line --------------------------------------------------------------------------

    def opening(self, make: Callable[[], Opened]) -> Opened:
        """Return a transport that plays the line; ``make`` is not called."""
        return cast(Opened, PlayedTransport(self))

    def attach(self, arrive: Callable[[bytes], None], lose: Callable[[str], None]) -> None:
        """Pass received data on to a callback.

        Parameters
        ----------
        arrive : called with bytes
        lose : called with the reason when the line is gone
        """
        self._arrive, self._lose = arrive, lose

    # --- a Modbus connection --------------------------------------------------------------------

    def connect(self, protocol: asyncio.BaseProtocol) -> asyncio.Transport:
        """Return a connection, as the recorded run got one.

        Raises
        ------
        ConnectionRefusedError : it did not
        """
        row = self._next("opened")
        if row is None or row.info is not None:
            raise ConnectionRefusedError("the recorded run was not connected here")
        transport = _PlayedConnection(self, self._tape.loop, protocol)
        protocol.connection_made(transport)
        for lost in self._until_next("sent", "opened"):
            if lost.kind == "lost":
                self._tape.loop.call_at(self._tape.loop_s(lost.at_s), transport.lose)
        return transport

    def unanswered(self) -> None:
        """Do nothing: the recording knows which replies were given up."""

    def opened(self, problem: str | None) -> None:
        """Do nothing: `connect` does this."""

    def carried(self, data: bytes, *, sending: bool, in_time: bool) -> None:
        """Do nothing: the connection compares the data sent.

        Parameters
        ----------
        data : bytes
        sending : True for requests
        in_time : somebody waits for them
        """

    def lost(self) -> None:
        """Do nothing: the recording knows when the line was lost."""


class PlayedTransport:
    """The host's end of a serial line, of three methods, as the arm's driver has it."""

    def __init__(self, line: PlayedLine) -> None:
        self._line = line
        self._buffer = bytearray()
        self._failure: str | None = None
        self._waiter: asyncio.Future[None] | None = None
        line.attach(self._arrive, self._fail)

    def _arrive(self, data: bytes) -> None:
        self._buffer += data
        self._wake()

    def _fail(self, why: str) -> None:
        self._failure = why
        self._wake()

    def _wake(self) -> None:
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)

    def write(self, data: bytes) -> None:
        """Send a request."""
        self._require_open()
        self._line.send(data)

    async def read(self, timeout_wall_s: float) -> bytes:
        """Return the bytes received, after waiting [wall s] for a first one; b"" if none came."""
        if not self._buffer and self._failure is None:
            if timeout_wall_s <= 0:
                await asyncio.sleep(0)
            else:
                self._waiter = asyncio.get_running_loop().create_future()
                try:
                    async with asyncio.timeout(timeout_wall_s):
                        await self._waiter
                except TimeoutError:
                    return b""
                finally:
                    self._waiter = None
        data = bytes(self._buffer)
        self._buffer.clear()
        if not data:
            self._require_open()
        return data

    def _require_open(self) -> None:
        if self._failure is not None:
            raise UnpluggedError(say("arm: {failure}", failure=self._failure))

    async def aclose(self) -> None:
        """Release the line."""
        self._failure = "the line is closed"
        self._wake()


class _PlayedConnection(asyncio.Transport):
    """One TCP connection of pymodbus."""

    def __init__(self, line: PlayedLine, loop: WireLoop, protocol: Any) -> None:  # noqa: ANN401  (pymodbus' protocols have the methods, and not the base class)
        super().__init__({"peername": ("wires", 0), "sockname": ("wires", 0), "socket": None})
        self._line = line
        self._loop = loop
        self._protocol = protocol
        self._is_closing = False
        line.attach(self._arrive, lambda _: self.lose())

    def _arrive(self, data: bytes) -> None:
        if not self._is_closing:
            self._protocol.data_received(data)

    def lose(self) -> None:
        """See the other end close."""
        if not self._is_closing:
            self._is_closing = True
            self._loop.call_soon(self._protocol.connection_lost, None)

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Send a request; one that differs ends the connection, as if it were unplugged."""
        if self._is_closing:
            return
        try:
            self._line.send(bytes(data))
        except UnpluggedError:
            self.lose()

    def close(self) -> None:
        """Close it."""
        self.lose()

    def abort(self) -> None:
        """Close it."""
        self.lose()

    def is_closing(self) -> bool:
        """Return whether the connection takes no more data."""
        return self._is_closing
