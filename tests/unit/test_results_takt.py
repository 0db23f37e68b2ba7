"""What the arm's time went into: spans between rows, added up by part, run and lot."""

import json
from collections.abc import Sequence
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest

from controller.cell.journal import JOURNAL_NAME, Body, Journal, rows
from controller.cli.app import main
from controller.results.run import ResultsError, load_run
from controller.results.takt import TimeUse, grouped, run_takt, takt_json, takt_line, takts_of


def moved(event: str, source: str, target: str) -> rows.CellEvent:
    return rows.CellEvent(name=event, answer="handled", source=source, target=target)


def path() -> rows.PathBegun:
    return rows.PathBegun(waypoints=((0.0,) * 6,))


def plan(forecast_s: float, **more: Any) -> rows.PlanMade:
    return rows.PlanMade(
        steps=("pick", "park"), seconds=(9.0, 3.0), forecast_s=forecast_s, covered_fraction=1.0,
        reachable_fraction=1.0, **more,
    )  # fmt: skip


PRESSED = rows.HoldPressed(opening_mm=30.0, held_mm=30.0)


def write(
    folder: Path,
    timed: Sequence[tuple[float | None, Body]],
    run: str = "run-1",
    recipe: str = "holder",
    lot: str = "",
) -> Path:
    """Write a run whose rows say when they were written by the cell's clock, 5000 s at its start.

    Rows without an instant are from a time without a clock, as all rows of old journals.
    """
    journal = Journal(folder / JOURNAL_NAME, run)
    journal.write(rows.RunBegan(recipe={"name": recipe}, lot=lot))
    number = 1
    for at_s, row in timed:
        journal.cell_clock = None if at_s is None else lambda at_s=at_s: 5000.0 + at_s  # type: ignore[misc]
        is_of_part = not isinstance(row, rows.CellEvent | rows.AtRest | rows.RunEnded)
        journal.write(row, number if is_of_part else None)
        number += isinstance(row, rows.PartDone)
    journal.close()
    return folder


# One part: a second by each use has a length of its own, so that none can stand for another.
ONE_PART: tuple[tuple[float | None, Body], ...] = (
    (0.0, moved("reset", "stopped", "resetting")),
    (20.0, moved("reset_done", "resetting", "idle")),
    (20.0, moved("start", "idle", "execute_acquiring")),
    (22.0, moved("picture_taken", "execute_acquiring", "execute_recognising")),
    (22.7, moved("part_recognised", "execute_recognising", "execute_planning")),
    (26.0, plan(31.0)),
    (26.0, moved("planned", "execute_planning", "execute_grasping")),
    (27.0, path()),  # the jaws opened for a second
    (31.0, rows.PathEnded()),
    (31.0, rows.Intent(name="grip")),
    (32.5, rows.OnceDone(name="grip")),
    (32.5, moved("grasped", "execute_grasping", "execute_presenting")),
    (32.5, path()),
    (36.5, rows.PathEnded()),
    (37.0, PRESSED),  # half a second of jaws
    (39.0, rows.ViewPicturesTaken(view="V0", pictures={})),  # two before the camera
    (39.0, moved("shown", "execute_presenting", "execute_inspecting")),
    (45.0, moved("all_seen", "execute_inspecting", "execute_placing")),
    (45.0, path()),
    (51.0, rows.PathEnded()),
    (51.0, moved("placed", "execute_placing", "completing")),
    (51.0, rows.PartDone(tray="accept")),
    (51.25, moved("batch_done", "completing", "complete")),
    (51.25, rows.AtRest(state="complete")),
    (60.0, rows.RunEnded(end="complete")),
)


