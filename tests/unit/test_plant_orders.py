"""Orders of a plant: taken once, started once, when the cell is free and a permit is given."""

from __future__ import annotations

import asyncio
import json
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Literal

import pytest
from pydantic import ValidationError
from results_bench import CELL, RunWriter

from controller.cell.batch import Papers
from controller.cell.control import StandingReply, socket_path, standing_of
from controller.cell.lock import hold_cell
from controller.config import load_cell
from controller.launching import Launcher
from controller.plant.model import OrderRequest
from controller.plant.orders import OrderBook, release
from controller.plant.outbox import Book
from controller.plant.plant import RefusedError, UnknownError

# Stands for `cellctl`: notes how it was called, then ends as a file says.
FAKE = """
import json, pathlib, sys, time
folder = pathlib.Path(sys.argv[1])
with (folder / "calls.jsonl").open("a") as calls:
    print(json.dumps(sys.argv[2:]), file=calls)
end = folder / "end"
while not end.exists():
    time.sleep(0.02)
print(end.read_text())
sys.exit(1)
"""
NOW = datetime(2026, 3, 1, 12, tzinfo=UTC)
PLATE = OrderRequest(recipe="plate.yaml", quantity=2, lot="L7")


class Desk:
    """An order book with a fake cell behind it."""

    def __init__(self, folder: Path, may_start: Literal["never", "asked", "yes"] = "yes") -> None:
        self.folder = folder
        self.runs = folder / "runs"
        self.now = NOW
        self.standing: StandingReply | None = None
        (folder / "fake.py").write_text(FAKE)
        (folder / "plate.yaml").write_text("name: plate\npart: plate.stl\n")
        (folder / "plate.stl").write_text("solid\nendsolid\n")
        (folder / "lost.yaml").write_text("name: lost\npart: nowhere.stl\n")
        self.begin(may_start)

    def begin(self, may_start: Literal["never", "asked", "yes"] = "yes") -> None:
        """Begin as a process that has just been started does."""
        command = (sys.executable, str(self.folder / "fake.py"), str(self.folder))
        launcher = Launcher(self.runs, self.folder, command)
        self.book = Book(self.runs)
        self.orders = OrderBook(
            self.runs,
            self.book,
            "cell-3",
            launcher,
            may_start,
            lambda: self.standing or standing_of(self.runs),
            lambda: self.now,
        )
        self.launcher = launcher

    def calls(self) -> list[list[str]]:
        path = self.folder / "calls.jsonl"
        return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []

    def end(self, said: str = "cellctl: it is wrong") -> None:
        (self.folder / "end").write_text(said)
        if (work := self.launcher._work) is not None:
            work.process.wait()

    def run(self, number: str, run_id: str, count: int = 2) -> RunWriter:
        """Write the beginning of a run of an order, as the process that was started does."""
        return RunWriter(
            self.runs, run_id, count=count, papers=Papers(order_number=number), real=True
        )


@pytest.fixture
def desk(tmp_path: Path) -> Any:
    found = Desk(tmp_path)
    yield found
    found.end()


async def test_an_order_is_started_as_the_page_starts_a_run(desk: Desk) -> None:
    taken = await desk.orders.take("PO-1", PLATE, "mes by REST")
    assert (taken.state, taken.quantity, taken.source) == ("queued", 2, "mes by REST")
    await desk.orders.step()
    assert (await desk.orders.find("PO-1")).state == "running"
    desk.end()
    (call,) = desk.calls()
    assert call[0] == "run"
    assert {"--order=PO-1", "--lot=L7", "--operator=mes by REST", "--wait"} <= set(call)
    assert call[-1] == "plate.yaml=2"
    assert not {"--part-removed", "--trays-empty", "--auto-recover"} & set(call)


async def test_whoever_asks_for_changes_gets_those_before_his_first_look(desk: Desk) -> None:
    changes = desk.orders.changes()
    taken = await desk.orders.take("PO-1", PLATE, "mes by REST")
    assert await anext(changes) == taken
    del changes  # nobody listens: what changes now is kept for nobody
    await desk.orders.withdraw("PO-1", "mes by REST")
    assert not list(desk.orders._changes)


async def test_the_same_order_again_changes_nothing_and_starts_nothing(desk: Desk) -> None:
    first = await desk.orders.take("PO-1", PLATE, "mes by REST")
    assert await desk.orders.take("PO-1", PLATE, "other by MQTT") == first
    await desk.orders.step()
    await desk.orders.step()
    await desk.orders.take("PO-1", PLATE, "mes by REST")
    await desk.orders.step()
    other = OrderRequest(recipe="plate.yaml", quantity=3)
    with pytest.raises(RefusedError, match="PO-1 is running with other contents"):
        await desk.orders.take("PO-1", other, "mes by REST")
    desk.end()
    assert len(desk.calls()) == 1


async def test_an_order_that_waits_takes_other_contents(desk: Desk) -> None:
    desk.standing = StandingReply(state="left", message="a part is in the gripper")
    await desk.orders.take("PO-1", PLATE, "mes by REST")
    await desk.orders.step()
    assert (await desk.orders.find("PO-1")).reason == "a part is in the gripper"
    changed = await desk.orders.take("PO-1", PLATE.model_copy(update={"lot": "L8"}), "mes by REST")
    assert (changed.state, changed.request.lot) == ("queued", "L8")
    assert desk.calls() == []


async def test_without_a_permit_of_the_cell_file_nothing_is_taken(tmp_path: Path) -> None:
    desk = Desk(tmp_path, "never")
    refused = await desk.orders.take("PO-1", PLATE, "mes by REST")
    assert (refused.state, "connect.may_start" in refused.reason) == ("refused", True)
    await desk.orders.step()
    assert desk.calls() == []


