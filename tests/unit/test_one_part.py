"""A part that several runs had at hand has one record."""

from __future__ import annotations

from pathlib import Path

import pytest

from controller.cell.custody import Custody, GripperName, Held
from controller.cell.custody.start_check import note_taken_out
from controller.cell.journal import JOURNAL_NAME, Journal, read_rows, rows
from controller.history import Filters, fill, list_parts, open_store
from controller.results import counted_parts, load_run, report_json

JUDGED = rows.PartJudged(verdict="pass", reasons=(), compared_fraction=1.0, faces=())


def begun(runs: Path, name: str) -> Journal:
    journal = Journal(runs / JOURNAL_NAME, name)
    journal.write(rows.RunBegan(recipe={"name": "holder"}, count=1))
    return journal


def left_in_arm(runs: Path, name: str) -> None:
    """Write a run that was killed with its part in the arm gripper."""
    journal = begun(runs, name)
    journal.write(rows.Intent(name=rows.Once.GRASP), 1)
    journal.write(rows.CustodyChanged(name="in_arm"), 1)
    journal.close()


def take_over(journal: Journal, *before: str) -> None:
    """Write what a run does that goes on with a part of others, the last of them first."""
    journal.write(rows.PartResumed(run=before[-1]), 1)
    journal.write(rows.CustodyChanged(name="in_arm"), 1)
    for run in before:
        journal.write_about(run, rows.PartFollowed(run=journal.run), 1)


def listed(runs: Path) -> list[tuple[str, str, str]]:
    store = open_store(f"sqlite:///{runs / 'history.sqlite'}")
    try:
        fill(store, runs)
        return [
            (str(one["part"]), str(one["verdict"]), str(one["custody"]))
            for one in list_parts(store, Filters(), 9).parts
        ]
    finally:
        store.close()


def test_a_part_taken_over_twice_is_in_the_last_run_alone(tmp_path: Path) -> None:
    left_in_arm(tmp_path, "first")
    assert listed(tmp_path) == [("first/1", "no verdict", "in_arm")]
    second = begun(tmp_path, "second")
    take_over(second, "first")
    second.close()
    assert listed(tmp_path) == [("second/1", "no verdict", "in_arm")]
    third = begun(tmp_path, "third")
    take_over(third, "first", "second")
    third.write(JUDGED, 1)
    third.write(rows.CustodyChanged(name="placed", detail="accept"), 1)
    third.close()
    assert listed(tmp_path) == [("third/1", "pass", "placed")]
    for run in ("first", "second"):
        record = load_run(tmp_path, run)
        assert counted_parts(record) == ()
        (part,) = report_json(record)["parts"]
        assert (part["followed_by"], part["is_counted"]) == ("third", False)
        assert part["why"] == "Run third has taken the part over, and has its record."
        assert record.outcome.end == "cut_off"  # the row was added, and is no end
        assert "taken over by run third" in " ".join(report_json(record)["cautions"])


def test_a_run_killed_while_it_took_a_part_over_has_no_record_of_it(tmp_path: Path) -> None:
    left_in_arm(tmp_path, "first")
    second = begun(tmp_path, "second")
    second.write(rows.PartResumed(run="first"), 1)
    second.close()
    assert listed(tmp_path) == [("first/1", "no verdict", "in_arm")]
    third = begun(tmp_path, "third")
    take_over(third, "first")
    third.close()
    assert listed(tmp_path) == [("third/1", "no verdict", "in_arm")]


def test_a_part_that_a_person_took_out_is_in_no_gripper_for_ever(tmp_path: Path) -> None:
    left_in_arm(tmp_path, "first")
    second = begun(tmp_path, "second")
    held = Held(GripperName.ARM, Custody.IN_ARM, "first", 1, "2026-03-01T12:00:00+00:00", "")
    elsewhere = Held(GripperName.FIXED, Custody.UNKNOWN, "elsewhere", 2, held.since, "")
    note_taken_out(second, [held, elsewhere])
    second.close()
    assert listed(tmp_path) == [("first/1", "no verdict", "removed")]
    # a run that this journal does not have gets no row in it
    assert {row.run for row in read_rows(tmp_path / JOURNAL_NAME)} == {"first", "second"}


@pytest.mark.parametrize("end", ["", "stopped", "aborted"])
def test_a_part_that_lies_on_the_table_yet_is_counted_by_the_run_that_takes_it(
    tmp_path: Path, end: str
) -> None:
    first = begun(tmp_path, "first")
    first.write(rows.Sightings(sightings=()), 1)
    if end:
        first.write(rows.AtRest(state=end))
    first.close()
    assert listed(tmp_path) == []
    second = begun(tmp_path, "second")
    second.write(rows.Intent(name=rows.Once.GRASP), 1)
    second.close()
    assert [part for part, *_ in listed(tmp_path)] == ["second/1"]


@pytest.mark.parametrize("end", ["complete", "held"])
def test_a_part_that_could_not_be_taken_counts_where_the_run_came_to_its_end(
    tmp_path: Path, end: str
) -> None:
    first = begun(tmp_path, "first")
    first.write(rows.Sightings(sightings=()), 1)
    first.write(rows.AtRest(state=end))
    first.close()
    assert listed(tmp_path) == [("first/1", "no verdict", "on_table")]
