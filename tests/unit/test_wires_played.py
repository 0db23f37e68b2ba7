"""Lines and cameras played back: the same requests are answered, the first other byte is found.

The Modbus frames are the standard's own example (V1.1b3, 6.3): registers 0x6B to 0x6D of unit 17.
"""

import asyncio
import errno
from collections.abc import Callable, Coroutine
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from controller.config import ConfigError, load_cell
from controller.recorded_wires import WireReader, WireWriter, require_recorded
from controller.recorded_wires.cameras import PlayedCamera
from controller.recorded_wires.lines import OVERDUE_S, PlayedLine, Tape
from controller.recorded_wires.loop import WireLoop
from controller.virtual_time import NothingLeftError
from drivers.clock import CellClock
from drivers.errors import DeviceError, UnpluggedError
from drivers.modbus_link import ModbusLink, TcpAddress, VerbLock

ASKED = bytes.fromhex("0001 0000 0006 11 03 006B 0003")
ANSWERED = bytes.fromhex("0001 0000 0009 11 03 06 022B 0000 0064")
WORDS = "unit 17 read_holding_registers 0x006B x 3"
Rows = list[tuple[float, str, str, Any, bytes]]


def tape_of(tmp_path: Path, rows: Rows, *, is_whole: bool = True, speed: float = 1.0) -> Tape:
    writer = WireWriter(tmp_path / "run.wires")
    for row in rows:
        writer.write(*row)
    if is_whole:
        writer.write(rows[-1][0] + 10.0, "run", "end")
    writer.close()
    reader = WireReader(writer.path)
    return Tape(reader, WireLoop(rows[0][0] / speed), speed)


def run(tape: Tape, work: Callable[[], Coroutine[Any, Any, Any]]) -> Any:
    try:
        return tape.loop.run_until_complete(work())
    finally:
        tape.loop.close()
        tape.reader.close()


def one_exchange(at_s: float = 5.0) -> Rows:
    return [
        (at_s - 1, "journal", "row", [7, "intent", "grip"], b""),
        (at_s - 1, "line", "opened", None, b""),
        (at_s, "line", "turn", [WORDS, "batch"], b""),
        (at_s, "line", "sent", None, ASKED),
        (at_s + 0.01, "line", "got", None, ANSWERED),
        (at_s + 1, "journal", "row", [8, "outcome", "gripped"], b""),
    ]


def link_of(tape: Tape) -> ModbusLink:
    line = PlayedLine(tape, "line")
    tape.loop.ports["wires", 1] = line.connect
    clock = CellClock(speed=tape.speed, monotonic=tape.loop.time)
    return ModbusLink(TcpAddress("wires", 1), clock, tap=line)


async def read(tape: Tape, first: int, count: int) -> tuple[int, ...]:
    tape.callers.begin()
    unit = link_of(tape).unit(17, "unit")
    return await unit.read_holding_registers(first, count)


@pytest.mark.parametrize("speed", [1.0, 20.0])
def test_the_same_request_gets_the_recorded_reply_at_its_instant(
    tmp_path: Path, speed: float
) -> None:
    tape = tape_of(tmp_path, one_exchange(), speed=speed)
    assert run(tape, lambda: read(tape, 0x6B, 3)) == (0x022B, 0, 0x64)
    assert tape.difference is None
    assert tape.request_count == 1
    assert tape.now_s == pytest.approx(5.01)


def test_the_first_byte_that_differs_is_found_with_what_came_before(tmp_path: Path) -> None:
    tape = tape_of(tmp_path, one_exchange())
    with pytest.raises(DeviceError):
        run(tape, lambda: read(tape, 0x6B, 4))
    found = tape.difference
    assert found is not None
    assert found.recorded == ASKED
    assert found.sent == ASKED[:-1] + b"\x04"
    assert found.byte == len(ASKED) - 1
    assert (found.wire, found.at_s, found.after_row) == ("line", 5.0, (7, "intent", "grip"))
    assert found.recorded_words == WORDS
    assert found.sent_words == "unit 17 read_holding_registers 0x006B x 4"


def test_a_request_after_the_last_recorded_one_is_a_difference(tmp_path: Path) -> None:
    tape = tape_of(tmp_path, one_exchange())

    async def twice() -> None:
        tape.callers.begin()
        unit = link_of(tape).unit(17, "unit")
        await unit.read_holding_registers(0x6B, 3)
        await unit.read_holding_registers(0x6B, 3)

    with pytest.raises(DeviceError):
        run(tape, twice)
    assert tape.difference is not None
    assert tape.difference.recorded is None
    assert tape.difference.sent is not None
    assert tape.difference.sent[2:] == ASKED[2:]


def test_a_recording_that_was_killed_ends_without_a_difference(tmp_path: Path) -> None:
    tape = tape_of(tmp_path, one_exchange()[:3], is_whole=False)
    with pytest.raises(DeviceError):
        run(tape, lambda: read(tape, 0x6B, 3))
    assert tape.difference is None
    assert tape.has_run_out


