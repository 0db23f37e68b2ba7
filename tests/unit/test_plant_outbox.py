"""What the journal tells reaches each receiver: in order, at least once, and nothing is lost."""

from __future__ import annotations

import asyncio
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from results_bench import RunWriter, bad_run, good_run, verdict, view

from controller.cell.custody import Custody
from controller.cell.journal import JOURNAL_NAME, Head, append_beside, rows
from controller.cli import main
from controller.plant.folding import notices_after, result_of, whole_result
from controller.plant.model import AlarmNotice, Notice, PartResult
from controller.plant.outbox import Book, Outbox, OutboxError, behind, resume
from controller.plant.plant import Plant, RejectedError

FIRST, SECOND = "20260301-120000-000-featuretype", "20260302-120000-000-featuretype"


class Receiver:
    """Takes notices, unless it is told to fail.

    Attributes
    ----------
    taken : keys of what it confirmed, in order
    fails : errors that it raises next, one by one; None takes
    after : fails once it has taken, as where the confirmation is lost
    """

    def __init__(self, name: str = "mes") -> None:
        self.name = name
        self.taken: list[str] = []
        self.fails: list[Exception | None] = []
        self.after: list[Exception] = []
        self.never: set[str] = set()

    async def serve(self, plant: Plant) -> None:
        await asyncio.Event().wait()

    async def deliver(self, notice: Notice) -> None:
        if notice.key in self.never:
            raise RejectedError("no such order")
        error = self.fails.pop(0) if self.fails else None
        if error is not None:
            raise error
        self.taken.append(notice.key)
        if self.after:
            raise self.after.pop(0)


