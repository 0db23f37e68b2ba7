"""A part in a gripper is known from every folder of runs."""

from __future__ import annotations

import shutil
from datetime import UTC, datetime
from pathlib import Path

import pytest

from controller.cell.custody import CellIdentity, GripperName, fold_custody
from controller.cell.custody.known_journals import (
    JournalLostError,
    after_known,
    note_journal,
    open_noted_journal,
    rows_of_all_journals,
    why_lost,
)
from controller.cell.journal import HOST_STAMPS, Journal, JournalError, Stamps
from controller.cell.journal.rows import CustodyChanged, FilesStored, RunBegan


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "state"
    monkeypatch.setenv("XDG_STATE_HOME", str(folder))
    return folder


def began(clock: str | None = None, *, emulated: bool = False, name: str = "north") -> RunBegan:
    return RunBegan(
        cell={"name": name},
        devices={
            "arm": {"address": f"/dev/arm-{name}"},
            "gripper": {"address": f"{name}:502", "unit": 9},
        },
        emulated_devices=("arm", "gripper") if emulated else (),
        emulator={"pid": 7, "started_wall_s": 1.0} if emulated else {},
        clock=clock,
    )


def run(
    folder: Path,
    name: str,
    body: RunBegan,
    *custody: str,
    stamps: Stamps = HOST_STAMPS,
    is_killed: bool = False,
    is_part_removed: bool = False,
) -> Path:
    """Write the journal of one run that ended, or was killed, after some rows on custody."""
    path = folder / "journal.sqlite"
    body = after_known(body)
    opened = open_noted_journal(path, name, body, stamps, may_begin_anew=is_part_removed)
    journal = opened.journal
    journal.write_synced(body)
    note_journal(journal, body)
    for one in custody:
        journal.write_synced(CustodyChanged(name=one))
    if is_killed:
        journal.leave()
    else:
        journal.close()
    return path


def lose(path: Path, harm: str, older: Path) -> None:
    """Take a journal away from where it is, or put something else there.

    Parameters
    ----------
    path : of the journal
    harm : what is done
    older : a copy of the folder from before
    """
    folder = path.parent
    if harm == "empty":
        for one in folder.iterdir():
            one.unlink()
        path.touch()
        return
    if harm in ("file deleted", "new journal"):
        for one in folder.iterdir():
            one.unlink()
    else:
        shutil.rmtree(folder)
    if harm == "new journal":
        Journal(path, "other").close()
    if harm == "older copy":
        shutil.copytree(older, folder)
    if harm == "another cell's":
        run(folder, "elsewhere", began(name="south"), "placed", is_part_removed=True)


LOSSES = ("folder deleted", "file deleted", "empty", "new journal", "older copy", "another cell's")


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


@pytest.mark.parametrize("text", ["", "{", "[]", '{"journal": 3, "began": {}}'])
def test_a_note_that_cannot_be_read_may_have_been_of_a_part_in_a_gripper(
    tmp_path: Path, state: Path, text: str
) -> None:
    run(tmp_path / "a", "first", began(), "placed")
    (state / "cellctl" / "journals" / "x.json").write_text(text)
    here = run(tmp_path / "b", "second", began())
    assert set(held(here, began())) == set(GripperName)
    run(tmp_path / "b", "third", began(), "removed")
    assert held(here, began()) == {}


def test_notes_that_cannot_be_listed_bar_a_start(tmp_path: Path, state: Path) -> None:
    run(tmp_path / "a", "first", began(), "in_arm")
    shutil.rmtree(state / "cellctl" / "journals")
    (state / "cellctl" / "journals").write_text("a file in the place of the folder")
    with pytest.raises(JournalError, match="lists the journals of this cell"):
        run(tmp_path / "a", "second", began())


@pytest.mark.parametrize("harm", LOSSES)
@pytest.mark.parametrize("is_killed", [False, True])
def test_no_journal_is_made_where_the_noted_one_is_lost(
    tmp_path: Path, harm: str, *, is_killed: bool
) -> None:
    runs, older = tmp_path / "runs", tmp_path / "older"
    run(runs, "first", began(), "in_arm", "placed")
    shutil.copytree(runs, older)
    path = run(runs, "second", began(), "in_arm", is_killed=is_killed)
    lose(path, harm, older)
    before = path.read_bytes() if path.exists() else None
    assert why_lost(path, began())
    with pytest.raises(JournalLostError, match="What the grippers hold is unknown") as caught:
        run(runs, "third", began())
    assert "--part-removed" in str(caught.value)
    assert (path.read_bytes() if path.exists() else None) == before
    # a person vouches for the grippers: until their word is written, what they hold is unknown
    run(runs, "fourth", began(), is_part_removed=True)
    assert set(held(path, began())) == set(GripperName)
    run(runs, "fifth", began(), "removed")
    assert held(path, began()) == {}


