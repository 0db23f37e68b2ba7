"""The supervisor stops every wire when its controller cannot, and nothing while it can."""

from __future__ import annotations

import asyncio
import json
import os
import pty
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from controller.cell.control.peer import Peer
from controller.cell.control.serving import STOPS, serving
from controller.cell.devices.supervision import Supervised
from drivers.clock import CellClock
from drivers.modbus_link import ModbusLink, RtuOverTcpAddress, TcpAddress
from drivers.supervisor import BEAT_S, MISSED_BEATS, BlindLook, BlindStop, Orders
from drivers.umi_scara import UmiScara

LONG_S = 60.0
STOP = BlindStop("arm", "", (b"\x24", b"\x29", b"\x24"), 0.01, 2)
ALL_WELL, DOOR_OPEN = b"\x07", b"\x05"


class Line:
    """A serial line's far end: notes what arrives, and when."""

    def __init__(self) -> None:
        self.far, near = pty.openpty()
        tty.setraw(near)
        self.path, self._near = os.ttyname(near), near
        self.bytes = b""
        self.first_at_s: float | None = None
        self.arrived = threading.Event()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        with suppress(OSError):
            while data := os.read(self.far, 100):
                self.first_at_s = self.first_at_s or time.monotonic()
                self.bytes += data
                self.arrived.set()

    def wait_s(self, since_s: float) -> float:
        """Return how long after an instant the first byte came [s]."""
        assert self.arrived.wait(LONG_S)
        assert self.first_at_s is not None
        return self.first_at_s - since_s

    def close(self) -> None:
        os.close(self._near)
        os.close(self.far)


class Heart:
    """A controller in small: beats, or does not."""

    def __init__(self, orders: Orders, *listening: socket.socket) -> None:
        self.control, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.signals, heard = socket.socketpair()
        fds = (far.fileno(), heard.fileno(), *(one.fileno() for one in listening))
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-m", "drivers.supervisor", *map(str, fds)], pass_fds=fds
        )
        far.close()
        heard.close()
        self.control.settimeout(LONG_S)
        self.control.send(orders.to_bytes())
        self.said: list[dict[str, object]] = []
        while not self.hear().get("ready"):
            pass

    def hear(self) -> dict[str, object]:
        body: dict[str, object] = json.loads(self.control.recv(1 << 16) or b"{}")
        self.said.append(body)
        return body

    def beat(self) -> float:
        at_s = time.monotonic()
        self.control.send(struct.pack("d", at_s))
        return at_s

    def close(self) -> None:
        with suppress(OSError):
            self.control.send(b"bye")
        self.control.close()
        self.signals.close()
        try:
            assert self.process.wait(LONG_S) == 0
        finally:
            self.process.kill()
            self.process.wait()


@pytest.fixture
def line() -> Iterator[Line]:
    line = Line()
    yield line
    line.close()


@contextmanager
def supervised(line: Line, *looks: BlindLook) -> Iterator[Heart]:
    stop = BlindStop(STOP.name, line.path, STOP.frames, STOP.spacing_s, STOP.count)
    heart = Heart(Orders((stop,), looks))
    try:
        yield heart
    finally:
        heart.close()


def test_a_heart_that_stands_still_has_every_wire_stopped_and_is_told(line: Line) -> None:
    with supervised(line) as heart:
        last_s = heart.beat()
        assert line.wait_s(last_s) >= MISSED_BEATS * BEAT_S
        while "struck" not in (said := heart.hear()):
            pass
        assert str(said["struck"]).startswith("the supervisor has sent a stop to arm: ")
        wanted = b"".join(STOP.frames) * STOP.count
        while len(line.bytes) < len(wanted):
            time.sleep(0.01)
        assert line.bytes == wanted


def test_a_heart_that_beats_has_nothing_stopped(line: Line) -> None:
    with supervised(line) as heart:
        for _ in range(3 * MISSED_BEATS):
            heart.beat()
            time.sleep(BEAT_S / 2)
        # a farewell is no death
    assert line.bytes == b""


