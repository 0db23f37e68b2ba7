"""A journal that can no longer be written stops every device; a disk nearly full stops the run."""

import asyncio
import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest
from dispatcher_bench import dispatcher_on

from controller.cell.batch.watching import DiskWatcher
from controller.cell.custody import Custody
from controller.cell.journal import Journal, rows
from controller.cell.machine import Effect, Event
from controller.cell.services.records import BatchRecord, RunProgress
from drivers.clock import CellClock


class Metal:
    """Notes what was stopped."""

    def __init__(self) -> None:
        self.stopped: list[str] = []

    async def halt_arm(self) -> None:
        self.stopped.append("arm")

    async def stop_others(self) -> None:
        self.stopped.append("others")


class Homing:
    """An action that moves until it is stopped, and loses the journal on its way."""

    def __init__(
        self, path: Path, journal: Journal, harm: Callable[[Path], None] | None = None
    ) -> None:
        self.path, self.journal, self.harm = path, journal, harm or spoil
        self.was_cancelled = False
        self.has_sent = False
        self.is_moving = asyncio.Event()

    async def perform(self, effect: Effect) -> Event:
        assert effect is Effect.HOME
        self.harm(self.path)
        self.is_moving.set()
        try:
            await asyncio.Event().wait()
        except asyncio.CancelledError:
            self.was_cancelled = True
            raise
        return Event.RESET_DONE


class Grasping(Homing):
    """An action that may not be repeated: its intent cannot be written, so nothing is sent."""

    def __init__(self, path: Path, journal: Journal, record: BatchRecord) -> None:
        super().__init__(path, journal)
        self.record = record

    async def perform(self, effect: Effect) -> Event:
        spoil(self.path)
        async with self.record.once(rows.Intent(name=rows.Once.GRASP)):
            self.has_sent = True
        return Event.RESET_DONE


def spoil(path: Path) -> None:
    """Take the table away under the writer, as a damaged file would."""
    db = sqlite3.connect(path)
    db.execute("DROP TABLE journal")
    db.commit()
    db.close()


def take_away(path: Path) -> None:
    """Remove the folder of runs, as a tool that tidies up does."""
    shutil.rmtree(path.parent)


@pytest.mark.parametrize("harm", [spoil, take_away])
async def test_a_journal_lost_in_a_motion_stops_every_device(
    tmp_path: Path, harm: Callable[[Path], None]
) -> None:
    path = tmp_path / "runs" / "journal.sqlite"
    journal, metal = Journal(path, "run"), Metal()
    homing = Homing(path, journal, harm)
    dispatcher = dispatcher_on(journal, homing, metal, Custody.IN_ARM)
    running = asyncio.create_task(dispatcher.run())
    await homing.is_moving.wait()
    dispatcher.request_stop()  # the next row, which cannot be written
    outcome = await running
    assert (outcome.end, outcome.code) == ("aborted", "journal")
    assert str(path) in outcome.message
    assert "nothing can be recorded" in outcome.message
    assert sorted(metal.stopped) == ["arm", "others"]
    assert homing.was_cancelled
    assert "arm gripper" in outcome.where
    journal.close()


async def test_an_action_that_cannot_be_recorded_is_not_begun(tmp_path: Path) -> None:
    path = tmp_path / "journal.sqlite"
    journal, metal = Journal(path, "run"), Metal()
    record = BatchRecord(journal, RunProgress(), lambda: None)
    grasping = Grasping(path, journal, record)
    outcome = await dispatcher_on(journal, grasping, metal, Custody.IN_ARM).run()
    assert (outcome.end, outcome.code) == ("aborted", "journal")
    assert not grasping.has_sent
    assert "others" in metal.stopped
    journal.close()


async def test_a_disk_that_fills_stops_the_run_once(tmp_path: Path) -> None:
    room = iter([500_000_000, 40_000_000, 29_000_000])
    reported: list[tuple[Event, str, str]] = []
    watcher = DiskWatcher(tmp_path, CellClock(speed=1e6), lambda _: next(room))
    await watcher.run(lambda event, message="", code="": reported.append((event, message, code)))
    ((event, message, code),) = reported
    assert (event, code) == (Event.STOP, "disk_full")
    assert "29 MB left" in message


class StubbornArm(Metal):
    """An arm whose halt is not confirmed before somebody allows it."""

    def __init__(self) -> None:
        super().__init__()
        self.is_halting, self.may_confirm = asyncio.Event(), asyncio.Event()

    async def halt_arm(self) -> None:
        await super().halt_arm()
        self.is_halting.set()
        await self.may_confirm.wait()


async def test_a_run_given_up_while_it_halts_leaves_no_task_behind(tmp_path: Path) -> None:
    """A second Ctrl-C: the work goes on no longer than the run, and finds no journal closed."""
    path = tmp_path / "journal.sqlite"
    journal, metal = Journal(path, "run"), StubbornArm()
    moving, unwinds = asyncio.Event(), asyncio.Event()

    async def perform(effect: Effect) -> Event:
        assert effect is Effect.HOME
        moving.set()
        try:
            await asyncio.Event().wait()
        finally:
            unwinds.set()
        return Event.RESET_DONE

    dispatcher = dispatcher_on(journal, SimpleNamespace(perform=perform), metal, Custody.IN_ARM)
    running = asyncio.create_task(dispatcher.run())
    await moving.wait()
    dispatcher.request_stop()
    await metal.is_halting.wait()
    running.cancel()  # the work has been overtaken, and nobody has ended it yet
    metal.may_confirm.set()
    with pytest.raises(asyncio.CancelledError):
        await running
    assert unwinds.is_set()
    assert asyncio.all_tasks() == {asyncio.current_task()}
    journal.close()


async def test_at_rest_nothing_is_left_to_halt(tmp_path: Path) -> None:
    journal, metal = Journal(tmp_path / "journal.sqlite", "run"), Metal()

    async def perform(effect: Effect) -> Event:
        return {
            Effect.HOME: Event.RESET_DONE,
            Effect.ABORT_MOTION: Event.ABORT_DONE,
        }.get(effect, Event.FAULT)

    actions = SimpleNamespace(perform=perform)
    outcome = await dispatcher_on(journal, actions, metal, Custody.IN_ARM).run()
    assert outcome.end == "aborted"
    assert "arm" not in metal.stopped  # the effect of the state of rest has done that
    journal.close()