@pytest.mark.parametrize("harm", LOSSES)
def test_a_journal_lost_in_another_folder_leaves_custody_unknown(tmp_path: Path, harm: str) -> None:
    runs, older = tmp_path / "runs", tmp_path / "older"
    run(runs, "first", began(), "placed")
    shutil.copytree(runs, older)
    lose(run(runs, "second", began(), "in_arm"), harm, older)
    here = run(tmp_path / "b", "third", began())
    assert set(held(here, began())) == set(GripperName)


def test_a_word_that_is_never_written_leaves_the_journal_lost(tmp_path: Path) -> None:
    path = run(tmp_path / "runs", "first", began(), "in_arm")
    shutil.rmtree(path.parent)
    opened = open_noted_journal(path, "second", began(), may_begin_anew=True)
    opened.journal.leave()  # killed before it noted the new journal
    assert why_lost(path, began())


def test_a_journal_that_was_moved_with_all_its_rows_is_the_same(tmp_path: Path) -> None:
    path = run(tmp_path / "runs", "first", began(), "in_arm", is_killed=True)
    shutil.copytree(path.parent, tmp_path / "copy")
    shutil.rmtree(path.parent)
    shutil.copytree(tmp_path / "copy", path.parent)
    assert not why_lost(path, began())
    assert held(path, began()) == {GripperName.ARM: "first"}


def test_rows_that_a_power_cut_takes_were_never_noted(tmp_path: Path) -> None:
    path = tmp_path / "runs" / "journal.sqlite"
    journal = Journal(path, "first")
    journal.write_synced(began())
    shutil.copytree(path.parent, tmp_path / "disk")  # what is on the disk for sure
    journal.write(FilesStored({}))
    note_journal(journal, began())
    journal.leave()
    shutil.rmtree(path.parent)
    shutil.copytree(tmp_path / "disk", path.parent)
    assert not why_lost(path, began())


def test_two_cells_that_share_a_folder_are_both_known_elsewhere(tmp_path: Path) -> None:
    north, south = began(), began(name="south")
    run(tmp_path / "runs", "first", north, "in_arm")
    path = run(tmp_path / "runs", "second", south, "placed")
    here = run(tmp_path / "b", "third", north)
    assert held(here, north) == {GripperName.ARM: "first"}
    shutil.rmtree(path.parent)
    run(tmp_path / "runs", "fourth", north, "removed", is_part_removed=True)
    # what the south cell has in its grippers nobody has said
    with pytest.raises(JournalLostError):
        run(tmp_path / "runs", "fifth", south)


def at(hour: int) -> Stamps:
    """Return a wall clock that stands at an hour of a day."""
    return Stamps(utc=lambda: datetime(2026, 3, 1, hour, tzinfo=UTC))


def test_of_runs_in_several_folders_the_later_counts_though_the_clock_was_set_back(
    tmp_path: Path,
) -> None:
    first = run(tmp_path / "a", "first", began(), "placed", stamps=at(12))
    run(tmp_path / "b", "second", began(), "in_arm", stamps=at(10))
    assert held(first, began()) == {GripperName.ARM: "second"}
    run(tmp_path / "a", "third", began(), "removed", stamps=at(9))
    assert held(first, began()) == {}
    run(tmp_path / "c", "fourth", began(), "in_fixture", stamps=at(8))
    assert held(first, began()) == {GripperName.FIXED: "fourth"}


def test_a_journal_that_is_lost_is_older_than_what_came_after_its_last_run(tmp_path: Path) -> None:
    lost = run(tmp_path / "a", "first", began(), "in_arm", stamps=at(12))
    here = run(tmp_path / "b", "second", began(), "removed", stamps=at(10))
    shutil.rmtree(lost.parent)
    assert held(here, began()) == {}