def test_each_use_gets_its_seconds_and_together_they_are_the_whole_run(tmp_path: Path) -> None:
    (run,) = takts_of(write(tmp_path, ONE_PART))
    (part,) = run.parts
    assert {use: s for use, s in part.seconds.items() if s} == pytest.approx(
        {
            TimeUse.TABLE_PICTURES: 2.0,
            TimeUse.RECOGNITION: 0.7,
            TimeUse.PLANNING: 3.3,
            TimeUse.MOVING: 14.0,
            TimeUse.JAWS: 3.0,
            TimeUse.SHOWING: 2.0,
            TimeUse.EVALUATION: 6.0,
            TimeUse.REST: 0.25,
        }
    )
    assert part.is_done
    assert part.forecast_s == 31.0
    assert {use: s for use, s in run.around.seconds.items() if s} == {TimeUse.HOMING: 20.0}
    assert part.total_s + run.around.total_s == pytest.approx(51.25)
    # Execute begins with the start and ends with the part in its tray
    assert part.execute_s == pytest.approx(31.25)
    assert part.busy_s == pytest.approx(19.0)


def test_the_uses_add_up_whatever_rows_stand_between(tmp_path: Path) -> None:
    """Rows of no meaning for the arm, and lists of texts, which have no instant of their own."""
    more = list(ONE_PART)
    for k in range(len(more) - 3, 0, -1):
        more.insert(k, (None, rows.FilesStored({"a.png": "00"})))
        at_s = more[k - 1][0]
        more.insert(k, (at_s, rows.LoopLate(longest_s=0.1, missed_s=0.25, within_s=10.0)))
    (plain,) = takts_of(write(tmp_path / "plain", ONE_PART))
    (run,) = takts_of(write(tmp_path / "more", more))
    assert run.parts[0].seconds == pytest.approx(plain.parts[0].seconds)
    assert run.parts[0].late_wall_s > 0.0


def test_the_arm_before_the_camera_without_pictures_waited_for_results(tmp_path: Path) -> None:
    skipped = [entry for entry in ONE_PART if not isinstance(entry[1], rows.ViewPicturesTaken)]
    (run,) = takts_of(write(tmp_path, skipped))
    assert run.parts[0].seconds[TimeUse.SHOWING] == 0.0
    assert run.parts[0].seconds[TimeUse.EVALUATION] == pytest.approx(8.0)


def test_a_pause_and_a_question_are_nobody_elses_time(tmp_path: Path) -> None:
    timed: list[tuple[float | None, Body]] = [
        (0.0, moved("start", "idle", "execute_grasping")),
        (0.0, path()),
        (3.0, moved("pause_now", "execute_grasping", "suspending_grasping")),
        (4.0, moved("paused", "suspending_grasping", "suspended_grasping")),
        (34.0, moved("resume", "suspended_grasping", "unsuspending_grasping")),
        (35.0, moved("resumed", "unsuspending_grasping", "execute_grasping")),
        (37.0, rows.PathEnded()),
        (37.0, rows.QuestionRaised(code="next_motion", text="?", choices=("go",))),
        (44.0, rows.QuestionAnswered(code="next_motion", choice="go", who="Ann")),
        (44.0, moved("part_problem", "execute_grasping", "holding")),
        (46.0, moved("hold_done", "holding", "held")),
        (56.0, moved("stop", "held", "stopping")),
        (57.0, rows.AtRest(state="stopped")),
    ]
    (run,) = takts_of(write(tmp_path, timed))
    (part,) = run.parts
    assert not part.is_done
    # the arm moves until the pause has begun, and the path goes on after it
    assert part.seconds[TimeUse.MOVING] == pytest.approx(6.0)
    assert part.seconds[TimeUse.PAUSE] == pytest.approx(31.0)
    assert part.seconds[TimeUse.PERSON] == pytest.approx(19.0)
    assert part.execute_s == pytest.approx(3.0 + 9.0)
    assert part.busy_s == pytest.approx(5.0)


