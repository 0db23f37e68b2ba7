"""A part that several runs had at hand has one record."""

from __future__ import annotations

from pathlib import Path

import pytest

from controller.cell.batch import Papers
from controller.cell.custody import Custody, GripperName, Held
from controller.cell.custody.start_check import note_taken_out
from controller.cell.journal import JOURNAL_NAME, Journal, read_rows, rows
from controller.history import Filters, fill, list_parts, open_store
from controller.results.judged import counted_parts
from controller.results.report import report_json
from controller.results.run import load_run
from controller.results.takt import takt_of, takts_of
from tests.unit.outlets import OUTLETS
from tests.unit.results_bench import RunWriter, verdict, view

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


MEASURED = rows.PartMeasured(
    characteristics=(
        rows.CharacteristicFields(
            id="d1", balloon=1, kind="diameter", label="bore 8", nominal=8.0, lower=7.9, upper=8.1,
            source="recipe", faces=(1,), measured=8.03, U=0.02, verdict="pass",
        ),
    )
)  # fmt: skip
POSED = rows.ViewsPosed(
    views=tuple(
        rows.ViewOffFields(view=f"G1-V{i}", grasp=0, off_mm=0.2, off_deg=0.0) for i in range(3)
    )
)


def taken_and_judged(writer: RunWriter) -> None:
    """Let a run have its part in the arm, and judge it; it is not put down yet."""
    writer.look()
    writer.plan()
    writer.grasp()
    for one in (view("G1-V0"), view("G1-V3")):
        writer.show("show with grasp G1", one, 4.0)
        writer.judge_view(one)
    writer.write(POSED)
    writer.write(MEASURED)
    writer.judge(verdict())


@pytest.fixture(scope="module")
def recovered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs of one part: killed before its sort, taken over by a run that was killed, then whole."""
    runs = tmp_path_factory.mktemp("recovered")
    papers = Papers(serials=("SN1",))
    names = [f"2026030{day}-120000-000-featuretype" for day in (1, 2, 3)]
    before: list[str] = []
    for name in names:
        writer = RunWriter(runs, name, papers=papers)
        if before:
            writer.journal.write(rows.PartResumed(run=before[-1], serial="SN1"), 1)
        taken_and_judged(writer)
        for run in before[-2:]:
            writer.journal.write_about(run, rows.PartFollowed(run=name), 1)
        if name == names[-1]:
            writer.place("accept")
            writer.moved("batch_done", "execute_placing", "completing")
            writer.end()
        else:
            writer.close()
        before.append(name)
    return runs


@pytest.mark.parametrize("outlet", OUTLETS)
def test_a_part_that_went_on_in_other_runs_is_one_part_in_each_outlet(
    recovered: Path, outlet: str
) -> None:
    found = OUTLETS[outlet](recovered)
    assert len(found) == 1, f"{outlet}: {found}"


def test_the_time_of_a_run_that_took_a_part_over_is_whole(recovered: Path) -> None:
    """A row that it adds to the run before it is in the middle of its own."""
    *killed, whole = takts_of(recovered)
    assert takt_of(load_run(recovered, whole.run_id)) == whole
    assert [(part.is_done, part.is_counted) for part in whole.parts] == [(True, True)]
    for one in (*killed, *(takt_of(load_run(recovered, run.run_id)) for run in killed)):
        assert [(part.is_done, part.is_counted) for part in one.parts] == [(False, False)]