def test_who_comes_first_goes_second_if_that_is_what_was_recorded(tmp_path: Path) -> None:
    rows: Rows = [
        (1.0, "line", "turn", ["second", "batch"], b""),
        (2.0, "line", "turn", ["first", "batch"], b""),
    ]
    tape = tape_of(tmp_path, rows)
    seen: list[tuple[str, float]] = []

    async def take(line: PlayedLine, what: str) -> None:
        await line.turn(what)
        seen.append((what, round(tape.now_s, 6)))

    async def work() -> None:
        line = PlayedLine(tape, "line")
        await asyncio.gather(take(line, "first"), take(line, "second"))

    run(tape, work)
    assert seen == [("second", pytest.approx(1.0, abs=0.1)), ("first", pytest.approx(2.0, abs=0.1))]


async def polling(line: PlayedLine, seen: list[str]) -> None:
    await asyncio.sleep(0.5)
    await line.turn("poll")
    seen.append("poll")


async def reading(line: PlayedLine, verbs: PlayedLine, seen: list[str]) -> None:
    await verbs.turn("read")
    await line.turn("read")
    seen.append("read")


def test_turns_of_one_instant_keep_their_order_though_the_second_waits_on_another_line(
    tmp_path: Path,
) -> None:
    # the clock was held; the first one waits for this instant when the second comes to the line
    rows: Rows = [
        (1.0, "journal", "row", [1, "event", "grasped"], b""),
        (2.0, "line", "turn", ["poll", "polling"], b""),
        (2.0, "verbs", "turn", ["read", "reading"], b""),
        (2.0, "line", "turn", ["read", "reading"], b""),
    ]
    tape = tape_of(tmp_path, rows)
    seen: list[str] = []

    async def work() -> None:
        line, verbs = PlayedLine(tape, "line"), PlayedLine(tape, "verbs")
        both = (reading(line, verbs, seen), polling(line, seen))
        await asyncio.gather(*map(asyncio.ensure_future, both))

    run(tape, work)
    assert seen == ["poll", "read"]
    assert tape.now_s == pytest.approx(2.0)


def test_who_is_not_next_goes_on_once_the_next_one_is_overdue(tmp_path: Path) -> None:
    tape = tape_of(tmp_path, [(3.0, "line", "turn", ["never", "batch"], b"")])

    async def work() -> float:
        await PlayedLine(tape, "line").turn("other")
        return tape.now_s

    assert run(tape, work) == pytest.approx(3.0 + OVERDUE_S)


def polled_once_more(done_s: float) -> Rows:
    """Return a poll of a watcher on the arm's line at 1.0 s, then a stop by the batch."""
    rows: Rows = [
        (0.1, "journal", "row", [6, "intent", "let_go"], b""),
        (done_s, "journal", "row", [7, "outcome", "let_go"], b""),
        (done_s + 0.1, "journal", "row", [8, "outcome", "part_done"], b""),
        (1.0, "arm", "turn", ["IP1 4C", "Watcher.run"], b""),
        (1.0, "arm", "sent", None, b"\x4c"),
        (1.01, "arm", "got", None, b"\x8e\xa0\x04"),
        (9.0, "arm", "turn", ["stop 24", "batch"], b""),
        (9.0, "arm", "sent", None, b"\x24"),
        (9.01, "arm", "got", None, b"\x00"),
        (9.05, "journal", "row", [9, "event", "run_ended"], b""),
    ]
    return sorted(rows, key=lambda row: row[0])


def stopped_without_a_poll(tmp_path: Path, rows: Rows, request: bytes = b"\x24") -> Tape:
    """Play rows, at whose end a run ends; the replay sends the stop alone."""
    writer = WireWriter(tmp_path / "run.wires")
    for row in (*rows, (rows[-1][0] + 0.1, "run", "end", None, b"")):
        writer.write(*row)
    writer.close()
    tape = Tape(WireReader(writer.path), WireLoop(rows[0][0]), 1.0)

    async def stop() -> None:
        tape.callers.begin()
        line = PlayedLine(tape, "arm")
        transport: Any = line.opening(object)
        await line.turn("stop 24")
        transport.write(request)
        assert await transport.read(1.0) == b"\x00"
        assert tape.now_s == pytest.approx(9.01)

    with suppress(UnpluggedError):
        run(tape, stop)
    return tape


def test_a_poll_after_the_last_deed_may_be_missing(tmp_path: Path) -> None:
    tape = stopped_without_a_poll(tmp_path, polled_once_more(done_s=0.5))
    assert (tape.difference, tape.request_count) == (None, 1)


def test_a_poll_before_that_may_not(tmp_path: Path) -> None:
    tape = stopped_without_a_poll(tmp_path, polled_once_more(done_s=1.5))
    assert tape.difference is not None
    assert (tape.difference.at_s, tape.difference.recorded) == (1.0, b"\x4c")


def test_another_request_after_it_is_a_difference(tmp_path: Path) -> None:
    tape = stopped_without_a_poll(tmp_path, polled_once_more(done_s=0.5), request=b"\x25")
    assert tape.difference is not None
    assert (tape.difference.recorded, tape.difference.sent) == (b"\x24", b"\x25")


