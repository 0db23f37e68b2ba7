"""Faults the cell must survive: a clear message, the arm stopped, nothing let go, all on record."""

import contextlib
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT, Ran, Run, once_in

from controller.cell.control import AckOrder, ResumeOrder, RunningCell
from controller.cell.journal import first_broken_row, read_rows


def has_ended_well(ran: Ran, code: str, *words: str) -> None:
    """Check what every survived fault has in common."""
    assert ran.code == 1, ran.stderr
    assert ran.result["code"] == code, ran.result
    for word in words:
        assert word in ran.result["message"], ran.result["message"]
    rows = list(read_rows(ran.journal, ran.result["run"]))
    # what was kept of the run is hashed last of all
    assert [row.name for row in rows[-2:]] == ["run_ended", "files_stored"]
    assert first_broken_row(ran.journal) is None
    assert (ran.folder / "report.html").stat().st_size > 0


def test_an_empty_table_is_said_and_nothing_is_gripped(start: Callable[..., Run]) -> None:
    ran = start("recipes/holder.yaml", "--empty").follow()
    has_ended_well(ran, "no_part", "no part on the table")
    assert not [r for r in read_rows(ran.journal) if r.kind == "intent"]


def test_an_emergency_stop_in_motion_stops_the_arm_and_says_so(start: Callable[..., Run]) -> None:
    poses: list[Any] = []

    def press(run: Run) -> None:
        run.control("estop", pressed=True)
        # the world is asked until the run has ended it
        with contextlib.suppress(OSError, ValueError):
            while True:
                poses.append(run.control("truth")["parts"][0])

    ran = start("recipes/holder.yaml", "--seed", "6").follow(once_in("presenting", press))
    has_ended_well(ran, "estop", "emergency stop")
    assert ran.result["end"] == "aborted"
    assert "in the arm gripper" in ran.result["where"]
    # the part still hangs in the hand, and it hangs still
    assert len(poses) > 2
    assert poses[-1]["custody"] == "arm"
    assert poses[-1]["T_world_part"] == poses[-2]["T_world_part"]


@pytest.mark.slow
def test_a_part_that_falls_off_the_table_is_noticed_looked_for_and_asked_for(
    start: Callable[..., Run],
) -> None:
    def take_away(run: Run) -> None:
        run.control("lose_part")
        run.control("remove")

    ran = start("recipes/holder.yaml", "--seed", "7").follow(once_in("presenting", take_away))
    has_ended_well(ran, "part_lost", "gone from the arm gripper", "camera over the table")
    rows = list(read_rows(ran.journal, ran.result["run"]))
    assert [r.name for r in rows if r.kind == "custody"][-1] == "lost"
    assert [r.body["trouble"] for r in rows if r.name == "recovery"] == [
        "part_lost", "part_not_seen", "part_not_seen",
    ]  # fmt: skip
    assert sum(r.name == "table_pictures" for r in rows) == 4


@pytest.mark.slow
def test_ctrl_c_stops_the_arm_and_releases_nothing(start: Callable[..., Run]) -> None:
    ran = start("recipes/holder.yaml", "--seed", "8").follow(
        once_in("presenting", lambda run: run.interrupt())
    )
    has_ended_well(ran, "stop")
    assert ran.result["end"] == "stopped"
    assert "arm gripper" in ran.result["where"]
    opened = [r for r in read_rows(ran.journal) if r.kind == "intent" and r.name == "release"]
    assert not opened


@pytest.mark.slow
@pytest.mark.parametrize("state", ["resetting", "grasping", "handing"])
def test_a_door_that_opens_in_motion_holds_the_run_until_it_is_closed_and_acknowledged(
    start: Callable[..., Run], state: str
) -> None:
    opened = once_in(state, lambda run: run.control("door", closed=False))

    def go_on(run: Run) -> None:
        cell, why = RunningCell(run.runs), "the cell is clear"
        assert cell.order("resume", ResumeOrder()).decision == "refused"
        run.control("door", closed=True)
        while cell.order("ack", AckOrder(why=why)).decision == "refused":
            pass  # until the I/O block has been read
        assert cell.order("resume", ResumeOrder()).decision == "handled"

    closed = once_in(f"suspended_{state}", go_on)

    def watch(body: dict[str, Any], run: Run) -> None:
        opened(body, run)
        closed(body, run)

    ran = start("recipes/holder.yaml", "--seed", "9").follow(watch)
    assert ran.code == 0, ran.stderr
    assert (ran.result["end"], ran.result["code"]) == ("complete", "")
    names = [row.name for row in read_rows(ran.journal, ran.result["run"])]
    held = names[names.index("guard_opened") : names.index("first_motion")]
    assert {"paused", "acknowledged", "resume"} <= set(held)
    # before the arm is homed nobody knows where it stands
    assert "stood_still" in held or state == "resetting"
    assert first_broken_row(ran.journal) is None