def test_a_controller_that_is_killed_has_every_wire_stopped(line: Line) -> None:
    with supervised(line) as heart:
        heart.beat()
        heart.control.close()
        line.wait_s(0.0)
    assert heart.process.returncode == 0


def test_a_signal_to_a_heart_that_stands_still_stops_it_sooner(line: Line) -> None:
    with supervised(line) as heart:
        last_s = heart.beat()
        heart.signals.send(bytes([signal.SIGTERM]))
        line.wait_s(last_s)
        assert "SIGTERM" in str(heart.hear()["struck"])


def test_a_signal_to_a_heart_that_beats_is_the_controllers_business(line: Line) -> None:
    with supervised(line) as heart:
        heart.signals.send(bytes([signal.SIGTERM]))
        for _ in range(MISSED_BEATS):
            heart.beat()
            time.sleep(BEAT_S / 2)
    assert line.bytes == b""


def test_nothing_is_stopped_while_nothing_may_move(line: Line) -> None:
    with supervised(line) as heart:
        heart.control.send(Orders().to_bytes())
        heart.beat()
        heart.hear()
        time.sleep((MISSED_BEATS + 2) * BEAT_S)
    assert line.bytes == b""


@contextmanager
def inputs(answer: list[bytes]) -> Iterator[str]:
    """Serve one byte of inputs, the last of ``answer``, for each request of one byte."""
    server = socket.create_server(("127.0.0.1", 0))

    def serve(connection: socket.socket) -> None:
        with connection, suppress(OSError):
            while connection.recv(1):
                connection.send(answer[-1])

    def accept() -> None:
        with suppress(OSError):
            while True:
                threading.Thread(target=serve, args=server.accept()[:1], daemon=True).start()

    threading.Thread(target=accept, daemon=True).start()
    try:
        yield f"127.0.0.1:{server.getsockname()[1]}"
    finally:
        server.close()


@pytest.mark.parametrize(("answer", "why"), [(DOOR_OPEN, "door"), (ALL_WELL, "no sign of life")])
def test_a_door_that_opens_before_a_heart_that_stands_still_is_seen(
    line: Line, answer: bytes, why: str
) -> None:
    with inputs([answer]) as place:
        look = BlindLook("I/O block", place, b"?", ALL_WELL)
        with supervised(line, look) as heart:
            heart.beat()
            struck = str(heart.hear()["struck"])
        if answer == DOOR_OPEN:
            assert "I/O block reports an open door" in struck
        else:
            assert struck.count("I/O block") == 0


@pytest.mark.parametrize(("path", "why"), [("/stop", "`POST /stop` was asked"), ("/stops", "")])
def test_who_orders_a_stop_of_a_heart_that_stands_still_is_heard_and_handed_over(
    line: Line, tmp_path: Path, path: str, why: str
) -> None:
    request = f"POST {path} HTTP/1.1\r\n".encode()
    place = str(tmp_path / "control")
    with (
        socket.socket(socket.AF_UNIX) as listening,
        socket.socket(socket.AF_UNIX) as hung_up,
        socket.socket(socket.AF_UNIX) as caller,
    ):
        listening.bind(place)
        listening.listen()
        listening.setblocking(False)
        hung_up.connect(place)
        hung_up.close()
        caller.connect(place)
        caller.sendall(request)
        stop = BlindStop(STOP.name, line.path, STOP.frames, STOP.spacing_s, STOP.count)
        heart = Heart(Orders((stop,), calls=(b"POST /stop ",)), listening)
        try:
            heart.beat()
            struck = str(heart.hear()["struck"])
            assert why in struck
            assert ("was asked" in struck) == bool(why)
            heart.beat()
            said, fds, _, _ = socket.recv_fds(heart.control, 100, 1)
            os.close(fds[0])
            assert json.loads(said) == {"caller": True}, "the one that hung up"
            _, fds, _, _ = socket.recv_fds(heart.control, 100, 1)
            with socket.socket(fileno=fds[0]) as handed:
                assert handed.recv(100) == request, "nothing of it was taken away"
        finally:
            heart.close()


