"""The supervisor's process: ``python -m drivers.supervisor CONTROL_FD SIGNALS_FD [CALLERS_FD]``.

Over the control socket (one packet a message) come orders (JSON), heartbeats (an instant of the
cell's clock, 8 bytes) and a farewell (``bye``; without one the controller was killed). Over the
other one comes a byte per signal that the controller has got: the handler in C writes it, whatever
its Python does. The third one listens for people's programs, and is the controller's own: whoever
calls while that is late is accepted here, is read only in passing, and goes back to it unanswered.
"""

import json
import os
import select
import signal
import socket
import struct
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Final

from drivers._shared_time import SharedTime
from drivers.errors import LinkError
from messages import joined, key, say
from messages.form import with_said

from .words import BLIND_BEATS, MISSED_BEATS, BlindLook, BlindStop, Orders

LOOK_WALL_S: Final = 0.02  # period of looks at the clock
CONNECT_WALL_S: Final = 0.2  # time-out of a connection, so that no device delays the others
AGAIN_WALL_S: Final = 1.0  # pause before an unreachable device is tried again
PACKET_BYTES: Final = 1 << 16
MAX_CALL_BYTES: Final = 64  # leading bytes of a request that identify it
# signals by which people and systems end a run
ENDS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGQUIT, signal.SIGHUP, signal.SIGTSTP)


class Supervisor:
    """Listens to one controller.

    Parameters
    ----------
    control : socket to the controller
    signals : socket with a byte per signal
    listening : for people's programs; None if there is none
    """

    def __init__(
        self,
        control: socket.socket,
        signals: socket.socket,
        listening: socket.socket | None = None,
    ) -> None:
        self._control, self._signals = control, signals
        if listening is not None:
            listening.setblocking(False)  # as its other owner has it: nothing here may wait
        self._listening = listening
        self._callers: list[socket.socket] = []
        self._orders = Orders()
        self._shared: SharedTime | None = None
        self._beat_s: float | None = None  # the last heartbeat, by the cell's clock
        self._has_struck = False
        self._signal_name = ""
        self._are_signals_over = False
        self._eyes: tuple[_Eye, ...] = ()
        self._known: set[str] = set()  # places that were tried

    def run(self) -> None:
        """Supervise until the controller says goodbye or is gone."""
        poll = select.poll()
        poll.register(self._control, select.POLLIN)
        poll.register(self._signals, select.POLLIN)
        while True:
            poll.poll(1e3 * LOOK_WALL_S)
            shared, now_s = self._shared, self._now_s()  # before a heartbeat is taken below
            state = self._take_messages()
            # after heartbeats: one sent before a signal says nothing of it
            if self._take_signals():
                poll.unregister(self._signals)
            if state == "bye":
                return
            if state == "gone":
                self._strike(key("the controller has ended without coming to rest"))
                return
            # orders may have named the cell's clock meanwhile: `now_s` is none of its instants then
            if self._beat_s is not None and not self._has_struck and self._shared is shared:
                self._judge(now_s - self._beat_s)

    def _now_s(self) -> float:
        if self._shared is not None:
            with suppress(ValueError):
                return self._shared.now_s()
        return time.monotonic() * self._orders.speed

    def _take_messages(self) -> str:
        """Take the controller's messages; return its state: alive, bye or gone."""
        while True:
            try:
                packet = self._control.recv(PACKET_BYTES, socket.MSG_DONTWAIT)
            except BlockingIOError:
                return "alive"
            except OSError:
                return "gone"
            if len(packet) == 8:
                self._beat_s = struct.unpack("d", packet)[0]
                self._has_struck, self._signal_name = False, ""
                self._hand_over()
            elif packet in (b"", b"bye"):
                return "bye" if packet else "gone"
            else:
                self._obey(Orders.from_bytes(packet))

    def _obey(self, orders: Orders) -> None:
        if orders.looks != self._orders.looks:
            self._eyes = tuple(_Eye(one) for one in orders.looks)
        if orders.clock != self._orders.clock:
            self._shared = SharedTime(Path(orders.clock))
        self._orders = orders
        named = {one.place: one.name for one in orders.stops}
        named |= {one.place: one.name for one in orders.looks}
        for place in named.keys() - self._known:
            self._known.add(place)
            if not _is_there(place):
                self._say({"unreached": named[place]})
        self._say({"ready": True})

    def _take_signals(self) -> bool:
        """Take the controller's signals; return whether none can come any more."""
        try:
            found = self._signals.recv(64, socket.MSG_DONTWAIT)
        except (BlockingIOError, ConnectionError):
            return False
        for number in found:
            if number in ENDS:
                self._signal_name = signal.Signals(number).name
        # the other end is closed, and this one would be readable for ever
        are_over, self._are_signals_over = not found and not self._are_signals_over, not found
        return are_over

    def _take_calls(self) -> str:
        """Accept callers, and return the first request that stops the cell; empty for none."""
        with suppress(OSError):  # nobody more
            while self._listening is not None:
                self._callers.append(self._listening.accept()[0])
        for caller in self._callers:
            with suppress(OSError):  # nothing said yet, or hung up
                said = caller.recv(MAX_CALL_BYTES, socket.MSG_PEEK | socket.MSG_DONTWAIT)
                if call := next((one for one in self._orders.calls if said.startswith(one)), b""):
                    return call.decode(errors="replace").strip()
        return ""

    def _hand_over(self) -> None:
        """Pass the callers on to the controller, which answers."""
        for caller in self._callers:
            with caller, suppress(OSError):
                body = json.dumps({"caller": True}).encode()
                socket.send_fds(self._control, [body], [caller.fileno()], socket.MSG_DONTWAIT)
        self._callers = []

    def _judge(self, missed_s: float) -> None:
        """Stop the cell if its controller has missed too much."""
        beats = missed_s / self._orders.beat_s
        since = say(
            "the controller has shown no sign of life for {missed_s:.2f} s of the cell's time",
            missed_s=missed_s,
        )
        if beats > MISSED_BEATS:
            self._strike(since)
        elif beats > BLIND_BEATS:
            if self._signal_name:
                self._strike(
                    say(
                        "{since}, and {signal_name} was sent to it",
                        since=since,
                        signal_name=self._signal_name,
                    )
                )
            elif call := self._take_calls():
                self._strike(say("{since}, and `{call}` was asked of it", since=since, call=call))
            elif bad := next((eye.name for eye in self._eyes if not eye.is_well()), None):
                self._strike(
                    say(
                        "{since}, and {bad} reports an open door or an emergency stop",
                        since=since,
                        bad=bad,
                    )
                )

    def _strike(self, why: str) -> None:
        """Send every stop, serial lines first, and report it."""
        self._has_struck = True
        if not self._orders.stops:  # nothing may move
            return
        sent, unsent = [], []
        for stop in sorted(self._orders.stops, key=lambda one: _host_of(one.place) is not None):
            try:
                _send(stop)
            except OSError as error:
                unsent.append(f"{stop.name} ({error.strerror or error})")
            else:
                sent.append(stop.name)
        names = joined(", ", sent) or key("no device")
        missed = say("; not sent to {unsent}", unsent=joined(", ", unsent)) if unsent else ""
        sentence = say(
            "the supervisor has sent a stop to {names}{missed}: {why}",
            names=names,
            missed=missed,
            why=why,
        )
        self._say({"struck": sentence})
        ready = select.poll()
        ready.register(2, select.POLLOUT)
        if ready.poll(0):  # a terminal that was stopped must not stop this process
            with suppress(OSError):
                os.write(2, f"{sentence}\n".encode(errors="backslashreplace"))

    def _say(self, body: dict[str, object]) -> None:
        with suppress(OSError):
            self._control.send(json.dumps(with_said(body)).encode(), socket.MSG_DONTWAIT)


