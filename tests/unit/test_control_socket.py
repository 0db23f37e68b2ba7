"""The control socket over its real wire: who may speak, what is taken, what an answer never has."""

from __future__ import annotations

import asyncio
import json
import os
import re
import socket
import stat
import threading
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path
from typing import Any

import h11
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.cell.batch import CellStatus
from controller.cell.control import (
    AnswerOrder,
    ControlError,
    NoRunError,
    PauseOrder,
    RunningCell,
    make_folder,
    socket_path,
)
from controller.cell.control.peer import Peer
from controller.cell.control.serving import (
    ENDPOINTS,
    MAX_BODY_BYTES,
    MAX_CONNECTION_COUNT,
    Control,
    document,
    document_bytes,
    handle_for,
    serving,
)
from controller.cell.control.serving import server as server_module
from controller.cell.custody import Custody
from controller.cell.journal.rows import FirstMotion
from controller.cell.lock import LOCK_NAME, Holder, hold_cell, read_holder
from controller.cell.machine import Event, MachineDecision
from controller.cell.operator import Answer, Choice, Desk, Question
from controller.config import load_cell
from messages.form import SAID, from_said

ROOT = Path(__file__).parents[2]
ME = Peer(os.getpid(), os.getuid())
HOLDER = Holder("run-1", "me", "here", 1, "now", "")


class Dispatching:
    """Takes every order as the test has it, and keeps it."""

    def __init__(self, decision: MachineDecision | None = None) -> None:
        self.decision = decision or MachineDecision(
            "handled", "execute_grasping", "suspending_grasping"
        )
        self.taken: list[tuple[Event, str, str]] = []
        self.state = "execute_grasping"

    async def command(
        self, event: Event, who: str, why: str = "", message: str = "", code: str = ""
    ) -> MachineDecision:
        self.taken.append((event, who, why))
        return self.decision

    async def status(self) -> Any:
        raise ZeroDivisionError("a bug")


def control_of(dispatcher: Any = None, desk: Desk | None = None) -> Control:
    control = Control("run-1", HOLDER, desk or Desk(is_attended=True))
    if dispatcher is not None:
        control.attach(dispatcher)
    return control


async def ask(control: Control, method: str, path: str, body: object = None) -> tuple[int, Any]:
    packed = b"" if body is None else json.dumps(body).encode()
    status, reply = await handle_for(control)(ME, method, path, packed)
    return status, from_said(json.loads(reply))


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    make_folder()
    return socket_path(tmp_path / "runs")


async def exchange(place: Path, data: bytes) -> tuple[int, Any]:
    """Send bytes as they are; return status and body of the answer."""
    reader, writer = await asyncio.open_unix_connection(str(place))
    writer.write(data)
    await writer.drain()
    writer.write_eof()
    wire = h11.Connection(h11.CLIENT)
    wire.send(h11.Request(method="GET", target="/", headers=[("Host", "x")]))
    wire.receive_data(await reader.read())
    wire.receive_data(b"")
    writer.close()
    status, body = 0, b""
    while True:
        event = wire.next_event()
        if isinstance(event, h11.Response):
            status = event.status_code
        elif isinstance(event, h11.Data):
            body += event.data
        else:
            return status, from_said(json.loads(body))


def request(method: str, path: str, body: bytes = b"", *more: str) -> bytes:
    head = [f"{method} {path} HTTP/1.1", "Host: x", f"Content-Length: {len(body)}", *more, "", ""]
    return "\r\n".join(head).encode() + body


async def test_an_order_goes_to_the_dispatcher_with_who_and_why() -> None:
    dispatcher = Dispatching()
    control = control_of(dispatcher)
    body = {"kind": "now", "who": "Ada", "why": "a screw on the table"}
    status, reply = await ask(control, "POST", "/pause", body)
    assert (status, reply["decision"], reply["state"]) == (200, "handled", "suspending_grasping")
    assert dispatcher.taken == [
        (Event.PAUSE_NOW, f"Ada ({ME.name})", "a screw on the table"),
    ]  # fmt: skip


async def test_work_without_a_dispatcher_is_stopped_by_an_order_and_nothing_else() -> None:
    control, stopped = control_of(), []
    assert (await ask(control, "POST", "/stop"))[1]["reason"].startswith("the run is starting")
    control.attach_stop(lambda message, code: stopped.append((message, code)))
    status, reply = await ask(control, "POST", "/pause", {})
    assert (status, reply["decision"]) == (409, "refused")
    for path, code in (("/stop", "stop"), ("/abort", "aborted")):
        status, reply = await ask(control, "POST", path, {"why": "smoke"})
        assert (status, reply["decision"]) == (200, "handled")
        assert stopped.pop() == (f"{path[1:]}{'p' * (code == 'stop')}ed by {ME.name}: smoke", code)