@pytest.mark.slow
def test_an_arm_whose_cable_is_pulled_is_known_at_once_and_the_lamps_go_out(
    start: Callable[..., Run],
) -> None:
    ran = start("recipes/holder.yaml", "--seed", "6").follow(
        once_in("presenting", lambda run: run.control("arm_line", unplugged=True))
    )
    has_ended_well(ran, "silent_line", "arm", "emergency stop", "check power, cable")
    # in motion the action reports it, between motions the heartbeat
    assert re.match("in step present: |at rest: ", ran.result["message"])
    assert (ran.result["alarm"]["number"], ran.result["alarm"]["step"]) == (303, "present")
    assert ran.result["end"] == "aborted"
    rows = [r for r in read_rows(ran.journal, ran.result["run"]) if r.kind == "outcome"]
    stops = {r.body["device"]: r.name for r in rows if r.name.startswith("stop")}
    assert stops == {"arm": "stop_not_confirmed", "gripper": "stopped", "lights": "stopped"}


@pytest.mark.slow
def test_what_lies_beside_the_part_is_left_alone(start: Callable[..., Run]) -> None:
    poses: list[dict[str, Any]] = []

    def look(body: dict[str, Any], run: Run) -> None:
        if body.get("state") in ("recognising", "placing"):
            poses.append(run.control("truth")["parts"][1])

    ran = start(
        "recipes/holder.yaml", "--lay", "recipes/parts/holder.stl",
        "--lay", "recipes/parts/idler_riser.stl", "--seed", "3",
    ).follow(look)  # fmt: skip
    assert ran.result["end"] == "complete", ran.result
    (part,) = ran.result["parts"]
    assert part["custody"] == "placed"
    assert {one["custody"] for one in poses} == {"free"}
    first, last = (np.array(one["T_world_part"]) for one in (poses[0], poses[-1]))
    np.testing.assert_allclose(first, last, atol=0.1)  # mm: nothing touched it
    rows = read_rows(ran.journal, ran.result["run"])
    looks = [r.body for r in rows if r.name == "sightings"]
    assert [len(look["sightings"]) for look in looks] == [2] * len(looks)
    assert {look["sightings"][look["taken"]]["part"] for look in looks} == {"holder"}


@pytest.mark.slow
def test_a_stranger_is_not_touched(start: Callable[..., Run]) -> None:
    ran = start(
        "recipes/holder.yaml", "--lay", "recipes/parts/featuretype.stl", "--seed", "3"
    ).follow()
    has_ended_well(ran, "unknown_object", "none of the known parts")
    assert not [r for r in read_rows(ran.journal) if r.kind == "intent"]


@pytest.mark.slow
def test_a_part_out_of_reach_is_named_with_the_reach(
    start: Callable[..., Run], tmp_path: Path
) -> None:
    # A shorter arm on the same table: from its middle all is reached, from its corner nothing is.
    # The part looks alike four ways round, and any of them may be recognised: the nearest grasp of
    # the four asks 384 mm of the wrist, this arm reaches 360 mm.
    text = (ROOT / "recipes/cells/emulated.yaml").read_text()
    short = re.sub(r"(upper_mm|fore_mm): 253.5", r"\1: 180.0", text)
    assert short != text
    cell = tmp_path / "short.yaml"
    cell.write_text(short)
    ran = start(
        "recipes/holder.yaml", "--cell", str(cell), "--at", "490,170,0", "--pose", "0"
    ).follow()
    has_ended_well(ran, "no_plan", "reach", "mm")


@pytest.mark.slow
def test_a_part_that_vanishes_before_the_grip_is_looked_for_again(
    start: Callable[..., Run],
) -> None:
    ran = start("recipes/holder.yaml", "--seed", "4").follow(
        once_in("grasping", lambda run: run.control("remove"))
    )
    has_ended_well(ran, "no_part")
    assert [r for r in read_rows(ran.journal) if r.name == "grip_missed"]


