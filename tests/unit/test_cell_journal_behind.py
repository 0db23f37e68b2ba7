"""Rows are written beside the event loop: whatever holds the file up, the arm is halted at once."""

from __future__ import annotations

import asyncio
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest
from dispatcher_bench import dispatcher_on

from controller.cell.batch import BatchEnd, Dispatcher
from controller.cell.journal import Journal, JournalError, first_broken_row, read_rows, rows
from controller.cell.machine import Effect, Event
from controller.cell.services.records import BatchRecord, RunProgress

PATIENCE = "controller.cell.journal.writing.thread.PATIENCE_WALL_S"
LONG_S = 600.0  # of a test that hangs


class Metal:
    """Notes that the arm was halted."""

    def __init__(self) -> None:
        self.is_halted = asyncio.Event()

    async def halt_arm(self) -> None:
        self.is_halted.set()

    async def stop_others(self) -> None:
        pass


class Moving:
    """An arm that moves until its task is cancelled; every stop is confirmed."""

    def __init__(self) -> None:
        self.is_moving = asyncio.Event()

    async def perform(self, effect: Effect) -> Event:
        if effect is Effect.HOME:
            self.is_moving.set()
            await asyncio.Event().wait()
        return Event.STOP_DONE if effect is Effect.STOP_MOTION else Event.ABORT_DONE


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold the write lock of a journal, as another SQLite client may."""
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        yield
        other.execute("ROLLBACK")


@contextmanager
def stalled(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Have every row of a journal wait in the writer, as on a disk that stalls."""
    goes_on, write = threading.Event(), Journal._append

    def late(self: Journal, entry: Any) -> int:
        goes_on.wait(LONG_S)
        return write(self, entry)

    with monkeypatch.context() as patch:
        patch.setattr(Journal, "_append", late)
        try:
            yield
        finally:
            goes_on.set()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "journal.sqlite"


def behind(path: Path) -> Journal:
    journal = Journal(path, "run")
    journal.write_behind()
    return journal


async def moving(journal: Journal) -> tuple[Dispatcher, asyncio.Task[BatchEnd], Metal]:
    """Return a run whose arm moves, its task, and what it halts."""
    arm, metal = Moving(), Metal()
    dispatcher = dispatcher_on(journal, arm, metal)
    running = asyncio.create_task(dispatcher.run())
    await arm.is_moving.wait()
    return dispatcher, running, metal


async def test_a_locked_journal_does_not_hold_up_a_stop_and_has_every_row_in_order(
    path: Path,
) -> None:
    journal = behind(path)
    dispatcher, running, metal = await moving(journal)
    with locked(path):
        count = len(list(read_rows(path)))
        dispatcher.request_stop()
        async with asyncio.timeout(LONG_S):
            await metal.is_halted.wait()
            outcome = await running
        assert len(list(read_rows(path))) == count, "the lock was held all the while"
    assert outcome.end == "stopped"
    assert journal.close() == 0
    names = [row.name for row in read_rows(path)]
    assert names[-4:] == ["stop", "permit_withdrawn", "stop_done", "at_rest"]
    stamps = [row.t_mono_s for row in read_rows(path)]
    assert stamps == sorted(stamps)
    assert first_broken_row(path) is None


async def test_a_disk_that_stalls_does_not_hold_up_a_stop(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with stalled(monkeypatch):
        journal = behind(path)
        async with asyncio.timeout(LONG_S):
            dispatcher, running, metal = await moving(journal)
            dispatcher.request_stop()
            assert (await running).end == "stopped"
        assert metal.is_halted.is_set()
        assert list(read_rows(path)) == []
    assert journal.close() == 0
    assert "stop" in [row.name for row in read_rows(path)]


async def test_the_halt_leaves_before_the_row_that_says_why(path: Path) -> None:
    """Also where rows are written at once, by the loop's own thread."""
    journal = Journal(path, "run")
    halted_at: dict[str, bool] = {}
    dispatcher, running, metal = await moving(journal)
    journal.on_row = lambda _, __, name: halted_at.update({name: metal.is_halted.is_set()})
    dispatcher.request_stop()
    await running
    assert halted_at["stop"]
    assert halted_at["permit_withdrawn"]
    journal.close()


async def test_a_once_intent_that_is_not_on_the_disk_in_time_is_refused_and_never_written(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(PATIENCE, 0.05)
    has_sent = False
    with stalled(monkeypatch):
        journal = behind(path)
        record = BatchRecord(journal, RunProgress(), lambda: None)
        record.note(rows.Homed())  # the disk stalls over this one
        with pytest.raises(JournalError, match="no row could be written"):
            async with record.once(rows.Intent(name=rows.Once.GRASP)):
                has_sent = True
    monkeypatch.undo()
    assert not has_sent
    assert journal.close() == 0
    assert [row.name for row in read_rows(path)] == ["homed"]


async def test_a_row_that_cannot_be_written_ends_the_run_and_none_after_it_is_lost(
    path: Path,
) -> None:
    """A table that is gone fails the first row at once; put back, the last try writes them all."""
    journal = behind(path)
    _, running, metal = await moving(journal)
    await journal.write_secured(rows.Homed())
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        before = [row.name for row in read_rows(path)]
        other.execute("ALTER TABLE journal RENAME TO elsewhere")
        journal.write(rows.Homed())  # nothing else is reported to the cell
        async with asyncio.timeout(LONG_S):
            outcome = await running
        other.execute("ALTER TABLE elsewhere RENAME TO journal")
    assert (outcome.end, outcome.code) == ("aborted", "journal")
    assert outcome.alarm is not None
    assert outcome.alarm.number == 901
    assert metal.is_halted.is_set()
    assert journal.close() == 0
    after = [row.name for row in read_rows(path)]
    assert after == [*before, "homed", "permit_withdrawn"]
    assert first_broken_row(path) is None


async def test_what_could_not_be_written_is_counted_in_the_end(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(PATIENCE, 0.05)
    with stalled(monkeypatch):
        journal = behind(path)
        for _ in range(3):
            journal.write(rows.Homed())
        assert journal.close() == 3