HERE, THERE = (0.5, -0.25, 0.5, -100.0, -1.0, 0.25), (0.25, 0.5, 0.25, -300.0, -0.5, 0.5)


@pytest.mark.parametrize(
    ("first", "waypoints"),
    [
        (
            FirstMotion(words="the arm", origin=HERE, goal=THERE, tcp_mm=3.0),
            [list(HERE), list(THERE)],
        ),
        (FirstMotion(words="the jaws close"), []),
        (FirstMotion(words="the arm homes"), []),
    ],
)
async def test_what_moves_first_has_the_joints_where_it_begins_and_ends(
    first: FirstMotion, waypoints: list[list[float]]
) -> None:
    dispatcher = Dispatching()
    dispatcher.status = standing(first)  # type: ignore[method-assign]
    status, reply = await ask(control_of(dispatcher), "GET", "/status")
    assert status == 200
    assert reply["first_motion"]["words"] == first.words
    assert reply["first_motion"]["waypoints"] == waypoints


def standing(first: FirstMotion) -> Callable[[], Awaitable[CellStatus]]:
    """Return what reads the status of a cell that is paused before a motion."""

    async def status() -> CellStatus:
        return CellStatus(
            at_s=1.0, state="suspended_grasping", label="grasp", step=1, step_count=2,
            custody=Custody.ON_TABLE, remaining_s=None, message="", alarm="", point=None,
            wanted=None, pause_s={}, first=first,
        )  # fmt: skip

    return status


@pytest.mark.parametrize(
    ("path", "body", "event"),
    [
        ("/pause", {"kind": "step"}, Event.PAUSE_AFTER_STEP),
        ("/pause", {}, Event.PAUSE_AT_SAFE_POINT),
        ("/resume", {}, Event.RESUME),
        ("/step", {}, Event.STEP),
        ("/stop", {}, Event.STOP),
        ("/abort", {}, Event.FAULT),
    ],
)
async def test_each_path_is_one_event(path: str, body: dict[str, str], event: Event) -> None:
    dispatcher = Dispatching()
    await ask(control_of(dispatcher), "POST", path, body)
    assert [taken[0] for taken in dispatcher.taken] == [event]


async def test_a_refusal_says_why_and_is_no_success() -> None:
    refused = MachineDecision("refused", "resetting", "resetting", reason="homing goes on")
    status, reply = await ask(control_of(Dispatching(refused)), "POST", "/pause", {})
    assert (status, reply["reason"]) == (409, "homing goes on")


async def test_a_status_names_the_socket_that_it_came_from(place: Path, tmp_path: Path) -> None:
    cell = load_cell(ROOT / "recipes/cells/emulated.yaml")
    runs = tmp_path / "runs"
    with hold_cell(runs, cell, "run-1", place) as holder:
        control = Control("run-1", holder, Desk(is_attended=True))
        async with serving(place, handle_for(control)):
            found = await asyncio.to_thread(RunningCell(runs).status)
            assert found.holder.control == str(place)
            assert (await exchange(Path(found.holder.control), request("GET", "/status")))[0] == 200


async def test_before_the_devices_are_connected_orders_are_refused() -> None:
    status, reply = await ask(control_of(), "POST", "/stop", {})
    assert (status, reply["state"]) == (409, "starting")
    status, reply = await ask(control_of(), "GET", "/status")
    assert (status, reply["state"], reply["pause_seconds"]) == (200, "starting", {})


@pytest.mark.parametrize(
    ("method", "path", "body", "status", "words"),
    [
        ("GET", "/", None, 404, "no such endpoint"),
        ("GET", "/pause", None, 405, "takes POST"),
        ("POST", "/status", {}, 405, "takes GET"),
        ("POST", "/openapi.json", {}, 405, "takes GET"),
        ("POST", "/pause", {"kind": "later"}, 422, "kind"),
        ("POST", "/pause", {"sort": "now"}, 422, "sort"),
        ("POST", "/pause", ["now"], 422, "body"),
        ("POST", "/pause", {"why": "x" * 2000}, 422, "why"),
        ("POST", "/ack", {}, 422, "why"),
        ("POST", "/answer", {"key": ""}, 422, "key"),
    ],
)
async def test_what_is_wrong_is_named_and_reaches_no_cell(
    method: str, path: str, body: Any, status: int, words: str
) -> None:
    dispatcher = Dispatching()
    found, reply = await ask(control_of(dispatcher), method, path, body)
    assert found == status
    assert words in reply["error"]
    assert dispatcher.taken == []


