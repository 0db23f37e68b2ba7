"""The watch over a simulated cell notices what must not happen: each rule is broken on purpose."""

import asyncio
import os
import random
from collections.abc import Callable
from pathlib import Path

import pytest

from controller.cell.journal import Journal, first_flaw, read_rows
from controller.cell.journal.rows import CustodyChanged, Overtaken, PartJudged, RecoveryBegun
from simulation.case import recoveries_and_verdict
from simulation.cell import Scene, SimulatedCell
from simulation.faults import FAULTS, Cause, names_it
from simulation.invariants import Watch
from simulation.loop import SimulatedLoop
from simulation.power import cut_power


def rules_broken(folder: Path, breaking: Callable[[SimulatedCell, Watch], None]) -> set[str]:
    """Return the rules that a watch finds broken in a cell that something is done to."""
    loop = SimulatedLoop(1)
    cell = SimulatedCell(loop, 1, Scene("holder"), folder)

    async def story() -> Watch:
        async with cell:
            watch = Watch(cell)
            cell.after_slice = watch.look
            await asyncio.sleep(0.1)
            breaking(cell, watch)
            await asyncio.sleep(1.0)
            return watch

    try:
        return {one.rule for one in loop.run_until_complete(story()).violations}
    finally:
        cell.close()
        loop.bury()
        loop.close()


def test_what_controllers_recovered_from_is_read_by_its_name(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "journal.sqlite", "run")
    for number, fault in enumerate(("part_lost", "grip_missed"), 1):
        journal.write(RecoveryBegun(fault=fault, reason="r", action="a", number=number), 1)
    journal.write(
        PartJudged(verdict="pass", reasons=(), compared_fraction=1.0, faces=(), found=()), 1
    )
    journal.close()
    found = recoveries_and_verdict(journal.path)
    assert found == (["part_lost", "grip_missed"], "pass")


def test_a_message_about_something_else_names_no_fault_of_the_inputs() -> None:
    for fault in ("I/O silent", "I/O line cut", "I/O without power"):
        assert names_it(FAULTS[fault], "I/O block (unit 1): no answer")
        assert not names_it(FAULTS[fault], "the arm's position is not known after its motion")
    assert not names_it(FAULTS["24 V lost"], "repair the chair")


def test_a_simulated_cell_leaves_the_environment_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", "/somewhere")
    rules_broken(tmp_path, lambda cell, watch: cell.controller().start().cancel())
    assert os.environ["XDG_STATE_HOME"] == "/somewhere"


def test_a_cell_in_which_nothing_happens_breaks_no_rule(tmp_path: Path) -> None:
    assert rules_broken(tmp_path, lambda cell, watch: None) == set()


def test_a_motion_after_a_stop_is_noticed(tmp_path: Path) -> None:
    def moved(cell: SimulatedCell, watch: Watch) -> None:
        watch.stopped()
        cell.loop.call_later(0.6, lambda: cell.befall("arm_push", axis="shoulder", counts=80))

    assert rules_broken(tmp_path, moved) == {"motion after a stop"}


def test_a_motor_whose_stop_was_not_confirmed_may_go_on(tmp_path: Path) -> None:
    def moved(cell: SimulatedCell, watch: Watch) -> None:
        watch.stopped(frozenset({"arm"}))
        cell.loop.call_later(0.6, lambda: cell.befall("arm_push", axis="shoulder", counts=80))

    assert rules_broken(tmp_path, moved) == set()


@pytest.mark.parametrize("custody", ["in_arm", "in_fixture", "in_both"])
def test_a_custody_that_is_not_so_is_noticed(tmp_path: Path, custody: str) -> None:
    def claims(cell: SimulatedCell, watch: Watch) -> None:
        journal = Journal(cell.journal_path, "run")
        journal.write(CustodyChanged(name=custody), 1)
        journal.close()
        watch.check_custody(list(read_rows(cell.journal_path)))

    assert rules_broken(tmp_path, claims) == {"custody"}


def test_a_row_that_is_lost_is_noticed(tmp_path: Path) -> None:
    def loses(cell: SimulatedCell, watch: Watch) -> None:
        journal = Journal(cell.journal_path, "run")
        journal.write(Overtaken(effect="home", message=""))
        watch.remember_rows()
        journal.close()
        cell.journal_path.unlink()
        Journal(cell.journal_path, "other").close()
        watch.check_journal()

    assert "journal" in rules_broken(tmp_path, loses)


def test_a_fault_that_does_not_fit_the_moment_is_noted_and_none_of_it_happens(
    tmp_path: Path,
) -> None:
    noted: list[str] = []

    def unfit(cell: SimulatedCell, watch: Watch) -> None:
        cause = Cause(cell, watch, random.Random(1))
        cause.now(FAULTS["table camera unplugged"])
        cause.now(FAULTS["table camera unplugged"])
        noted.extend(cause.caused)

    assert rules_broken(tmp_path, unfit) == set()
    assert [": not now" in one for one in noted] == [False, True]


async def test_a_power_cut_takes_unsecured_rows_alone(tmp_path: Path) -> None:
    for seed in range(12):
        path = tmp_path / f"{seed}" / "journal.sqlite"
        journal = Journal(path, "run")
        for number in range(5):
            journal.write(Overtaken(effect="home", message=str(number)))
        secured = await journal.write_secured(CustodyChanged(name="in_arm"), 1)
        for number in range(7):
            journal.write(Overtaken(effect="stop", message=str(number)))
        assert cut_power(path, random.Random(seed)) == secured + 1
        journal.close()
        left = [row.seq for row in read_rows(path)]
        assert left == list(range(1, len(left) + 1))
        assert secured <= len(left) <= secured + 7
        assert first_flaw(path) is None
