"""Nests of trays: counted by the journal, asked about when a tray is full, kept between runs."""

import asyncio
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from controller.cell.actions.consult import ConsultAction
from controller.cell.actions.perception.acquire import require_room
from controller.cell.custody import TrayRecord, left_in_trays, next_nest
from controller.cell.errors import PartProblemError
from controller.cell.journal import Journal, rows
from controller.cell.machine import Event
from controller.cell.operator.questions import LOOK, STOP, question_for
from controller.cell.services.records import BatchRecord, PartRecord, RunProgress
from controller.config.cell import TraySection


def stored(tray: str, nest: int, part: str = "plate") -> rows.StoredFields:
    T = tuple(map(tuple, np.eye(4).tolist()))
    return rows.StoredFields(tray=tray, nest=nest, part=part, T_world_part=T)


def test_the_first_free_nest_is_the_next_one() -> None:
    there = (stored("accept", 0), stored("accept", 2), stored("reject", 1))
    assert [next_nest(there, "accept", n) for n in (1, 2, 3, 4)] == [None, 1, 1, 1]
    assert next_nest(there, "reject", 2) == 0
    assert next_nest(there, "quarantine", 0) is None


def test_only_trays_whose_parts_are_counted_are_ever_full() -> None:
    trays = TrayRecord({"accept": 2}, (stored("accept", 0),))
    assert trays.full() == ()
    trays.take(rows.PartStored(part=stored("accept", 1)))
    assert trays.full() == ("accept",)
    trays.take(rows.TrayEmptied(tray="accept", count=2))
    assert (trays.full(), trays.stored) == ((), ())


def test_no_part_is_begun_while_a_tray_it_may_go_to_is_full() -> None:
    require_room(TrayRecord({"accept": 1}))
    with pytest.raises(PartProblemError, match=r"tray accept \(1 parts\) is full") as e:
        require_room(TrayRecord({"accept": 1, "reject": 1}, (stored("accept", 0),)))
    assert e.value.code == "tray_full"


class Lines:
    """A journal that keeps its rows."""

    run = "20260101-000000-000-plate"

    def __init__(self) -> None:
        self.rows: list[rows.Body] = []

    def write(self, row: rows.Body, part: int | None = None) -> None:
        self.rows.append(row)

    async def write_secured(self, row: rows.Body, part: int | None = None) -> None:
        self.rows.append(row)


def batch(trays: TrayRecord) -> tuple[BatchRecord, Lines]:
    lines: Any = Lines()
    record = BatchRecord(lines, RunProgress(), lambda: None, trays=trays)
    record.part = PartRecord(number=3)
    return record, lines


def test_a_part_in_a_nest_is_written_down_with_its_pose_and_number() -> None:
    record, lines = batch(TrayRecord({"accept": 4}, (stored("accept", 0),)))
    T = np.eye(4)
    T[:3, 3] = 10.0, 20.0, 3.0
    record.note_stored("accept", "plate", T)
    record.note_stored("reject", "plate", T)  # nobody counts there
    (row,) = lines.rows
    assert isinstance(row, rows.PartStored)
    assert (row.part.nest, row.part.number, row.part.run) == (1, 3, Lines.run)
    assert row.part.T_world_part[0] == (1.0, 0.0, 0.0, 10.0)
    assert [one.nest for one in record.around.stored] == [0, 1]


@pytest.mark.parametrize(("key", "event"), [(LOOK, Event.LOOK_AGAIN), (STOP, Event.STOP)])
def test_a_tray_counts_as_empty_once_a_person_has_said_so(key: str, event: Event) -> None:
    record, lines = batch(TrayRecord({"accept": 1, "reject": 1}, (stored("accept", 0),)))
    record.problem = ("tray_full", "tray accept (1 parts) is full")

    class Person:
        async def decide(self, question: Any) -> Any:
            assert [one.key for one in question.choices] == [LOOK, STOP]
            return SimpleNamespace(key=key)

    taking = SimpleNamespace(forget=lambda: None, begin_anew=lambda: None)
    consult = ConsultAction(Person(), record, taking, sweeps_to_home=True)  # type: ignore[arg-type]
    assert asyncio.run(consult.run()) is event
    emptied = [row.tray for row in lines.rows if isinstance(row, rows.TrayEmptied)]
    assert emptied == (["accept"] if key == LOOK else [])
    assert (record.trays.full() == ()) == (key == LOOK)


def test_the_question_about_a_full_tray_offers_to_take_nothing_off_the_table() -> None:
    question = question_for("tray_full", "tray accept (4 parts) is full", "in its tray")
    assert [one.key for one in question.choices] == [LOOK, STOP]


def began(name: str, address: str) -> rows.RunBegan:
    devices = {"arm": {"address": address}, "gripper": {"address": "g", "unit": 9}}
    return rows.RunBegan(cell={"name": name}, devices=devices)


def write_run(path: Path, run: str, *bodies: rows.Body) -> None:
    journal = Journal(path, run)
    for body in bodies:
        journal.write(body)
    journal.close()


def test_what_stands_in_the_trays_of_a_real_cell_is_known_to_its_next_run(tmp_path: Path) -> None:
    path, here = tmp_path / "journal.sqlite", began("cell", "/dev/arm")
    write_run(path, "one", here, rows.PartStored(part=stored("accept", 0)))
    write_run(
        path, "other cell", began("other", "/dev/b"), rows.PartStored(part=stored("reject", 7))
    )
    write_run(
        path, "two", here, rows.TraysStood(stored=(stored("accept", 0),)),
        rows.PartStored(part=stored("accept", 1)), rows.PartStored(part=stored("reject", 0)),
        rows.TrayEmptied(tray="reject", count=1),
    )  # fmt: skip
    write_run(path, "now", here)
    assert left_in_trays(path, "now", here) == (stored("accept", 0), stored("accept", 1))


def test_a_new_emulated_cell_begins_with_empty_trays(tmp_path: Path) -> None:
    path = tmp_path / "journal.sqlite"

    def emulated(pid: int) -> rows.RunBegan:
        return rows.RunBegan(
            cell={"name": "cell"},
            emulated_devices=("arm", "gripper"),
            emulator={"pid": pid, "started_wall_s": 1.0},
        )

    write_run(path, "one", emulated(1), rows.PartStored(part=stored("accept", 0)))
    assert left_in_trays(path, "now", emulated(2)) == ()
    assert left_in_trays(path, "now", emulated(1)) == (stored("accept", 0),)


def test_a_grid_shares_the_tray_evenly_along_x_first() -> None:
    tray = TraySection.model_validate(
        {"centre": [100, 390], "size": [150, 90], "nests": {"columns": 3, "rows": 2, "turn": 45}}
    )
    places = tray.places()
    assert [one.at for one in places] == [
        (-50, -22.5), (0, -22.5), (50, -22.5), (-50, 22.5), (0, 22.5), (50, 22.5),
    ]  # fmt: skip
    assert {(one.size, one.turn) for one in places} == {((50, 45), 45)}


@pytest.mark.parametrize(
    ("nests", "message"),
    [
        ([{"at": [60, 0], "size": [40, 40]}], "nest 1 is 5 mm beyond the tray along x"),
        (
            [{"at": [-20, 0], "size": [50, 40]}, {"at": [20, 0], "size": [50, 40]}],
            "nests 1 and 2 overlap",
        ),
        ([], "at least 1 item"),
    ],
)
def test_nests_that_cannot_be_are_refused(nests: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        TraySection.model_validate({"centre": [0, 0], "size": [150, 150], "nests": nests})
