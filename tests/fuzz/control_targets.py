"""The control socket under fuzzing: what anyone sends a run, and what a run returns to a command.

The first byte of an input chooses the circumstances; the rest is what goes over the socket.
"""

import asyncio
import json
import socket
import tempfile
import threading
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import h11

from controller.cell.batch import CellStatus
from controller.cell.control import (
    AnswerOrder,
    ControlError,
    PauseOrder,
    RunningCell,
)
from controller.cell.control.serving import Control, Door, document, handle_for
from controller.cell.custody import Custody
from controller.cell.journal.rows import FirstMotion
from controller.cell.lock import Holder, hold_cell
from controller.cell.machine import Event, MachineDecision, PauseKind, SafePoint
from controller.cell.operator import Choice, Desk, Question
from controller.config import load_cell

ROOT = Path(__file__).resolve().parents[2]
CELL = ROOT / "recipes" / "cells" / "emulated.yaml"
HOLDER = Holder("run-1", "me", "here", 1, "now", "")
QUESTION = Question(
    "part_left",
    "what is in the gripper?",
    (Choice("look", "look again"), Choice("ack", "go on")),
    (("look", "the arm, 3 mm"),),
)
NEXT = FirstMotion(words="the arm to the camera", tcp_mm=12.5, turn_deg=3.0, seconds=1.5)
STATUS = CellStatus(
    at_s=12.3456,
    state="execute_grasping",
    label="grasp",
    step=1,
    step_count=9,
    custody=Custody.IN_ARM,
    remaining_s=None,
    message="",
    alarm="",
    point=SafePoint.LIFTED,
    wanted=PauseKind.NOW,
    pause_s=dict.fromkeys(PauseKind),
    first=NEXT,
)


@dataclass
class Orders:
    """A cell that takes every order and keeps it."""

    state: str = "execute_grasping"
    taken: list[tuple[Event, str, str]] = field(default_factory=list)

    async def command(
        self, event: Event, who: str, why: str = "", message: str = "", code: str = ""
    ) -> MachineDecision:
        self.taken.append((event, who, why))
        return MachineDecision("handled", self.state, self.state)

    async def status(self) -> CellStatus:
        return STATUS


class Pieces:
    """Bytes as they arrive: in pieces of one size, then the other end has left."""

    def __init__(self, data: bytes, size: int) -> None:
        self._data, self._size = data, size

    async def read(self, most: int) -> bytes:
        size = min(most, self._size)
        piece, self._data = self._data[:size], self._data[size:]
        return piece


class Written:
    """Keeps what is answered."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.is_closed = False

    def write(self, data: bytes) -> None:
        self.data += data

    def get_extra_info(self, name: str) -> socket.socket:
        return _pair()[0]

    def write_eof(self) -> None:
        pass

    async def drain(self) -> None:
        pass

    def close(self) -> None:
        self.is_closed = True

    def is_closing(self) -> bool:
        return self.is_closed

    async def wait_closed(self) -> None:
        pass


@cache
def _pair() -> tuple[socket.socket, socket.socket]:
    return socket.socketpair(socket.AF_UNIX)


@cache
def _loop() -> asyncio.AbstractEventLoop:
    return asyncio.new_event_loop()


@cache
def _statuses() -> frozenset[int]:
    """Return the statuses that the description of the socket names, but a bug's."""
    paths: Mapping[str, Mapping[str, Any]] = document()["paths"]
    named = {int(s) for one in paths.values() for do in one.values() for s in do["responses"]}
    return frozenset(named - {500})


def control_requests(data: bytes) -> None:
    """Send a run's control socket any bytes; it gives one answer that a client can read."""
    if not data:
        return
    orders, written, desk = Orders(), Written(), Desk(is_attended=True)
    control = Control("run-1", HOLDER, desk)
    if data[0] & 1:
        control.attach(orders)  # type: ignore[arg-type]  # what the endpoints call of it

    async def serve() -> None:
        asked = asyncio.ensure_future(desk.decide(QUESTION))
        await asyncio.sleep(0)
        pieces = Pieces(data[1:], 1 << (data[0] >> 1) % 13)
        try:
            await Door(handle_for(control)).on_connection(pieces, written)  # type: ignore[arg-type]
        finally:
            desk.leave()
            await asked

    _loop().run_until_complete(serve())
    assert written.is_closed
    if not written.data:
        assert not data[1:].strip(b"\r\n"), "no answer to one who did not leave without a request"
        return
    status, body = _answer(bytes(written.data))
    assert status in _statuses(), (status, body)
    assert len(orders.taken) <= (status in (200, 409))


def _answer(data: bytes) -> tuple[int, bytes]:
    """Return status and body of the only answer in the data, as an HTTP client reads it."""
    wire = h11.Connection(h11.CLIENT)
    wire.send(h11.Request(method="GET", target="/", headers=[("Host", "x")]))
    wire.send(h11.EndOfMessage())
    wire.receive_data(data)
    wire.receive_data(b"")
    answer = wire.next_event()
    assert isinstance(answer, h11.Response), answer
    body = b""
    while isinstance(event := wire.next_event(), h11.Data):
        body += event.data
    assert isinstance(event, h11.EndOfMessage), event
    assert isinstance(json.loads(body or b"{}"), dict)
    return answer.status_code, body


class _Run:
    """A run that has the cell's lock and answers every request with the same bytes."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="fuzz-control-"))
        self.data = b""
        self._listener = socket.socket(socket.AF_UNIX)
        place = self.folder / "s"
        self._listener.bind(str(place))
        self._listener.listen()
        self._held = ExitStack()
        self._held.enter_context(hold_cell(self.folder, load_cell(CELL), "run-1", place))
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        while True:
            line, _ = self._listener.accept()
            with line, suppress(OSError):
                line.recv(1 << 16)
                line.sendall(self.data)
                line.shutdown(socket.SHUT_WR)
                line.recv(1 << 16)


@cache
def _run() -> _Run:
    return _Run()


def control_replies(data: bytes) -> None:
    """Answer a command that asks a running cell with any bytes."""
    run = _run()
    run.data = data[1:]
    cell = RunningCell(run.folder)
    with suppress(ControlError):
        match data[0] % 3 if data else 0:
            case 0:
                cell.status()
            case 1:
                cell.order("pause", PauseOrder(why="fuzz"))
            case _:
                cell.order("answer", AnswerOrder(key="look"))