def test_a_path_that_a_fault_cut_off_is_over(tmp_path: Path) -> None:
    timed: list[tuple[float | None, Body]] = [
        (0.0, moved("start", "idle", "execute_handing")),
        (0.0, path()),
        (2.0, moved("part_dropped", "execute_handing", "execute_withdrawing")),
        (5.0, moved("withdrawn", "execute_withdrawing", "execute_acquiring")),
        (6.0, rows.AtRest(state="aborted")),
    ]
    (run,) = takts_of(write(tmp_path, timed))
    assert run.parts[0].seconds[TimeUse.MOVING] == pytest.approx(2.0)
    assert run.parts[0].seconds[TimeUse.PLANNING] == pytest.approx(3.0)
    assert run.parts[0].seconds[TimeUse.TABLE_PICTURES] == pytest.approx(1.0)


def two_parts(folder: Path) -> Path:
    first = [entry for entry in ONE_PART if not isinstance(entry[1], rows.AtRest | rows.RunEnded)]
    second = [(None if s is None else s + 31.25, row) for s, row in ONE_PART[3:]]
    at_s, _ = first.pop()
    first.append((at_s, moved("part_done", "completing", "execute_acquiring")))
    return write(folder, [*first, *second], "run-2", lot="L7")


def test_groups_hold_whole_parts_and_a_run_also_what_is_of_none(tmp_path: Path) -> None:
    write(tmp_path, ONE_PART)
    two_parts(tmp_path)
    runs = list(takts_of(tmp_path))
    assert [group.part_count for group in grouped(runs, "run")] == [1, 2]
    assert [group.seconds[TimeUse.HOMING] for group in grouped(runs, "run")] == [20.0, 20.0]
    (recipe,) = grouped(runs, "recipe")
    assert recipe.part_count == 3
    assert recipe.seconds[TimeUse.HOMING] == 0.0
    assert recipe.part_s == pytest.approx(31.25)
    assert [group.name for group in grouped(runs, "lot")] == ["", "L7"]
    assert [group.part_count for group in grouped(runs, "part")] == [1, 1, 1]
    shown = takt_json(recipe)
    assert sum(shown["seconds"].values()) == pytest.approx(shown["total_s"])


def test_seconds_a_part_are_those_of_parts_with_a_verdict(tmp_path: Path) -> None:
    done = [entry for entry in ONE_PART if not isinstance(entry[1], rows.AtRest | rows.RunEnded)]
    at_s, _ = done.pop()
    assert at_s is not None
    cut_off: list[tuple[float | None, Body]] = [
        (at_s, moved("part_done", "completing", "execute_acquiring")),
        (at_s + 500.0, moved("stop", "execute_acquiring", "stopping")),
        (at_s + 501.0, rows.AtRest(state="stopped")),
    ]
    picture = rows.TablePictures({"ring": "pictures/a.png"})
    cut_off.insert(1, (at_s + 1.0, picture))
    write(tmp_path, [*done, *cut_off])
    (group,) = grouped(takts_of(tmp_path), "run")
    assert (group.part_count, group.unjudged_count) == (1, 1)
    assert group.execute_s == pytest.approx(31.25 + 500.0)
    assert group.part_s == pytest.approx(31.25)
    assert "31 s a part (1 without a verdict left out)" in takt_line(group)
    assert (takt_json(group)["s_a_part"], takt_json(group)["unjudged"]) == (31.25, 1)


def test_a_run_is_read_alike_by_itself_and_among_all_runs(tmp_path: Path) -> None:
    write(tmp_path, ONE_PART)
    two_parts(tmp_path)
    for group in grouped(takts_of(tmp_path), "run"):
        assert run_takt(load_run(tmp_path, group.name)) == group


def test_a_journal_without_instants_is_told_by_the_wall_and_says_so(tmp_path: Path) -> None:
    write(tmp_path, [(None, row) for _, row in ONE_PART])
    (group,) = grouped(takts_of(tmp_path), "run")
    assert not group.has_cell_clock
    assert takt_line(group).endswith("(by the wall clock)")


