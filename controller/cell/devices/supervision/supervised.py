"""The controller's side of the supervisor: heartbeat, and the orders for its absence.

The supervisor is a process of its own (`drivers.supervisor`, ADR 98). It has a stop for every wire
only while something may move, so that a late controller at rest causes no stop.
"""

import asyncio
import json
import signal
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from dataclasses import dataclass
from typing import Final

from drivers.clock import CellClock
from drivers.errors import LinkError
from drivers.supervisor import BEAT_S, BlindLook, BlindStop, LooksBlindly, Orders, StopsBlindly
from messages import key
from messages.form import from_said

from ..build import Devices

READY_WALL_S: Final = 60.0  # longest start of a process on a busy machine
MIN_BEAT_WALL_S: Final = 0.02  # Shortest period, however fast an emulated cell's time runs.
END_WALL_S: Final = 5.0
PACKET_BYTES: Final = 1 << 16


@dataclass(frozen=True, slots=True)
class CallerPrograms:
    """People's programs, which the supervisor hears while the event loop is late.

    Attributes
    ----------
    listening : socket that they connect to
    stops : first bytes of the requests that stop the cell
    take : serves a connection that the supervisor has accepted
    """

    listening: socket.socket
    stops: tuple[bytes, ...]
    take: Callable[[socket.socket], None]


class Supervised:
    """Sends the heartbeat while the event loop runs, and passes on the supervisor's messages.

    Parameters
    ----------
    devices : some of which can be stopped in our place
    clock : clock of the cell, by which heartbeats are missed
    clock_path : path of its file, if it is shared; empty for the wall clock
    may_move : True if anything may move now
    on_stopped : called with a sentence once the supervisor has stopped the cell, or has ended
    callers : callers that may order a stop meanwhile; None without any

    Attributes
    ----------
    unreached : devices that take no second connection
    pid : process id of the supervisor
    """

    def __init__(
        self,
        devices: Devices,
        clock: CellClock,
        clock_path: str,
        may_move: Callable[[], bool],
        on_stopped: Callable[[str], None],
        callers: CallerPrograms | None = None,
    ) -> None:
        self._devices = devices
        self._clock = clock
        self._clock_path = clock_path
        self._may_move = may_move
        self._on_stopped = on_stopped
        self._callers = callers
        self._beat_s = max(BEAT_S, MIN_BEAT_WALL_S * clock.speed)
        self._sent: Orders | None = None
        self._ready = asyncio.Event()
        self._is_over = False
        self.unreached: list[str] = []
        self.pid: int | None = None

    @asynccontextmanager
    async def beating(self) -> AsyncIterator["Supervised"]:
        """Yield once the supervisor has started and tried every wire; beat while the block runs.

        A block that is broken off ends without a farewell: anything that may still move is stopped.

        Raises
        ------
        LinkError : it does not start; nothing has moved
        """
        near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        heard, told = socket.socketpair()
        near.setblocking(False)
        told.setblocking(False)
        listening = () if self._callers is None else (self._callers.listening,)
        process = await asyncio.to_thread(_start, far, heard, *listening)
        self.pid = process.pid
        far.close()
        heard.close()
        loop = asyncio.get_running_loop()
        loop.add_reader(near, self._hear, near)
        beat: asyncio.Task[None] | None = None
        try:
            self._order(near, is_all=True)
            try:
                async with asyncio.timeout(READY_WALL_S):
                    await self._ready.wait()
            except TimeoutError:
                raise LinkError(key("the supervisor does not start; nothing has moved")) from None
            beat = asyncio.create_task(self._beat(near), name="heartbeat")
            with _signals_to(told):
                yield self
        finally:
            self._is_over = True
            if beat is not None:
                beat.cancel()
                await asyncio.gather(beat, return_exceptions=True)
            loop.remove_reader(near)
            if sys.exc_info()[0] is None:
                with suppress(OSError):
                    near.send(b"bye")
            near.close()
            told.close()
            await asyncio.to_thread(_end, process)

    async def _beat(self, control: socket.socket) -> None:
        while True:
            with suppress(BlockingIOError, ConnectionError):
                self._order(control)
                control.send(struct.pack("d", self._clock.now_s()))
            await self._clock.sleep(self._beat_s)

    def _order(self, control: socket.socket, *, is_all: bool = False) -> None:
        """Send the supervisor's orders if they have changed."""
        stops: tuple[BlindStop, ...] = ()
        looks: tuple[BlindLook, ...] = ()
        if is_all or self._may_move():
            movers = (self._devices.arm, self._devices.gripper, self._devices.io)
            stops = tuple(
                stop
                for one in movers
                if isinstance(one, StopsBlindly) and (stop := one.blind_stop()) is not None
            )
            if isinstance(self._devices.io, LooksBlindly):
                look = self._devices.io.blind_look()
                looks = () if look is None else (look,)
        calls = () if self._callers is None else self._callers.stops
        orders = Orders(stops, looks, calls, self._clock_path, self._clock.speed, self._beat_s)
        if orders != self._sent:
            control.send(orders.to_bytes())
            self._sent = orders

    def _hear(self, control: socket.socket) -> None:
        try:
            packet, fds, _, _ = socket.recv_fds(control, PACKET_BYTES, 1, socket.MSG_CMSG_CLOEXEC)
        except BlockingIOError:
            return
        except OSError:
            packet, fds = b"", []
        for fd in fds:
            assert self._callers is not None, "nobody else calls"
            self._callers.take(socket.socket(fileno=fd))
        if not packet:
            asyncio.get_running_loop().remove_reader(control)
            self._ready.set()
            if not self._is_over:
                self._on_stopped(
                    key("the supervisor has ended: this process is no longer supervised")
                )
            return
        body = from_said(json.loads(packet))
        if body.get("ready"):
            self._ready.set()
        if "unreached" in body:
            self.unreached.append(body["unreached"])
        if "struck" in body:
            self._on_stopped(body["struck"])


@contextmanager
def _signals_to(told: socket.socket) -> Iterator[None]:
    """Have the kernel's own handler pass signals on: it runs even while this process computes."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.set_wakeup_fd(told.fileno(), warn_on_full_buffer=False)
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)


def _start(*sockets: socket.socket) -> "subprocess.Popen[bytes]":
    fds = tuple(one.fileno() for one in sockets)
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "drivers.supervisor", *map(str, fds)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        pass_fds=fds,
        start_new_session=True,  # Ctrl-C and a closed terminal are for the controller
    )


def _end(process: "subprocess.Popen[bytes]") -> None:
    try:
        process.wait(END_WALL_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