async def test_an_acknowledgement_that_no_question_waits_for_goes_to_the_run() -> None:
    dispatcher = Dispatching()
    await ask(control_of(dispatcher), "POST", "/ack", {"why": "looked"})
    assert dispatcher.taken == [(Event.ACKNOWLEDGE, ME.name, "looked")]


async def test_the_first_answer_counts_and_the_second_is_told_so() -> None:
    desk = Desk(is_attended=True)
    control = control_of(Dispatching(), desk)
    choices = (Choice("look", "look again"), Choice("stop", "end"))
    waiting = asyncio.create_task(desk.decide(Question("no_part", "no part", choices)))
    await asyncio.sleep(0)
    _, shown = await ask(control_of(desk=desk), "GET", "/status")
    assert [one["key"] for one in shown["question"]["choices"]] == ["look", "stop"]
    status, reply = await ask(control, "POST", "/answer", {"key": "run"})
    assert (status, "look, stop" in reply["reason"]) == (409, True)
    status, reply = await ask(control, "POST", "/answer", {"key": "look", "number": 7})
    assert status == 409
    assert (await ask(control, "POST", "/recover", {"key": "look"}))[0] == 409
    status, _ = await ask(control, "POST", "/answer", {"key": "look", "why": "laid it back"})
    assert status == 200
    late = desk.answer(None, Answer("stop", "somebody else"))
    assert late == "there is no question to answer"
    answer = await waiting
    assert answer == Answer("look", ME.name, "laid it back")


async def test_a_question_without_anybody_is_not_raised_and_one_that_is_left_ends() -> None:
    question = Question("no_part", "no part", (Choice("stop", "end"),))
    assert await Desk(is_attended=False).decide(question) is None
    desk = Desk(is_attended=True)
    waiting = asyncio.create_task(desk.decide(question))
    await asyncio.sleep(0)
    desk.leave()
    assert await waiting is None
    assert desk.open is None


async def test_a_bug_gives_a_sentence_and_no_traceback(place: Path) -> None:
    async with serving(place, handle_for(control_of(Dispatching()))):
        status, reply = await exchange(place, request("GET", "/status"))
    assert (status, reply) == (500, {"error": "internal error; the log has its details"})


async def test_socket_and_folder_are_the_users_alone_and_go_with_the_run(place: Path) -> None:
    await asyncio.to_thread(place.write_text, "left by a process that was killed")
    async with serving(place, handle_for(control_of())):
        found, folder = os.stat(place), os.stat(place.parent)  # noqa: PTH116  (async)
        assert stat.S_ISSOCK(found.st_mode)
        assert stat.S_IMODE(found.st_mode) == 0o600
        assert stat.S_IMODE(folder.st_mode) == 0o700
    assert place.name not in os.listdir(place.parent)  # noqa: PTH208  (async)


def test_a_folder_that_others_may_enter_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    make_folder().chmod(0o755)
    with pytest.raises(ControlError, match="others may enter it; chmod 700"):
        make_folder()
    (tmp_path / "cellctl").rmdir()
    (tmp_path / "cellctl").symlink_to("/tmp")
    with pytest.raises(ControlError):
        make_folder()


