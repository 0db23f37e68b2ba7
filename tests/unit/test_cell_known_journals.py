"""A part in a gripper is known from every folder of runs."""

from __future__ import annotations

from pathlib import Path

import pytest

from controller.cell.custody import CellIdentity, GripperName, fold_custody
from controller.cell.custody.known_journals import note_journal, rows_of_all_journals
from controller.cell.journal import Journal
from controller.cell.journal.rows import CustodyChanged, RunBegan


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "state"
    monkeypatch.setenv("XDG_STATE_HOME", str(folder))
    return folder


def began(clock: str | None = None, *, emulated: bool = False) -> RunBegan:
    return RunBegan(
        cell={"name": "north"},
        devices={
            "arm": {"address": "/dev/arm"},
            "gripper": {"address": "10.0.0.5:502", "unit": 9},
        },
        emulated_devices=("arm", "gripper") if emulated else (),
        emulator={"pid": 7, "started_wall_s": 1.0} if emulated else {},
        clock=clock,
    )


def run(folder: Path, name: str, body: RunBegan, *custody: str) -> Path:
    """Write the journal of one run that ended after some rows on custody."""
    folder.mkdir(exist_ok=True)
    path = folder / "journal.sqlite"
    journal = Journal(path, name)
    journal.write(body)
    note_journal(path, body)
    for one in custody:
        journal.write(CustodyChanged(name=one), 1)
    journal.close()
    return path


def held(path: Path, body: RunBegan) -> dict[GripperName, str]:
    rows = rows_of_all_journals(path, body)
    return {one.gripper: one.run for one in fold_custody(rows, CellIdentity.of(body))}


def test_a_part_left_by_a_run_in_another_folder_is_known(tmp_path: Path) -> None:
    run(tmp_path / "a", "first", began(), "in_arm")
    here = run(tmp_path / "b", "second", began())
    assert held(here, began()) == {GripperName.ARM: "first"}


def test_what_came_later_counts_whichever_folder_it_was_written_to(tmp_path: Path) -> None:
    first = run(tmp_path / "a", "first", began(), "in_arm")
    run(tmp_path / "b", "second", began(), "removed")
    assert held(first, began()) == {}
    run(tmp_path / "c", "third", began(), "in_fixture")
    assert held(first, began()) == {GripperName.FIXED: "third"}


@pytest.mark.parametrize("damage", ["gone", "cut", "text"])
def test_a_journal_that_knew_the_cell_and_cannot_be_read_leaves_custody_unknown(
    tmp_path: Path, damage: str
) -> None:
    lost = run(tmp_path / "a", "first", began(), "in_arm", "placed")
    if damage == "gone":
        lost.unlink()
    elif damage == "cut":
        lost.write_bytes(lost.read_bytes()[:3000])
    else:
        lost.write_text("no journal")
    here = run(tmp_path / "b", "second", began())
    assert set(held(here, began())) == set(GripperName)
    journal = Journal(here, "second")
    journal.write(CustodyChanged(name="removed", by="operator"))
    journal.close()
    assert held(here, began()) == {}  # the operator's word comes later than what was lost


def test_a_cell_that_a_run_emulates_for_itself_leaves_no_note(tmp_path: Path, state: Path) -> None:
    body = began("/tmp/clock", emulated=True)
    run(tmp_path / "a", "first", body, "in_arm")
    assert not state.exists()
    here = run(tmp_path / "b", "second", body)
    assert held(here, body) == {}


def test_an_emulator_at_given_addresses_is_known_as_long_as_it_lives(tmp_path: Path) -> None:
    clock, other = tmp_path / "clock-1", tmp_path / "clock-2"
    clock.touch()
    other.touch()
    run(tmp_path / "a", "first", began(str(clock)), "in_arm")
    here = run(tmp_path / "b", "second", began(str(clock)))
    assert held(here, began(str(clock))) == {GripperName.ARM: "first"}
    fresh = run(tmp_path / "c", "third", began(str(other)))
    assert held(fresh, began(str(other))) == {}  # another emulator has the same addresses
    clock.unlink()
    assert held(here, began(str(clock))) == {}
    real = run(tmp_path / "d", "fourth", began())
    assert held(real, began()) == {}


def test_a_note_that_makes_no_sense_is_passed_over(tmp_path: Path, state: Path) -> None:
    run(tmp_path / "a", "first", began(), "in_arm")
    for name, text in (("x", "{"), ("y", "[]"), ("z", '{"journal": 3, "began": {}}')):
        (state / "cellctl" / "journals" / f"{name}.json").write_text(text)
    here = run(tmp_path / "b", "second", began())
    assert held(here, began()) == {GripperName.ARM: "first"}