async def test_an_order_that_asks_waits_for_a_person_at_the_cell(tmp_path: Path) -> None:
    desk = Desk(tmp_path, "asked")
    assert (await desk.orders.take("PO-1", PLATE, "mes by REST")).state == "asked"
    await desk.orders.step()
    assert desk.calls() == []
    (released,) = release(desk.book, ["PO-1"], "ada")
    assert (released.state, released.reason) == ("queued", "released by ada")
    await desk.orders.step()
    desk.end()
    assert len(desk.calls()) == 1
    with pytest.raises(RefusedError, match="asks for no release"):
        release(desk.book, ["PO-1"], "ada")
    with pytest.raises(UnknownError):
        release(desk.book, ["PO-2"], "ada")


@pytest.mark.parametrize(
    ("recipe", "why"), [("nothing", "no such recipe"), ("lost.yaml", "nowhere")]
)
async def test_an_order_of_no_recipe_that_can_run_is_refused(
    desk: Desk, recipe: str, why: str
) -> None:
    refused = await desk.orders.take("PO-1", OrderRequest(recipe=recipe), "mes by REST")
    assert (refused.state, why in refused.reason) == ("refused", True)


async def test_an_order_waits_while_another_run_has_the_cell(desk: Desk) -> None:
    await desk.orders.take("PO-1", PLATE, "mes by REST")
    desk.runs.mkdir(exist_ok=True)
    with hold_cell(desk.runs, load_cell(CELL), "another run", socket_path(desk.runs)):
        await desk.orders.step()
        waiting = await desk.orders.find("PO-1")
    assert (waiting.state, "another run" in waiting.reason) == ("queued", True)
    assert desk.calls() == []


async def test_a_run_that_says_no_refuses_its_order_with_its_own_sentence(desk: Desk) -> None:
    await desk.orders.take("PO-1", PLATE, "mes by REST")
    await desk.orders.step()
    desk.end("planning\ncellctl: plate.stl: is not closed")
    await desk.orders.step()
    refused = await desk.orders.find("PO-1")
    assert (refused.state, refused.reason) == ("refused", "plate.stl: is not closed")


def test_a_bridge_that_was_killed_follows_its_order_and_does_not_start_it_again(
    tmp_path: Path,
) -> None:
    desk = Desk(tmp_path)

    async def begin() -> None:
        await desk.orders.take("PO-1", PLATE, "mes by REST")
        desk.now = datetime.now(UTC)
        await desk.orders.step()

    asyncio.run(begin())
    work = desk.launcher._work
    desk.begin()  # another process
    writer = desk.run("PO-1", "20991231-120000-000-plate")
    with hold_cell(desk.runs, load_cell(CELL), writer.run_id, socket_path(desk.runs)):
        asyncio.run(desk.orders.step())
    order = asyncio.run(desk.orders.find("PO-1"))
    assert (order.state, order.run, order.quantity) == ("running", "20991231-120000-000-plate", 2)
    (tmp_path / "end").touch()
    assert work is not None
    work.process.wait()
    writer.end("stopped", "stopped by ada")
    asyncio.run(desk.orders.step())
    order = asyncio.run(desk.orders.find("PO-1"))
    assert (order.state, order.reason) == ("stopped", "stopped by ada")
    asyncio.run(desk.orders.step())
    assert len(desk.calls()) == 1


async def test_an_order_whose_run_never_began_is_refused_after_a_time_and_never_started_again(
    desk: Desk,
) -> None:
    await desk.orders.take("PO-1", PLATE, "mes by REST")
    await desk.orders.step()
    desk.end()
    desk.begin()  # another process, which knows nothing of the first one's child
    await desk.orders.step()
    assert (await desk.orders.find("PO-1")).state == "running"
    desk.now = NOW + timedelta(hours=1)
    await desk.orders.step()
    refused = await desk.orders.find("PO-1")
    assert (refused.state, "order it anew" in refused.reason) == ("refused", True)
    assert len(desk.calls()) == 1


async def test_an_order_is_taken_back_before_it_begins_and_not_after(desk: Desk) -> None:
    await desk.orders.take("PO-1", PLATE, "mes by REST")
    await desk.orders.take("PO-2", PLATE, "mes by REST")
    assert (await desk.orders.withdraw("PO-2", "mes by REST")).state == "refused"
    await desk.orders.step()
    with pytest.raises(RefusedError, match="is running"):
        await desk.orders.withdraw("PO-1", "mes by REST")
    with pytest.raises(UnknownError):
        await desk.orders.withdraw("PO-3", "mes by REST")
    assert [one.number for one in await desk.orders.all()] == ["PO-1", "PO-2"]


@pytest.mark.parametrize(
    "wrong",
    [
        {},
        {"recipe": "a", "recipes": [{"recipe": "b"}]},
        {"recipe": "a", "quantity": 0},
        {"recipe": "a", "serials": ["x", "x"]},
        {"recipe": "a", "quantity": 3, "serials": ["x"]},
        {"recipe": "a", "serials": ["x\n"]},
        {"recipe": "", "quantity": 1},
        {"recipe": "a", "lot": "L" * 81},
        {"recipe": "a", "speed": 100},
        {"recipe": "a", "due": "soon"},
        {"recipe": "a", "due": "2026-03-01T12:00:00"},
        {"recipes": [{"recipe": "a"}] * 21},
    ],
)
def test_an_order_that_makes_no_sense_is_no_order(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        OrderRequest.model_validate(wrong)