@pytest.mark.slow
def test_a_camera_pulled_out_is_named(start: Callable[..., Run]) -> None:
    ran = start("recipes/holder.yaml", "--seed", "4").follow(
        once_in("presenting", lambda run: run.control("unplug", camera="inspection"))
    )
    has_ended_well(ran, "unplugged", "inspection")


@pytest.mark.slow
def test_an_arm_that_restarts_in_motion_has_lost_its_position(start: Callable[..., Run]) -> None:
    ran = start("recipes/holder.yaml", "--seed", "4").follow(
        once_in("presenting", lambda run: run.control("arm_ip", ip=1, what="restart"))
    )
    has_ended_well(ran, "position_lost", "restart")
    assert "arm gripper" in ran.result["where"]


@pytest.mark.slow
def test_a_killed_run_leaves_a_whole_journal_and_a_report_that_says_so(
    start: Callable[..., Run],
) -> None:
    from controller.results.run import load_run
    from controller.results.writing import write_html

    run = start("recipes/holder.yaml", "--seed", "4")
    watch = once_in("presenting", lambda run: run.kill())
    ran = run.follow(watch)
    assert ran.code == -9
    assert first_broken_row(ran.journal) is None
    record = load_run(ran.runs, None)
    page = write_html(record, ran.runs / "cut.html").read_text()
    assert "cut off" in page
    assert [r.name for r in read_rows(ran.journal) if r.kind == "custody"][-1] == "in_arm"


@pytest.mark.slow
def test_a_dead_backlight_is_no_empty_table(start: Callable[..., Run]) -> None:
    ran = start("recipes/holder.yaml", "--seed", "4").follow(
        once_in("resetting", lambda run: run.control("lamp", name="table_backlight", dead=True))
    )
    has_ended_well(ran, "cell", "light table is dark", "table_backlight")


def has_recovered(ran: Ran, *troubles: str) -> None:
    """Check what every recovery has in common: no person, nothing opened, nothing shown twice."""
    assert ran.code == 0, (ran.result, ran.stderr)
    assert ran.result["end"] == "complete"
    rows = list(read_rows(ran.journal, ran.result["run"]))
    assert first_broken_row(ran.journal) is None
    told = [r.body["trouble"] for r in rows if r.name == "recovery"]
    for trouble in troubles:
        assert trouble in told
    custody = [r.name for r in rows if r.kind == "custody"]
    assert custody[-1] == "placed"
    # the world's own word: no gripper let the part go in the air by opening
    let_go = [e for e in ran.seen["truth"]["events"] if e["what"] == "released"]
    assert all(e["is_held"] or e["lowest_mm"] < 12.0 for e in let_go), let_go
    assert not ran.seen["truth"]["collisions"]


def remembering(watch: Callable[[dict[str, Any], Run], None]) -> Callable[..., None]:
    """Return the watcher with the world's truth asked at the end as well."""

    def both(body: dict[str, Any], run: Run) -> None:
        watch(body, run)
        if body.get("state") in ("complete", "completing"):
            run.seen["truth"] = run.control("truth")

    return both


@pytest.mark.slow
def test_a_part_that_falls_from_the_hand_is_taken_again_and_finished(
    start: Callable[..., Run],
) -> None:
    # as soon as it is lifted, so that it stays within the camera's sight
    watch = once_in("presenting", lambda run: run.control("lose_part"))
    ran = start("recipes/holder.yaml", "--seed", "5").follow(remembering(watch))
    has_recovered(ran, "part_lost")
    custody = [r.name for r in read_rows(ran.journal, ran.result["run"]) if r.kind == "custody"]
    assert custody[:4] == ["in_arm", "lost", "on_table", "in_arm"]


@pytest.mark.slow
def test_a_part_that_slips_in_the_hand_is_measured_and_shown_on(start: Callable[..., Run]) -> None:
    # after the first view, which has measured the hold
    watch = once_in("inspecting", lambda run: run.control("slip", along_mm=-3.0))
    ran = start("recipes/holder.yaml", "--seed", "5").follow(remembering(watch))
    has_recovered(ran, "held_otherwise")