def test_parts_of_several_recipes_in_one_run_are_told_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = [entry for entry in ONE_PART if not isinstance(entry[1], rows.AtRest | rows.RunEnded)]
    first[-1] = (first[-1][0], moved("part_done", "completing", "execute_acquiring"))
    second = [(None if s is None else s + 31.25, row) for s, row in ONE_PART[3:]]
    is_flange = rows.PartIdentified(recipe=1, name="flange")
    is_holder = rows.PartIdentified(recipe=0, name="holder")
    first.insert(5, (22.7, is_holder))
    second.insert(2, (second[1][0], is_flange))
    write(tmp_path, [*first, *second])
    found = grouped(takts_of(tmp_path), "recipe")
    assert [(group.name, group.part_count) for group in found] == [("holder", 1), ("flange", 1)]
    words = ["stats", "flange", "--takt", "--by", "part", "--json", "--runs", str(tmp_path)]
    assert main(words) == 0
    shown = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [group["name"] for group in shown] == ["run-1 2"]
    assert [group["parts"] for group in shown] == [1]


def test_a_plan_made_ahead_is_counted(tmp_path: Path) -> None:
    timed = [
        (s, plan(31.0, is_ahead=True) if isinstance(row, rows.PlanMade) else row)
        for s, row in ONE_PART
    ]
    (group,) = grouped(takts_of(write(tmp_path, timed)), "run")
    assert takt_json(group)["planned_ahead"] == 1


def test_the_line_names_what_the_arm_waited_for_longest_first(tmp_path: Path) -> None:
    (group,) = grouped(takts_of(write(tmp_path, ONE_PART)), "run")
    assert takt_line(group) == (
        "arm busy 61 % of 31 s, 31 s a part; it waited for homing 20 s, evaluation 6 s, "
        "planning 3 s, pictures of the table 2 s, recognition 1 s"
    )


def test_the_command_prints_groups(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(tmp_path, ONE_PART)
    two_parts(tmp_path)
    assert main(["stats", "--takt", "--by", "lot", "--runs", str(tmp_path), "--json"]) == 0
    found = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [(line["event"], line["name"], line["parts"]) for line in found] == [
        ("takt", "", 1),
        ("takt", "L7", 2),
    ]
    assert main(["stats", "holder", "--takt", "--lot", "L7", "--runs", str(tmp_path)]) == 0
    table = capsys.readouterr().out
    assert "60.8 %" in table
    assert "homing" not in table  # of no part
    assert main(["stats", "flange", "--takt", "--runs", str(tmp_path)]) == 0
    assert "no part fits" in capsys.readouterr().out


def test_the_command_takes_runs_of_some_days(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path, ONE_PART)
    (run,) = takts_of(tmp_path)
    day = run.start.date()

    def shown(*words: str) -> str:
        assert main(["stats", "--takt", *words, "--runs", str(tmp_path)]) == 0
        return capsys.readouterr().out

    assert "60.8 %" in shown("--since", str(day), "--until", str(day))
    assert "no part fits" in shown("--since", str(day + timedelta(days=1)))
    assert "no part fits" in shown("--until", str(day - timedelta(days=1)))
    # up to an instant, and not the instant itself
    assert "no part fits" in shown("--until", run.start.isoformat())
    assert "60.8 %" in shown("--since", run.start.isoformat())


@pytest.mark.parametrize("words", [("--by", "colour"), ("--since", "soon"), ("--report", "a.html")])
def test_what_takt_cannot_be_asked_for_is_refused(tmp_path: Path, words: tuple[str, str]) -> None:
    write(tmp_path, ONE_PART)
    assert main(["stats", "--takt", *words, "--runs", str(tmp_path)]) == 2


def test_a_folder_without_a_journal_is_named(tmp_path: Path) -> None:
    with pytest.raises(ResultsError, match="no journal"):
        list(takts_of(tmp_path))