@pytest.fixture
def no_pause(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("controller.plant.outbox.FIRST_PAUSE_WALL_S", 0.0)


def deliver(runs: Path, receiver: Receiver, *, from_start: bool = True) -> None:
    """Deliver as a process that has just begun does."""
    outbox = Outbox(runs, Book(runs), receiver, "cell-3", from_start=from_start)
    asyncio.run(outbox.deliver_new())


def all_told(runs: Path) -> list[Notice]:
    told, seq = [], 0
    while True:
        found, last = notices_after(runs / JOURNAL_NAME, "cell-3", seq)
        told += [notice for _, notices in found for notice in notices]
        if last == seq:
            return [one for one in told if isinstance(one, (PartResult, AlarmNotice))]
        seq = last


def review(runs: Path, run: str) -> None:
    row = rows.PartReviewed(verdict="accept", who="ada", why="a reflection", machine="fail")
    append_beside(runs / JOURNAL_NAME, run, row, 1)


def test_each_result_is_delivered_once_and_in_order_of_the_journal(tmp_path: Path) -> None:
    good_run(tmp_path)
    receiver = Receiver()
    deliver(tmp_path, receiver)
    bad_run(tmp_path)
    deliver(tmp_path, receiver)
    deliver(tmp_path, receiver)
    parts = [key for key in receiver.taken if "alarm" not in key]
    assert parts == [f"emulated/{FIRST}/1/1", f"emulated/{SECOND}/1/1"]


def test_a_result_has_what_the_report_has(tmp_path: Path) -> None:
    folder = bad_run(tmp_path)
    (result,) = (one for one in all_told(tmp_path) if isinstance(one, PartResult))
    whole = whole_result(tmp_path / JOURNAL_NAME, folder.name, 1)
    assert (result.verdict, result.tray, result.disposition) == ("fail", "reject", "reject")
    assert list(result.reasons) == whole["reasons"]
    assert [f.area_mm2 for f in result.findings] == [f["area_mm2"] for f in whole["findings"]]
    assert result.findings[1].faces == ("F2 plane", "F1 bore 8.0 mm")
    assert result.is_emulated
    assert result.recipe_sha256 == whole["header"]["recipe_sha256"]
    text = result.model_dump(mode="json", by_alias=True)
    assert text["schema"] == "cellctl.part/1"
    assert text["begun"].endswith("Z")


def test_a_persons_verdict_is_a_revision_and_the_first_one_stays_as_it_was(
    tmp_path: Path,
) -> None:
    folder = bad_run(tmp_path)
    (before,) = (one for one in all_told(tmp_path) if isinstance(one, PartResult))
    review(tmp_path, folder.name)
    first, second = (one for one in all_told(tmp_path) if isinstance(one, PartResult))
    assert first == before
    assert (second.revision, second.disposition, second.verdict) == (2, "accept", "fail")
    assert second.review is not None
    assert (second.review.who, second.review.why) == ("ada", "a reflection")
    journal = tmp_path / JOURNAL_NAME
    assert result_of(journal, "cell-3", folder.name, 1) == second
    assert result_of(journal, "cell-3", folder.name, 1, 1) == first


def test_a_part_that_was_not_finished_is_told_of_when_its_run_ends(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path)
    writer.look()
    writer.custody(Custody.IN_ARM)
    assert all_told(tmp_path) == []
    writer.end("stopped", "stopped by ada")
    (result,) = (one for one in all_told(tmp_path) if isinstance(one, PartResult))
    assert (result.verdict, result.disposition) == ("no verdict", None)
    assert result.custody == Custody.IN_ARM.value
    later = rows.PartFollowed(run=SECOND, custody=Custody.REMOVED.key)
    append_beside(tmp_path / JOURNAL_NAME, writer.run_id, later, 1)
    *_, told = (one for one in all_told(tmp_path) if isinstance(one, PartResult))
    assert told.revision == 2


def test_an_alarm_is_told_with_what_to_do_and_its_acknowledgement(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path)
    alarm = rows.AlarmFields(number=201, code="estop", device="I/O block", action="look")
    writer.journal.write(
        rows.CellEvent(
            name="fault", answer="handled", source="idle", target="aborting", code="estop",
            message="the emergency stop is pressed", alarm=alarm,
        )
    )  # fmt: skip
    writer.journal.write(rows.Acknowledged(run=writer.run_id, code="estop", who="ada", why="ok"))
    raised, acknowledged = (one for one in all_told(tmp_path) if isinstance(one, AlarmNotice))
    assert (raised.number, raised.change, raised.action) == (201, "raised", "look")
    assert (acknowledged.change, acknowledged.who) == ("acknowledged", "ada")


@pytest.mark.usefixtures("no_pause")
def test_a_lost_confirmation_doubles_a_result_and_loses_none(tmp_path: Path) -> None:
    good_run(tmp_path)
    bad_run(tmp_path)
    receiver = Receiver()
    receiver.after = [OSError("the line was cut")]
    with pytest.raises(OSError, match="cut"):
        deliver(tmp_path, receiver)
    deliver(tmp_path, receiver)  # another process
    parts = [key for key in receiver.taken if "alarm" not in key]
    assert parts == [f"emulated/{FIRST}/1/1", f"emulated/{FIRST}/1/1", f"emulated/{SECOND}/1/1"]


def test_a_receiver_that_was_away_gets_all_that_came_meanwhile(tmp_path: Path) -> None:
    receiver = Receiver()
    receiver.fails = [OSError("no route")] * 5
    for day in range(1, 6):
        good_run(tmp_path, f"2026030{day}-120000-000-featuretype")
        with pytest.raises(OSError, match="no route"):
            deliver(tmp_path, receiver)
    assert receiver.taken == []
    deliver(tmp_path, receiver)
    parts = [key for key in receiver.taken if "alarm" not in key]
    assert [key.split("/")[1][:8] for key in parts] == [f"2026030{day}" for day in range(1, 6)]


@pytest.mark.usefixtures("no_pause")
def test_why_nothing_goes_out_is_known_until_it_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("controller.plant.outbox.POLL_WALL_S", 0.0)
    good_run(tmp_path)
    seen: list[dict[str, tuple[str, str]]] = []
    codes: list[int] = []

    class Away(Receiver):
        async def deliver(self, notice: Notice) -> None:
            seen.append(Book(tmp_path).problems())
            if len(seen) == 2:
                codes.append(await asyncio.to_thread(main, ["deliveries", "--runs", str(tmp_path)]))
            if len(seen) < 3:
                raise ConnectionError("no route to the plant")
            await super().deliver(notice)

    class Watched(Book):
        def note_problem(self, courier: str, why: str) -> None:
            super().note_problem(courier, why)
            if seen and not why:
                loop.call_soon_threadsafe(is_well.set)

    async def work(receiver: Away) -> None:
        outbox = Outbox(tmp_path, Watched(tmp_path), receiver, "cell-3", from_start=True)
        running = asyncio.create_task(outbox.run())
        await is_well.wait()
        running.cancel()

    loop, is_well = asyncio.new_event_loop(), asyncio.Event()

    with closing(loop):
        loop.run_until_complete(work(Away()))
        loop.run_until_complete(loop.shutdown_default_executor())
    assert Book(tmp_path).problems() == {}
    assert [[why for why, _ in one.values()] for one in seen[:3]] == [
        [], ["no route to the plant"], ["no route to the plant"],
    ]  # fmt: skip
    assert codes == [1]


@pytest.mark.usefixtures("no_pause")
def test_a_result_refused_for_good_is_kept_for_a_person_and_the_next_ones_go_on(
    tmp_path: Path,
) -> None:
    good_run(tmp_path)
    bad_run(tmp_path)
    receiver = Receiver()
    receiver.never = {f"emulated/{FIRST}/1/1"}
    deliver(tmp_path, receiver)
    (refused,) = Book(tmp_path).refused()
    assert (refused.key, refused.why) == (f"emulated/{FIRST}/1/1", "no such order")
    assert PartResult.model_validate_json(refused.body).run == FIRST
    assert f"emulated/{SECOND}/1/1" in receiver.taken


def test_a_result_that_cannot_be_read_is_named_and_the_next_ones_go_on(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path, FIRST)
    writer.look()
    writer.write(rows.PartJudged.model_construct(verdict="pass"))  # as no version writes it
    writer.write(rows.PartDone(verdict="accept", tray="accept"))
    writer.end()
    bad_run(tmp_path)
    receiver = Receiver()
    deliver(tmp_path, receiver)
    (refused,) = Book(tmp_path).refused()
    assert f"run {FIRST} part 1" in refused.why
    assert f"emulated/{SECOND}/1/1" in receiver.taken


def test_nothing_is_sent_from_a_row_that_was_changed_on(tmp_path: Path) -> None:
    good_run(tmp_path)
    bad_run(tmp_path)
    with closing(sqlite3.connect(tmp_path / JOURNAL_NAME)) as db, db:
        for (trigger,) in db.execute("SELECT name FROM sqlite_master WHERE type = 'trigger'"):
            db.execute(f"DROP TRIGGER {trigger}")
        db.execute("UPDATE journal SET body = replace(body, 'fail', 'pass') "
                   "WHERE name = 'verdict' AND run = ?", (SECOND,))  # fmt: skip
    receiver = Receiver()
    with pytest.raises(OutboxError, match=f"of run {SECOND} was changed; nothing from there on"):
        deliver(tmp_path, receiver)
    assert [key for key in receiver.taken if "alarm" not in key] == [f"emulated/{FIRST}/1/1"]


def test_rows_of_a_journal_set_aside_are_delivered_before_those_of_the_new_one(
    tmp_path: Path,
) -> None:
    good_run(tmp_path)
    receiver = Receiver()
    deliver(tmp_path, receiver)
    bad_run(tmp_path)
    (tmp_path / JOURNAL_NAME).rename(tmp_path / "journal-set-aside-20260303.sqlite")
    third = "20260303-120000-000-featuretype"
    good_run(tmp_path, third)
    deliver(tmp_path, receiver)
    parts = [key for key in receiver.taken if "alarm" not in key]
    assert parts == [f"emulated/{run}/1/1" for run in (FIRST, SECOND, third)]


def test_a_journal_restored_from_a_backup_stops_a_receiver_until_a_person_says_so(
    tmp_path: Path,
) -> None:
    good_run(tmp_path)
    journal = tmp_path / JOURNAL_NAME
    backup = tmp_path / "backup.sqlite"
    with closing(sqlite3.connect(journal)) as db, closing(sqlite3.connect(backup)) as to:
        db.backup(to)
    bad_run(tmp_path)
    receiver = Receiver()
    deliver(tmp_path, receiver)
    for beside in tmp_path.glob(f"{JOURNAL_NAME}-*"):
        beside.unlink()
    backup.replace(journal)
    taken = list(receiver.taken)
    with pytest.raises(OutboxError, match=r"restored from a backup.*--resume mes"):
        deliver(tmp_path, receiver)
    assert receiver.taken == taken
    assert resume(tmp_path, Book(tmp_path), "mes") == 1
    good_run(tmp_path, "20260304-120000-000-featuretype")
    deliver(tmp_path, receiver)
    assert receiver.taken[-1] == "emulated/20260304-120000-000-featuretype/1/1"


def test_a_new_receiver_gets_what_comes_unless_it_asks_for_all(tmp_path: Path) -> None:
    good_run(tmp_path)
    later, whole = Receiver("later"), Receiver("whole")
    deliver(tmp_path, later, from_start=False)
    bad_run(tmp_path)
    deliver(tmp_path, later, from_start=False)
    deliver(tmp_path, whole)
    assert [key for key in later.taken if "alarm" not in key] == [f"emulated/{SECOND}/1/1"]
    assert f"emulated/{FIRST}/1/1" in whole.taken
    assert {behind(tmp_path, confirmed) for confirmed in Book(tmp_path).confirmed_heads()} == {0}


def test_a_new_receiver_of_a_cell_without_a_run_gets_the_first_one(tmp_path: Path) -> None:
    receiver = Receiver()
    deliver(tmp_path, receiver, from_start=False)
    good_run(tmp_path)
    deliver(tmp_path, receiver, from_start=False)
    assert f"emulated/{FIRST}/1/1" in receiver.taken


def test_two_bridges_do_not_serve_one_folder(tmp_path: Path) -> None:
    with (
        Book(tmp_path).hold(),
        pytest.raises(OutboxError, match="another `cellctl connect`"),
        Book(tmp_path).hold(),
    ):
        pass
    with Book(tmp_path).hold():  # free again
        pass


def test_a_run_of_two_parts_is_told_part_by_part(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path, count=2)
    taken: list[Any] = []
    for tray in ("accept", "reject"):
        writer.whole_part((view("G1-V0"), view("G1-V3")), verdict(), tray)
        taken.append([one.part for one in all_told(tmp_path) if isinstance(one, PartResult)])
    writer.end()
    assert taken == [[1], [1, 2]]
    results = [one for one in all_told(tmp_path) if isinstance(one, PartResult)]
    assert [(one.part, one.revision, one.tray) for one in results] == [
        (1, 1, "accept"), (2, 1, "reject"),
    ]  # fmt: skip
    assert results[0].seq < results[1].seq


class CountingBook(Book):
    """A book that counts how often a place is stored."""

    count = 0

    def set_confirmed_head(self, courier: str, journal: str, head: Head) -> None:
        self.count += 1
        super().set_confirmed_head(courier, journal, head)


def test_a_row_that_tells_nothing_costs_no_sync_of_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, book, receiver = good_run(tmp_path), CountingBook(tmp_path), Receiver()
    outbox = Outbox(tmp_path, book, receiver, "cell-3", from_start=True)
    asyncio.run(outbox.deliver_new())
    before, told = book.count, list(receiver.taken)
    for _ in range(5):
        append_beside(tmp_path / JOURNAL_NAME, folder.name, rows.GraspAvoided(grasp="G1"), 1)
        asyncio.run(outbox.deliver_new())
    assert (book.count, receiver.taken) == (before, told)
    review(tmp_path, folder.name)
    asyncio.run(outbox.deliver_new())
    assert (book.count, len(receiver.taken)) == (before + 1, len(told) + 1)
    append_beside(tmp_path / JOURNAL_NAME, folder.name, rows.GraspAvoided(grasp="G2"), 1)
    asyncio.run(outbox.deliver_new())
    monkeypatch.setattr("controller.plant.outbox.STORE_WALL_S", 0.0)
    asyncio.run(outbox.deliver_new())  # nothing is new, and it is time
    (confirmed,) = (one for one in book.confirmed_heads() if one.journal)
    assert behind(tmp_path, confirmed) == 0
    again = Receiver()
    deliver(tmp_path, again, from_start=False)
    assert again.taken == []