def test_a_cell_with_an_arm_that_nobody_records_is_named() -> None:
    cells = Path(__file__).parents[2] / "recipes" / "cells"
    require_recorded(load_cell(cells / "emulated.yaml"))
    require_recorded(load_cell(cells / "genicam.yaml"))
    with pytest.raises(ConfigError, match="arm: what the driver `ur` says is not recorded"):
        require_recorded(load_cell(cells / "ur5e.yaml"))


def frames() -> Rows:
    return [
        (1.0, "overhead", "call", ["VIDIOC_STREAMON", 4, 0], b"\x01\0\0\0" + b"\x02\0\0\0"),
        (1.5, "overhead", "frame", [1.4, 0], b"first"),
        (1.6, "overhead", "frame", [1.5, 0], b"second"),
        (1.6, "overhead", "picture", None, b"pixels"),
        (2.0, "overhead", "call", ["VIDIOC_S_CTRL", 8, errno.EACCES], bytes(8)),
    ]


def never() -> bytes:
    raise AssertionError("no camera is there")


def test_a_camera_answers_calls_and_gives_frames_when_they_came(tmp_path: Path) -> None:
    tape = tape_of(tmp_path, frames())

    async def work() -> None:
        camera = PlayedCamera(tape, "overhead", 1_000_000)
        assert camera.call("VIDIOC_STREAMON", b"\x01\0\0\0", never) == b"\x02\0\0\0"
        with pytest.raises(BlockingIOError):
            camera.dequeue(never, lambda _: 0)
        await asyncio.sleep(0.5)
        first = camera.dequeue(never, lambda _: 0)
        assert (first.struct, first.stamp_us, first.is_unread) == (b"first", 1_400_000, True)
        ready = asyncio.Event()
        tape.loop.add_reader(camera.readiness_fd(lambda: 0), ready.set)
        await ready.wait()
        assert tape.now_s == pytest.approx(1.6)
        second = camera.dequeue(never, lambda _: 0)
        assert (second.struct, second.is_unread) == (b"second", False)
        assert camera.picture(never) == b"pixels"
        with pytest.raises(PermissionError):
            camera.call("VIDIOC_S_CTRL", bytes(8), never)

    run(tape, work)
    assert tape.difference is None


def test_a_control_of_another_value_is_a_difference(tmp_path: Path) -> None:
    tape = tape_of(tmp_path, frames())

    async def work() -> None:
        camera = PlayedCamera(tape, "overhead", 1_000_000)
        camera.call("VIDIOC_STREAMON", b"\x01\0\0\0", never)
        camera.call("VIDIOC_S_CTRL", bytes(4) + b"\x09\0\0\0", never)

    with pytest.raises(UnpluggedError):
        run(tape, work)
    assert tape.difference is not None
    assert tape.difference.byte == 4


def test_a_loop_on_which_everybody_waits_says_so() -> None:
    loop = WireLoop(0.0)
    forever = loop.create_future()
    with pytest.raises(NothingLeftError):
        loop.run_until_complete(forever)
    loop.close()


def test_a_timer_runs_once_however_many_were_cancelled() -> None:
    loop = WireLoop(0.0)
    calls: list[float] = []
    for _ in range(500):
        loop.call_later(1.0, calls.append, 0.0).cancel()
    loop.call_later(2.0, calls.append, 2.0)
    loop.run_until_complete(asyncio.wait_for(asyncio.sleep(3.0), None))
    assert calls == [2.0]
    loop.close()


async def first_verb(link: ModbusLink, device: VerbLock) -> None:
    await link.clock.sleep(1.0)  # a moment late: it was first, but is slower by now
    async with device.held("first"):
        await link.unit(17, "unit").read_holding_registers(0x6B, 3)


async def second_verb(link: ModbusLink, device: VerbLock) -> None:
    async with device.held("second"):
        await link.unit(17, "unit").read_holding_registers(0x6B, 3)


def test_of_two_verbs_the_one_goes_first_that_had_the_device_first(tmp_path: Path) -> None:
    rows: Rows = []
    for number, name in enumerate(("first", "second"), start=1):
        at_s, task = 5.0 * number, f"{name}_verb"
        numbered = number.to_bytes(2, "big")  # of the transaction
        rows += [
            (at_s, "line", "turn", [f"verb {name}", task], b""),
            (at_s, "line", "turn", [WORDS, task], b""),
            (at_s, "line", "sent", None, numbered + ASKED[2:]),
            (at_s + 0.01, "line", "got", None, numbered + ANSWERED[2:]),
        ]
    tape = tape_of(tmp_path, [(4.0, "line", "opened", None, b""), *rows])

    async def work() -> None:
        tape.callers.begin()
        link = link_of(tape)
        device = VerbLock(link)
        both = (second_verb(link, device), first_verb(link, device))
        await asyncio.gather(*map(asyncio.ensure_future, both))

    run(tape, work)
    assert tape.difference is None
    assert tape.request_count == 2