def test_a_wire_that_cannot_be_reached_is_named_before_anything_moves(line: Line) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        place = f"127.0.0.1:{server.getsockname()[1]}"
    stops = (
        BlindStop("fixed gripper", place, (b"x",)),
        BlindStop(STOP.name, line.path, STOP.frames, STOP.spacing_s, STOP.count),
    )
    heart = Heart(Orders(stops))
    try:
        assert {"unreached": "fixed gripper"} in heart.said
        heart.beat()
        struck = str(heart.hear()["struck"])
        assert f"sent a stop to {STOP.name}; not sent to fixed gripper (" in struck
        assert line.bytes, "the arm is stopped all the same, and first"
    finally:
        heart.close()


def test_orders_come_out_as_they_went_in() -> None:
    orders = Orders(
        (STOP, BlindStop("g", "h:1", (b"\x00\xff",))), (BlindLook("io", "h:2", b"a", b"\x00\x07"),),
        (b"POST /stop ",), "/tmp/clock", 3.0, 0.3,
    )  # fmt: skip
    assert Orders.from_bytes(orders.to_bytes()) == orders


# ---- what drivers give it ------------------------------------------------------------------------


async def test_the_frames_of_a_blind_write_are_the_standards() -> None:
    # Modbus application protocol V1.1b3, 6.6: "06 0001 0003"; TCP guide 4.1: the header
    tcp = ModbusLink(TcpAddress("h", 502)).unit(17, "gripper").blind_write(1, 3)
    (frame,) = tcp.frames
    assert (frame[2:], tcp.place) == (bytes.fromhex("0000 0006 11 06 0001 0003"), "h:502")
    rtu = ModbusLink(RtuOverTcpAddress("h", 4001)).unit(17, "gripper").blind_write(1, 3)
    # "11 06 00 01 00 03 9A 9B": the worked example of Modicon's reference guide, PI-MBUS-300
    assert rtu.frames == (bytes.fromhex("11 06 0001 0003 9A9B"),)


async def test_a_look_reads_the_inputs_that_nothing_moves_without() -> None:
    link = ModbusLink(TcpAddress("h", 502))
    look = link.unit(1, "I/O block").blind_look(6, (0, 1, 4))
    assert look is not None
    assert look.request[6:] == bytes.fromhex("01 02 0000 0006")
    assert look.mask == bytes(9) + b"\x13"
    assert ModbusLink(RtuOverTcpAddress("h", 1)).unit(1, "I/O block").blind_look(6, (0,)) is None


def test_the_arms_blind_stop_is_a_dead_stop_on_both_boards() -> None:
    stop = UmiScara("/dev/ttyUSB0").blind_stop()
    assert stop is not None
    assert stop.place == "/dev/ttyUSB0"
    assert stop.frames == (b"\x24", b"\x29", b"\x24")  # umi_rtx.md 1.4, 2.3
    assert stop.count % 2 == 0, "the line is as it was"
    assert stop.spacing_s >= 0.008  # umi_rtx.md 1.2


# ---- the controller's side -----------------------------------------------------------------------

CONTROLLER = """
import asyncio, signal, sys, time
from types import SimpleNamespace
from controller.cell.devices.supervision import Supervised
from drivers.clock import CellClock
from drivers.umi_scara import UmiScara

async def main(line, how):
    arm = UmiScara(line)
    devices = SimpleNamespace(arm=arm, gripper=None, io=None)
    told = asyncio.get_running_loop().create_future()
    watch = Supervised(devices, CellClock(), "", lambda: True, told.set_result)
    async with watch.beating():
        await asyncio.sleep(0.5)
        print(time.monotonic(), flush=True)
        if how == "signalled":  # its handler in Python comes to nothing while the call lasts
            signal.signal(signal.SIGTERM, lambda number, frame: None)
            signal.raise_signal(signal.SIGTERM)
        if how != "asleep":
            sum(range(10**8))  # one call in C, which holds the interpreter
        else:
            await asyncio.sleep(60)
        print(await told, flush=True)

asyncio.run(main(*sys.argv[1:]))
"""