class _Eye:
    """Looks at the inputs of one device, over a connection that stays open."""

    def __init__(self, look: BlindLook) -> None:
        self.name = look.name
        self._look = look
        self._socket: socket.socket | None = None
        self._not_before_s = 0.0

    def is_well(self) -> bool:
        """Return whether all is well; an unreachable device counts as well."""
        if self._socket is None and time.monotonic() < self._not_before_s:
            return True
        try:
            if self._socket is None:
                self._socket = _connected(self._look.place)
            self._socket.send(self._look.request)
            answer = b""
            while len(answer) < len(self._look.mask):
                more = self._socket.recv(len(self._look.mask) - len(answer))
                if not more:
                    raise ConnectionError("closed")
                answer += more
        except OSError:
            if self._socket is not None:
                self._socket.close()
            self._socket, self._not_before_s = None, time.monotonic() + AGAIN_WALL_S
            return True
        return all(got & bits == bits for got, bits in zip(answer, self._look.mask, strict=True))


def _host_of(place: str) -> tuple[str, int] | None:
    host, _, port = place.rpartition(":")
    return (host, int(port)) if host and port.isdigit() and not place.startswith("/") else None


def _connected(place: str) -> socket.socket:
    found = _host_of(place)
    assert found is not None
    return socket.create_connection(found, CONNECT_WALL_S)


def _is_there(place: str) -> bool:
    """Return whether a wire can be reached, so that this is known before anything moves."""
    try:
        if _host_of(place) is None:
            os.close(os.open(place, os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC))
        else:
            _connected(place).close()
    except OSError:
        return False
    return True


def _send(stop: BlindStop) -> None:
    """Send one stop, with its repetitions."""
    is_serial = _host_of(stop.place) is None
    flags = os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC
    fd = os.open(stop.place, flags) if is_serial else _connected(stop.place).detach()
    try:
        for _ in range(stop.count):
            for frame in stop.frames:
                time.sleep(stop.spacing_s)  # before each: something may have been sent just now
                os.write(fd, frame)
        if not is_serial:  # its answer, lest the connection be reset before the frame is read
            select.select([fd], [], [], CONNECT_WALL_S)
    finally:
        os.close(fd)


def main() -> None:
    """Supervise over the descriptors of the command line."""
    for number in ENDS:
        signal.signal(number, signal.SIG_IGN)  # it ends with its controller, and not before
    control, signals, *more = (socket.socket(fileno=int(word)) for word in sys.argv[1:])
    with control, signals, suppress(LinkError):
        Supervisor(control, signals, *more).run()
