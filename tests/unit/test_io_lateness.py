"""Inputs on a clock that waits for its readers: being late ourselves makes no reading stale."""

import asyncio
from typing import Any, cast

import pytest

from drivers.clock import CellClock
from drivers.errors import ReplyTimeoutError
from drivers.io_modbus import CellIo, Change, IoConfig, Signal
from drivers.modbus_link import ModbusLink

ALL_OK = (True,) * 6
STALE_S = 0.2


class WaitingTime:
    """An emulated cell's clock, which goes on when the test says so."""

    speed = 1000.0
    window_s = 0.05
    waits = True

    def __init__(self) -> None:
        self.instant_s = 5.0
        self.hold_count = 0
        self.held = asyncio.Event()

    def now_s(self) -> float:
        return self.instant_s

    def hold(self) -> None:
        self.hold_count += 1
        self.held.set()

    def release(self) -> None:
        self.hold_count -= 1


class Block:
    """A block of which every reading is answered by the test; nothing records its line."""

    tap = None

    def __init__(self, clock: CellClock) -> None:
        self.clock = clock
        self.asked: asyncio.Queue[asyncio.Future[tuple[bool, ...]]] = asyncio.Queue()

    def unit(self, *_: object, **__: object) -> "Block":
        return self

    async def read_input_registers(self, _: int, count: int) -> tuple[int, ...]:
        text = b"E1214".ljust(2 * count, b"\0")
        return tuple(int.from_bytes(text[i : i + 2], "big") for i in range(0, len(text), 2))

    async def read_discrete_inputs(self, *_: int) -> tuple[bool, ...]:
        reply = asyncio.get_running_loop().create_future()
        self.asked.put_nowait(reply)
        return cast("tuple[bool, ...]", await reply)


class Cell:
    """The driver, its block and its clock, once two readings were good."""

    def __init__(self) -> None:
        self.time = WaitingTime()
        self.block = Block(CellClock(speed=self.time.speed, shared=cast("Any", self.time)))
        self.changes: list[Change] = []
        config = IoConfig(poll_s=0.04, stale_s=STALE_S)
        self.io = CellIo(cast("ModbusLink", self.block), config, self.changes.append)

    async def settle(self) -> None:
        await self.io.connect()
        for _ in range(2):
            await self.answer(await self.next_request())
        assert self.io.signal("estop_ok") is Signal.OK
        self.changes.clear()

    async def next_request(self) -> "asyncio.Future[tuple[bool, ...]]":
        self.time.instant_s += self.io.config.poll_s
        return await self.block.asked.get()

    async def answer(self, request: "asyncio.Future[tuple[bool, ...]]") -> None:
        request.set_result(ALL_OK)
        for _ in range(10):
            await asyncio.sleep(0)


def too_late(cell: Cell) -> None:
    """Let more time pass than a reading may be old, in windows for which no turn was had."""
    cell.time.instant_s += cell.block.clock.patience_s(STALE_S) + 2 * cell.time.window_s


async def test_a_reading_is_not_stale_while_its_successor_is_on_its_way() -> None:
    cell = Cell()
    await cell.settle()
    request = await cell.next_request()
    too_late(cell)
    # what an action asks before it moves anything, ahead of the poller in the same turn
    assert cell.io.signal("estop_ok") is Signal.OK
    await cell.time.held.wait()  # the last look
    assert cell.io.signal("estop_ok") is Signal.OK
    await cell.answer(request)
    # too old on arrival: one more is asked for, and that one is fresh
    assert cell.io.snapshot()["estop_ok"] is Signal.OK
    await cell.answer(await cell.next_request())
    assert cell.io.snapshot().at_s == pytest.approx(cell.time.instant_s, abs=STALE_S)
    assert cell.changes == []
    assert cell.time.hold_count == 0
    await cell.io.aclose()


async def test_a_reading_is_not_stale_because_the_poller_overslept() -> None:
    cell = Cell()
    await cell.settle()
    too_late(cell)
    assert cell.io.signal("estop_ok") is Signal.OK
    await cell.answer(await cell.block.asked.get())
    assert cell.io.signal("estop_ok") is Signal.OK
    assert cell.changes == []
    await cell.io.aclose()


async def test_a_silent_block_is_unknown_after_one_last_look(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("drivers.patience.IN_TRANSIT_WALL_S", 0.001)
    cell = Cell()
    await cell.settle()
    with cell.io.watch() as changes:
        request = await cell.next_request()
        too_late(cell)
        change = await anext(changes)
    assert change.signal is Signal.UNKNOWN
    assert cell.time.held.is_set()
    assert set(cell.io.snapshot().signals.values()) == {Signal.UNKNOWN}
    request.set_exception(ReplyTimeoutError("no answer"))
    await cell.block.asked.get()
    assert set(cell.io.snapshot().signals.values()) == {Signal.UNKNOWN}
    await cell.io.aclose()
    assert cell.time.hold_count == 0


async def test_a_poller_that_has_ended_lets_its_last_reading_grow_old() -> None:
    cell = Cell()
    await cell.settle()
    (await cell.next_request()).set_exception(RuntimeError("a bug"))
    for _ in range(10):
        await asyncio.sleep(0)
    too_late(cell)
    assert cell.io.signal("estop_ok") is Signal.UNKNOWN
    with pytest.raises(RuntimeError, match="a bug"):
        await cell.io.aclose()
