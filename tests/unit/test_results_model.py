"""A run read back from its journal: which run, what it did, how it ended."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest
from results_bench import STEPS, RunWriter, bad_run, good_run, sighting, verdict, view

from controller.cell.batch import run as cell_run
from controller.cell.custody import Custody
from controller.cell.journal import rows
from controller.results.run import ResultsError, list_runs, load_run
from controller.results.run.load import JOURNAL_NAME
from controller.results.writing import write_html


def test_the_journal_is_where_the_cell_writes_it() -> None:
    assert cell_run.JOURNAL_NAME == JOURNAL_NAME


def test_the_newest_run_is_read_unless_another_is_named(tmp_path: Path) -> None:
    good = good_run(tmp_path)
    bad = bad_run(tmp_path)
    assert [r.run_id for r in list_runs(tmp_path)] == [bad.name, good.name]
    assert load_run(tmp_path, None).run_id == bad.name
    assert load_run(tmp_path, good.name).run_id == good.name
    assert load_run(tmp_path, "20260301").run_id == good.name
    assert load_run(Path("nowhere"), str(good)).folder == good


def test_an_unknown_run_is_answered_with_the_runs_there_are(tmp_path: Path) -> None:
    good, bad = good_run(tmp_path), bad_run(tmp_path)
    with pytest.raises(ResultsError, match="no run `fletcher`") as error:
        load_run(tmp_path, "fletcher")
    assert good.name in str(error.value)
    assert bad.name in str(error.value)
    assert "--runs" in str(error.value)
    with pytest.raises(ResultsError, match="2 runs begin with `2026030`"):
        load_run(tmp_path, "2026030")


def test_a_folder_without_a_journal_is_told_as_such(tmp_path: Path) -> None:
    with pytest.raises(ResultsError, match="no journal at"):
        load_run(tmp_path)
    (tmp_path / JOURNAL_NAME).write_text("this is no database, and long enough to be none" * 40)
    with pytest.raises(ResultsError, match="not a database"):
        load_run(tmp_path)


def test_a_run_that_passed_is_read_whole(tmp_path: Path) -> None:
    good_run(tmp_path)
    record = load_run(tmp_path)
    assert record.recipe_name == "featuretype"
    assert record.cell_name == "emulated"
    assert record.outcome.end == "complete"
    assert record.outcome.where == "The part is in its tray (accept)."
    assert (record.speed, record.speed_reached) == (10.0, 6.34)
    assert record.software["cellctl"]
    devices = {d.name: d for d in record.devices}
    assert set(devices) == {"arm", "gripper", "lights", "io", "overhead", "inspection"}
    assert devices["arm"].identity == "UMI RTX, IP0 ROM 1.5"
    assert devices["gripper"].address == "127.0.0.1:1502"
    assert devices["gripper"].identity == ""
    assert record.emulated_devices == tuple(devices)
    (part,) = record.parts
    assert (part.number, part.looks, part.tray, part.custody) == (1, 1, "accept", Custody.PLACED)
    assert part.unconfirmed == ""
    (seen,) = part.sightings
    assert (seen.part, seen.pose_index, seen.theta_deg) == ("featuretype", 2, pytest.approx(30.0))
    assert [s.label for s in part.steps] == [*STEPS, "place in tray accept"]
    assert [(s.forecast_s, s.actual_s) for s in part.steps] == [
        (9.0, 9.5), (4.0, 4.2), (4.0, 6.5), (11.0, 12.25),
    ]  # fmt: skip
    assert [v.view for v in part.views] == ["G1-V0", "G1-V3"]
    assert all(v.evaluated for v in part.views)
    assert part.views[0].shift_mm == 0.73
    assert part.views[0].turn_deg == 0.41
    assert len(part.views[0].pictures) == 3
    assert part.verdict is not None
    assert part.verdict.verdict == "pass"
    assert record.first_broken_row is None


def test_findings_are_numbered_over_all_views_of_a_part(tmp_path: Path) -> None:
    bad_run(tmp_path)
    (part,) = load_run(tmp_path).parts
    assert [(f.number, f.view, f.kind, f.lamp) for f in part.findings] == [
        (1, "G1-V0", "missing material", "backlit"),
        (2, "G1-V0", "surface differs", "station_ring"),
    ]
    off = part.views[1]
    assert off.evaluated is False
    assert off.reason.startswith("outline off by 3.10 px")
    assert (off.shift_mm, off.residual_px) == (None, None)


def test_a_run_that_was_cut_off_says_after_what_and_where_the_part_was(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path)
    writer.look(sighting())
    writer.plan()
    writer.grasp()
    writer.show(STEPS[1], view("G1-V0"), 4.2)
    writer.close()
    record = load_run(tmp_path)
    assert record.outcome.end == "cut_off"
    message = record.outcome.message
    assert message.startswith("the run has no end in the journal: it was cut off after")
    assert "step “show with grasp G1” done in 4.2 s" in message
    assert message.endswith("part 1 then was in the arm gripper (jaws at 30.1 mm)")
    (part,) = record.parts
    assert part.verdict is None
    assert part.views[0].evaluated is None
    assert [s.actual_s for s in part.steps] == [9.5, 4.2, None, None]


def test_a_run_cut_off_while_the_jaws_close_does_not_guess_where_the_part_is(
    tmp_path: Path,
) -> None:
    writer = RunWriter(tmp_path)
    writer.look(sighting())
    writer.plan()
    writer.once("grip", is_done=False)
    writer.close()
    record = load_run(tmp_path)
    assert record.outcome.where.startswith("The position of the part is unknown")
    assert (
        "closing the arm gripper on the part on the table was begun" in record.parts[0].unconfirmed
    )


def test_an_outcome_without_its_change_of_custody_leaves_a_cut_off_run_in_doubt(
    tmp_path: Path,
) -> None:
    writer = RunWriter(tmp_path)
    writer.look(sighting())
    writer.plan()
    writer.once("grip")
    writer.close()
    assert load_run(tmp_path).parts[0].unconfirmed
    writer = RunWriter(tmp_path, "20260303-120000-000-featuretype")
    writer.look(sighting())
    writer.once("grip")
    writer.end("held", "the jaws stopped at 40.0 mm", "grip_wrong", "ON_TABLE")
    assert load_run(tmp_path).parts[0].unconfirmed == ""


def test_a_run_that_found_no_part_keeps_the_cells_own_words(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path)
    writer.look()
    writer.end("held", "no part on the table: lay one on the backlit area", "no_part", "ON_TABLE")
    record = load_run(tmp_path)
    assert (record.outcome.end, record.outcome.code) == ("held", "no_part")
    assert record.parts[0].sightings == ()
    assert record.parts[0].plan is None


def test_a_run_that_broke_off_before_anything_moved_is_told(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path)
    writer.journal.write(rows.RunBrokeOff(error="gripper: no answer", where="x"))
    writer.close()
    record = load_run(tmp_path)
    assert record.outcome.end == "broke_off"
    assert record.outcome.message == "gripper: no answer"
    assert record.parts == ()


def test_steps_belong_to_the_plan_that_was_made_after_a_missed_grip(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path)
    writer.look(sighting(x_mm=300.0))
    writer.plan("pick with grasp G7")
    writer.once("grip")
    message = "the jaws closed on nothing, 30.0 mm was expected (try 1 of 3)"
    writer.write(rows.GraspMissed(message=message))
    writer.custody(Custody.ON_TABLE)
    writer.look(sighting(x_mm=310.0), is_new=False)
    writer.plan()
    writer.grasp()
    writer.close()
    (part,) = load_run(tmp_path).parts
    assert part.looks == 2
    assert part.grasps_missed == (message,)
    assert part.sightings[0].x_mm == 310.0
    assert [s.label for s in part.steps] == [*STEPS, "place in tray reject"]
    assert [s.actual_s for s in part.steps] == [9.5, None, None, None]


def test_each_part_of_a_batch_keeps_its_own_pictures_and_verdict(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path, count=3)
    for _ in range(2):
        writer.whole_part((view("G1-V0"), view("G1-V3")), verdict(), "accept")
    writer.end()
    record = load_run(tmp_path)
    assert [p.number for p in record.parts] == [1, 2]
    assert record.ordered == 3
    pictures = {name for p in record.parts for v in p.views for name in v.pictures.values()}
    assert len(pictures) == 2 * 2 * 3


def test_runs_that_share_a_journal_do_not_mix(tmp_path: Path) -> None:
    first = RunWriter(tmp_path, "20260301-120000-000-featuretype")
    second = RunWriter(tmp_path, "20260301-130000-000-featuretype")
    first.look(sighting(x_mm=111.0))
    second.look(sighting(x_mm=222.0))
    first.close()
    second.close()
    for run, x_mm in (("20260301-12", 111.0), ("20260301-13", 222.0)):
        assert [s.x_mm for s in load_run(tmp_path, run).parts[0].sightings] == [x_mm]


def test_a_changed_row_is_told_by_its_number(tmp_path: Path) -> None:
    bad_run(tmp_path)
    db = sqlite3.connect(tmp_path / JOURNAL_NAME)
    (seq,) = db.execute("SELECT seq FROM journal WHERE name = 'verdict'").fetchone()
    db.execute("DROP TRIGGER journal_keeps_rows")
    db.execute(
        "UPDATE journal SET body = replace(body, '\"fail\"', '\"pass\"') WHERE seq = ?", (seq,)
    )
    db.commit()
    db.close()
    assert load_run(tmp_path).first_broken_row == seq


def test_a_row_of_another_make_is_named_instead_of_crashing(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path)
    writer.number = 1
    writer.journal.record("decision", "plan", {"stages": 3}, part=1)
    writer.close()
    with pytest.raises(ResultsError, match=r"journal row \d+ \(decision plan\) is not what"):
        load_run(tmp_path)


def test_a_refused_start_says_why_and_where_the_part_is(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path)
    writer.write(
        rows.AtRest(
            state="refused", message="The arm gripper may hold a part", custody="IN_ARM",
            code="part_may_be_held", where="The part is in the arm gripper.",
        )
    )  # fmt: skip
    writer.write(rows.RunEnded(end="refused"))
    writer.close()
    record = load_run(tmp_path)
    assert (record.outcome.end, record.outcome.custody) == ("refused", Custody.IN_ARM)
    assert record.outcome.where == "The part is in the arm gripper."
    page = write_html(record, tmp_path / "report.html").read_text()
    assert "refused: a gripper may hold a part" in page


def test_time_spent_in_a_state_is_summed_over_its_visits(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path)
    writer.moved("fault", "execute_acquiring", "aborting", message="door", code="guard_closed")
    writer.moved("abort_done", "aborting", "aborted")
    writer.end("aborted", "door", "guard_closed", "NONE")
    stages = {s.state: s for s in load_run(tmp_path).stages}
    assert set(stages) == {"resetting", "execute_acquiring", "aborting"}
    assert all(s.visits == 1 and s.wall_s >= 0 for s in stages.values())