@contextmanager
def controller(line: Line, how: str) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        [sys.executable, "-c", CONTROLLER, line.path, how],
        cwd=Path(__file__).parents[2],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        assert process.stdout is not None
        process.stdout.close()


@pytest.mark.parametrize(("how", "why"), [("busy", "time"), ("signalled", "SIGTERM was sent")])
def test_a_call_in_c_that_holds_the_interpreter_does_not_hold_up_the_stop(
    line: Line, how: str, why: str
) -> None:
    with controller(line, how) as process:
        assert process.stdout is not None
        process.stdout.readline()
        line.wait_s(0.0)
        assert process.poll() is None
        said = process.stdout.readline()  # the loop is told afterwards
    assert "no sign of life" in said
    assert why in said


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_a_controller_that_is_stopped_or_killed_moves_nothing_any_more(
    line: Line, number: signal.Signals
) -> None:
    with controller(line, "asleep") as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.send_signal(number)
        line.wait_s(0.0)


def test_a_run_that_is_broken_off_has_every_wire_stopped(line: Line) -> None:
    async def story() -> None:
        devices = cast(Any, SimpleNamespace(arm=UmiScara(line.path), gripper=None, io=None))
        watch = Supervised(devices, CellClock(), "", lambda: True, lambda _: None)
        async with watch.beating():
            raise KeyboardInterrupt  # as a second Ctrl-C does

    with pytest.raises(KeyboardInterrupt):
        asyncio.run(story())
    line.wait_s(0.0)


def test_an_order_to_stop_is_taken_by_the_supervisor_and_answered_by_the_run(
    line: Line, tmp_path: Path
) -> None:
    taken = []

    async def handle(peer: Peer, method: str, path: str, body: bytes) -> tuple[int, bytes]:
        taken.append((peer.pid, method, path, body))
        return 200, b"{}"

    async def story() -> tuple[str, bytes]:
        devices = cast(Any, SimpleNamespace(arm=UmiScara(line.path), gripper=None, io=None))
        told: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        place = tmp_path / "control"
        async with serving(place, handle, STOPS) as callers:
            watch = Supervised(devices, CellClock(), "", lambda: True, told.set_result, callers)
            async with watch.beating():
                await asyncio.sleep(0)  # the heartbeat has begun
                with socket.socket(socket.AF_UNIX) as caller:
                    caller.settimeout(LONG_S)
                    caller.connect(str(place))
                    caller.sendall(b"POST /stop HTTP/1.1\r\nHost: x\r\nContent-Length: 2\r\n\r\n{}")
                    line.wait_s(0.0)  # on the event loop, which does nothing else meanwhile
                    async with asyncio.timeout(LONG_S):
                        return await told, await asyncio.to_thread(caller.recv, 100)

    said, answer = asyncio.run(story())
    assert "`POST /stop` was asked" in said
    assert answer.startswith(b"HTTP/1.1 200")
    assert taken == [(os.getpid(), "POST", "/stop", b"{}")]


def test_a_supervisor_that_ends_is_known_at_once(line: Line) -> None:
    async def story() -> str:
        devices = cast(Any, SimpleNamespace(arm=UmiScara(line.path), gripper=None, io=None))
        told: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        watch = Supervised(devices, CellClock(), "", lambda: True, told.set_result)
        async with watch.beating():
            assert watch.pid is not None
            os.kill(watch.pid, signal.SIGKILL)
            async with asyncio.timeout(LONG_S):
                return await told

    assert "supervisor has ended" in asyncio.run(story())