async def test_another_user_is_not_heard(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    dispatcher = Dispatching()
    monkeypatch.setattr(server_module, "peer_of", lambda _: Peer(1, os.getuid() + 1))
    async with serving(place, handle_for(control_of(dispatcher))):
        status, reply = await exchange(place, request("POST", "/stop", b"{}"))
    assert (status, reply["error"]) == (403, "this cell belongs to another user")
    assert dispatcher.taken == []


@pytest.mark.parametrize(
    ("data", "status"),
    [
        (b"\x00\x01\x02\r\n\r\n", 400),
        (b"GET /status\r\n\r\n", 400),
        (request("POST", "/stop", b"{}", "X: " + "y" * 20_000), 431),
        (request("POST", "/stop", b" " * (MAX_BODY_BYTES + 1)), 413),
        (b"POST /stop HTTP/1.1\r\nHost: x\r\nContent-Length: 50\r\n\r\n{}", 400),
        (request("POST", "/stop", b"\xff\xfe"), 422),
        (request("POST", "/stop", b"[" * 10_000), 422),
    ],
)
async def test_bytes_that_are_no_request_move_nothing(
    place: Path, data: bytes, status: int
) -> None:
    dispatcher = Dispatching()
    async with serving(place, handle_for(control_of(dispatcher))):
        found, reply = await exchange(place, data)
    assert (found, set(reply)) == (status, {"error"})
    assert dispatcher.taken == []


async def test_an_answer_to_head_has_no_body(place: Path) -> None:
    dispatcher = Dispatching()
    async with serving(place, handle_for(control_of(dispatcher))):
        reader, writer = await asyncio.open_unix_connection(str(place))
        writer.write(request("HEAD", "/stop", b"{}"))
        head, _, body = (await reader.read()).partition(b"\r\n\r\n")
        writer.close()
    assert head.startswith(b"HTTP/1.1 405")
    assert (body, dispatcher.taken) == (b"", [])


async def test_somebody_who_sends_nothing_is_sent_away(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server_module, "IO_LIMIT_WALL_S", 0.05)
    async with serving(place, handle_for(control_of())):
        reader, writer = await asyncio.open_unix_connection(str(place))
        assert (await reader.read()).startswith(b"HTTP/1.1 408")
        writer.close()


@pytest.mark.parametrize("begun", [b"", b"POST /stop HTTP/1.1\r\nHost: x\r\n"])
async def test_idle_connections_keep_no_status_and_no_stop_out(place: Path, begun: bytes) -> None:
    dispatcher = Dispatching()
    control = control_of(dispatcher)
    dispatcher.status = standing(FirstMotion(words="the jaws close"))  # type: ignore[method-assign]
    async with serving(place, handle_for(control)):
        held = []
        for _ in range(3 * MAX_CONNECTION_COUNT):
            held.append(await asyncio.open_unix_connection(str(place)))
            held[-1][1].write(begun)
        assert (await exchange(place, request("GET", "/status")))[0] == 200
        assert (await exchange(place, request("POST", "/stop", b"{}")))[0] == 200
        assert await held[0][0].read() == b""  # the oldest ended, and was told nothing
        for _, writer in held:
            writer.close()
    assert [event for event, *_ in dispatcher.taken] == [Event.STOP]


async def test_another_process_keeps_its_place_while_one_opens_more_and_more(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dispatcher = Dispatching()
    pids = iter([1, *[2] * 3 * MAX_CONNECTION_COUNT])
    monkeypatch.setattr(server_module, "peer_of", lambda _: Peer(next(pids), os.getuid()))
    async with serving(place, handle_for(control_of(dispatcher))):
        reader, writer = await asyncio.open_unix_connection(str(place))
        held = [
            await asyncio.open_unix_connection(str(place)) for _ in range(3 * MAX_CONNECTION_COUNT)
        ]
        assert await held[0][0].read() == b""
        writer.write(request("POST", "/stop", b"{}"))
        assert (await reader.read()).startswith(b"HTTP/1.1 200")
        for _, one in (*held, (reader, writer)):
            one.close()


async def test_requests_that_read_leave_the_places_of_orders_free(place: Path) -> None:
    dispatcher = Dispatching()
    answers, all_asked = asyncio.Event(), asyncio.Event()
    asked = 0

    async def handle(peer: Peer, method: str, path: str, body: bytes) -> tuple[int, bytes]:
        nonlocal asked
        if method == "GET":
            asked += 1
            if asked == MAX_CONNECTION_COUNT:
                all_asked.set()
            await answers.wait()  # a device that takes its time
        return await handle_for(control_of(dispatcher))(peer, method, path, body)

    async with serving(place, handle):
        reading = request("GET", "/openapi.json")
        waiting = [
            asyncio.create_task(exchange(place, reading)) for _ in range(MAX_CONNECTION_COUNT)
        ]
        await all_asked.wait()
        status, reply = await exchange(place, reading)
        assert (status, f"{MAX_CONNECTION_COUNT} such requests" in reply["error"]) == (503, True)
        assert (await exchange(place, request("POST", "/stop", b"{}")))[0] == 200
        answers.set()
        assert {status for status, _ in await asyncio.gather(*waiting)} == {200}
        assert (await exchange(place, reading))[0] == 200


@given(data=st.binary(max_size=300), path=st.sampled_from([b"/status", b"/stop", b"/answer"]))
@settings(max_examples=100, deadline=None)
def test_any_body_gets_an_answer_that_is_json(data: bytes, path: bytes) -> None:
    dispatcher = Dispatching()

    async def run() -> tuple[int, bytes]:
        handle = handle_for(control_of(dispatcher if path != b"/status" else None))
        return await handle(ME, "GET" if path == b"/status" else "POST", path.decode(), data)

    status, body = asyncio.run(run())
    assert status in (200, 409, 422)
    assert isinstance(json.loads(body), dict)


# --- the description ------------------------------------------------------------------------------


def test_the_description_is_the_one_that_is_stored_and_served() -> None:
    stored = (ROOT / "docs" / "control-api.json").read_bytes()
    advice = "run: python -m controller.cell.control.serving > docs/control-api.json"
    assert stored == document_bytes(), advice
    status, body = asyncio.run(handle_for(control_of())(ME, "GET", "/openapi.json", b""))
    assert (status, body) == (200, stored)


def test_the_description_has_every_endpoint_and_its_references_resolve() -> None:
    drawn = document()
    listed = {(path, method) for path, one in drawn["paths"].items() for method in one}
    assert listed == {
        ("/status", "get"), *((f"/{name}", "post") for name in (
            "pause", "resume", "step", "stop", "abort", "ack", "answer", "recover"
        )),
    }  # fmt: skip
    assert len(ENDPOINTS) == len(listed)
    schemas = drawn["components"]["schemas"]
    for name in re.findall(r"#/components/schemas/(\w+)", json.dumps(drawn)):
        assert name in schemas, name


async def test_answers_are_as_they_are_described() -> None:
    schemas = document()["components"]["schemas"]
    for control, method, path, model in (
        (control_of(), "GET", "/status", "StatusReply"),
        (control_of(Dispatching()), "POST", "/stop", "DecisionReply"),
        (control_of(), "POST", "/nothing", "ErrorReply"),
    ):
        _, reply = await ask(control, method, path, None if method == "GET" else {})
        assert SAID not in reply  # it stands beside sentences, and `ask` has put it into them
        assert {*reply, SAID} == set(schemas[model]["properties"]), model


# --- the other end --------------------------------------------------------------------------------


@pytest.fixture
async def served(place: Path) -> AsyncIterator[Callable[[Any], Any]]:
    """Serve in this loop; ask from a thread, as another process would."""
    dispatcher = Dispatching()

    async def from_a_thread(call: Callable[[], Any]) -> Any:
        return await asyncio.to_thread(call)

    async with serving(place, handle_for(control_of(dispatcher))):
        yield from_a_thread


async def test_a_command_finds_the_run_by_the_lock_whatever_its_own_environment(
    tmp_path: Path, place: Path, served: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = tmp_path / "runs"
    cell = load_cell(ROOT / "recipes/cells/emulated.yaml")
    with hold_cell(runs, cell, "run-1", place) as holder:
        monkeypatch.delenv("XDG_RUNTIME_DIR")
        assert read_holder(runs / LOCK_NAME) == holder
        assert (holder.pid, holder.run) == (os.getpid(), "run-1")
        reply = await served(lambda: RunningCell(runs).order("pause", PauseOrder(kind="now")))
        assert (reply.decision, reply.state) == ("handled", "suspending_grasping")
        reply = await served(lambda: RunningCell(runs).order("answer", AnswerOrder(key="x")))
        assert (reply.decision, reply.reason) == ("refused", "there is no question to answer")
    assert read_holder(runs / LOCK_NAME) is None
    with pytest.raises(NoRunError, match="no run at this cell"):
        RunningCell(runs).status()


def test_a_holder_without_a_socket_is_named(tmp_path: Path) -> None:
    cell = load_cell(ROOT / "recipes/cells/emulated.yaml")
    with (
        hold_cell(tmp_path, cell, "recover"),
        pytest.raises(ControlError, match=r"run recover of \S+ \(process \d+ on"),
    ):
        RunningCell(tmp_path).status()


@pytest.mark.parametrize("answer", [b"", b"garbage\r\n\r\n", b"HTTP/1.1 200 OK\r\n\r\nnot json"])
def test_an_answer_that_makes_no_sense_is_one_sentence(
    tmp_path: Path, place: Path, answer: bytes
) -> None:
    cell = load_cell(ROOT / "recipes/cells/emulated.yaml")
    listening = socket.socket(socket.AF_UNIX)
    listening.bind(str(place))
    listening.listen()

    def reply() -> None:
        other, _ = listening.accept()
        other.recv(4096)
        other.sendall(answer)
        other.close()

    thread = threading.Thread(target=reply)
    thread.start()
    with hold_cell(tmp_path, cell, "run-1", place), pytest.raises(ControlError):
        RunningCell(tmp_path).status()
    thread.join()
    listening.close()
