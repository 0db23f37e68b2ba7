"""What the page knows of the cell: folded from rows that the journal's own writer wrote."""

from __future__ import annotations

import asyncio
import http.client
import json
import logging
import os
import socket
import threading
import time
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("starlette", reason="the page's packages are not installed (extra `page`)")
pytest.importorskip("httpx2", reason="starlette's client for tests needs it")

from page_bench import CELL, EYE, HERE, RUN, THERE, bench, journal, picture

from controller.cell.batch.starting import GO_ON, REFUSE
from controller.cell.control import (
    DecisionReply,
    NoRunError,
    Order,
    RunningCell,
    StatusReply,
    left_in_grippers,
)
from controller.cell.custody import Custody
from controller.cell.journal import JOURNAL_NAME, newest_run, read_rows, read_rows_after, rows
from controller.cell.lock import hold_cell
from controller.cell.machine import PAUSE_EVENTS, Event
from controller.cell.operator.questions import LOOK, OUT, STOP
from controller.config import load_cell
from controller.page import serving
from controller.page.now.fold import HeldPart, JournaledArm, RunFold
from controller.page.now.fold import Path as ArmPath
from controller.page.now.live import APART, Live, TooManyWatchersError, light_of
from controller.page.now.scene import CellScene
from controller.page.security import Account, PageAddress, Role
from controller.planning.motion import segment_seconds, tcp_pose
from controller.setup.layout import build_layout
from messages.words import LANGUAGES, words_in

STATUS: dict[str, Any] = {
    "run": RUN,
    "at_s": 3.0,
    "state": "execute_grasping",
    "label": "grasp",
    "step": 1,
    "step_count": 2,
    "custody": "on the table",
    "seconds_left": 12.0,
    "message": "",
    "safe_point": None,
    "pausing": None,
    "pause_seconds": {"step": 9.0, "safe": 4.0, "now": 0.6},
    "first_motion": None,
    "question": None,
    "alarms": [],
    "holder": {"run": RUN, "user": "me", "host": "here", "pid": 1, "since": "now"},
    "signals": {"estop_ok": True, "guard_closed": None},
}


def folded(runs: Path) -> RunFold:
    fold = RunFold(RUN)
    for row in read_rows(runs / JOURNAL_NAME, RUN):
        fold.take(row)
    return fold


def plan_row() -> rows.PlanMade:
    return rows.PlanMade(
        steps=("pick", "show", "place in tray quarantine"),
        seconds=(9.0, 4.0, 7.0),
        forecast_s=20.0,
        covered_fraction=0.9,
        reachable_fraction=1.0,
    )


def test_park_is_ticked_off_with_what_it_took(tmp_path: Path) -> None:
    writer = journal(tmp_path)
    clock = iter((100.0, 109.5, 120.0, 120.1, 123.6))
    writer.cell_clock = lambda: next(clock)
    steps = ("pick", "place in tray quarantine", "park")
    plan = plan_row().model_copy(update={"steps": steps, "seconds": (9.0, 7.0, 3.0)})
    writer.write(plan, 1)
    writer.write(rows.StepDone(label="pick", forecast_s=9.0, seconds=9.5), 1)
    writer.write(rows.StepDone(label="place in tray accept", forecast_s=7.0, seconds=10.5), 1)
    writer.write(rows.PathBegun(waypoints=(HERE,)), 1)
    took = [one["seconds"] for one in folded(tmp_path).facts()["plan"]["steps"]]
    assert took == [9.5, 10.5, None]
    writer.write(rows.PathEnded(), 1)
    writer.close()
    took = [one["seconds"] for one in folded(tmp_path).facts()["plan"]["steps"]]
    assert took == [9.5, 10.5, 3.6]


def test_a_path_that_the_arm_was_at_the_end_of_already_leaves_it_there(tmp_path: Path) -> None:
    writer = journal(tmp_path / "runs")
    for waypoints in ((HERE,), ()):
        writer.write(rows.PathBegun(waypoints=waypoints), 1)
        writer.write(rows.PathEnded(), 1)
    writer.close()
    at = bench(tmp_path)
    at.read()
    assert at.live.fold is not None
    assert (at.live.fold.arm.q, at.live.fold.arm.path) == (HERE, None)


def test_steps_have_their_forecast_and_what_they_took(tmp_path: Path) -> None:
    writer = journal(tmp_path)
    writer.write(plan_row(), 1)
    writer.write(rows.StepDone(label="pick", forecast_s=9.0, seconds=9.5), 1)
    writer.close()
    plan = folded(tmp_path).facts()["plan"]
    assert [(one["label"], one["forecast_s"], one["seconds"]) for one in plan["steps"]] == [
        ("pick", 9.0, 9.5),
        ("show", 4.0, None),
        ("place in tray", 7.0, None),
    ]
    assert (plan["done"], plan["forecast_s"]) == (1, 20.0)


def test_a_step_names_the_tray_that_the_part_went_to_once_it_is_there(tmp_path: Path) -> None:
    writer = journal(tmp_path)
    writer.write(plan_row(), 1)
    for label in ("pick", "show", "place in tray accept"):
        writer.write(rows.StepDone(label=label, forecast_s=4.0, seconds=4.5), 1)
    writer.close()
    steps = folded(tmp_path).facts()["plan"]["steps"]
    assert [one["label"] for one in steps] == ["pick", "show", "place in tray accept"]


def test_the_next_part_begins_with_nothing_of_the_last(tmp_path: Path) -> None:
    writer = journal(tmp_path)
    writer.write(plan_row(), 1)
    writer.write(rows.ViewPicturesTaken(view="V1", pictures={"ring": "a.png"}, q=HERE), 1)
    writer.write(rows.PartDone(verdict="pass", tray="accept"), 1)
    writer.write(rows.TablePictures({"ring": "b.png"}), 2)
    writer.close()
    facts = folded(tmp_path).facts()
    assert (facts["part"], facts["views"], facts["plan"]["steps"]) == (2, [], [])
    done = {"part": 1, "verdict": "pass", "tray": "accept", "recipe": "holder", "serial": ""}
    assert facts["parts"] == [done]
    assert facts["counts"] == {"pass": 1}
    assert facts["table"] == [{"lamp": "ring", "picture": 1}]


def test_each_part_has_the_recipe_and_the_number_that_it_was_identified_by(tmp_path: Path) -> None:
    recipes = tuple(
        rows.RecipeOrdered(recipe={"name": name}, file="", count=1) for name in ("holder", "riser")
    )
    writer = journal(tmp_path, with_cell=False)
    writer.write(rows.RunBegan(recipe={"name": "holder"}, recipes=recipes, count=2))
    writer.write(rows.TablePictures({"ring": "a.png"}), 1)
    assert folded(tmp_path).facts()["at_hand"] == {"recipe": "", "serial": ""}
    writer.write(rows.PartIdentified(recipe=1, name="riser", serial="A<7>"), 1)
    assert folded(tmp_path).facts()["at_hand"] == {"recipe": "riser", "serial": "A<7>"}
    writer.write(rows.PartDone(verdict="fail", tray="reject"), 1)
    writer.write(rows.TablePictures({"ring": "b.png"}), 2)
    writer.close()
    facts = folded(tmp_path).facts()
    assert facts["at_hand"] == {"recipe": "", "serial": ""}
    (done,) = facts["parts"]
    assert (done["recipe"], done["serial"], done["verdict"]) == ("riser", "A<7>", "fail")


def view_row(view: str, *faces: tuple[int, int, int]) -> rows.ViewJudged:
    return rows.ViewJudged(view=view, evaluated=True, faces=faces)


def test_the_coverage_of_a_part_fills_and_the_next_part_begins_with_none(tmp_path: Path) -> None:
    writer = journal(tmp_path)
    writer.write(view_row("V1", (0, 3, 10)), 1)
    writer.write(view_row("V2", (0, 7, 10), (2, 1, 4)), 1)
    before = {"run": RUN, "part": 1, "recipe": "holder", "views": 2}
    assert folded(tmp_path).coverage() == {**before, "faces": [[0, 7, 10], [2, 1, 4]]}
    # as a run before this version has it, and as one whose picture proved nothing
    writer.write(rows.ViewJudged(view="V3", evaluated=False, reason="no outline"), 1)
    after = {**before, "views": 3, "faces": [[0, 7, 10], [2, 1, 4]]}
    assert folded(tmp_path).coverage() == after
    writer.write(rows.TablePictures({"ring": "b.png"}), 2)
    writer.close()
    assert folded(tmp_path).coverage() == {**before, "part": 2, "views": 0, "faces": []}


def test_a_view_gets_its_outline_and_findings_once_it_is_judged(tmp_path: Path) -> None:
    writer = journal(tmp_path)
    writer.write(rows.ViewPicturesTaken(view="V1", pictures={"ring": "a.png"}, q=HERE), 1)
    finding = rows.FindingFields(
        kind="dent",
        lamp="ring",
        area_mm2=3.0,
        size_mm=2.5,
        at_px=(10.0, 20.0),
        box_px=(5, 15, 15, 25),
        p_part_mm=(0.0, 0.0, 0.0),
        faces=(4,),
    )
    outline = tuple((x, 7) for x in range(1000))
    writer.write(
        rows.ViewJudged(view="V1", evaluated=True, outline_px=outline, findings=(finding,)), 1
    )
    writer.close()
    (view,) = folded(tmp_path).facts()["views"]
    assert view["pictures"] == [{"lamp": "ring", "picture": 0}]
    assert [(f["kind"], f["size_mm"], f["box"]) for f in view["findings"]] == [
        ("dent", 2.5, [5, 15, 15, 25])
    ]
    assert view["outline"][0] == [0, 7]
    assert 100 < len(view["outline"]) <= 240


def test_an_alarm_has_number_cause_and_what_to_do_and_is_counted(tmp_path: Path) -> None:
    writer = journal(tmp_path)
    for _ in range(3):
        writer.write(
            rows.DeviceRetried(device="lights", error="no answer", number=1, alarm=910), None
        )
    writer.close()
    (alarm,) = folded(tmp_path).facts()["alarms"]
    assert (alarm["number"], alarm["message"], alarm["times"]) == (910, "no answer", 3)
    assert alarm["words"]
    assert alarm["todo"]


def test_who_acted_is_shown_with_the_reason(tmp_path: Path) -> None:
    writer = journal(tmp_path)
    event = {"answer": "handled", "from": "execute_planning", "to": "suspending_planning"}
    writer.write(
        rows.CellEvent.model_validate(
            {**event, "name": "pause_now", "who": "ada, page (me)", "why": "a screw"}
        )
    )
    writer.close()
    facts = folded(tmp_path).facts()
    assert facts["state"] == "suspending_planning"
    assert [(a["act"], a["who"], a["why"]) for a in facts["acts"]] == [
        ("pause_now", "ada, page (me)", "a screw")
    ]


ORDERED = {"answer": "handled", "from": "held", "to": "held", "who": "ada"}
ACTS: tuple[rows.Body, ...] = (
    *(
        rows.CellEvent.model_validate({**ORDERED, "name": event.value})
        for event in (*PAUSE_EVENTS.values(), Event.RESUME, Event.STOP, Event.NOT_PROVEN)
    ),
    *(
        rows.QuestionAnswered(code="no_part", choice=choice, who="ada")
        for choice in (LOOK, OUT, STOP, GO_ON, REFUSE, "SN-1_2")
    ),
)


@pytest.mark.parametrize("language", sorted(set(LANGUAGES) - {"en"}))
@pytest.mark.parametrize("row", ACTS)
def test_what_people_did_has_its_words_in_each_language(
    tmp_path: Path, row: rows.Body, language: str
) -> None:
    writer = journal(tmp_path)
    writer.write(row)
    writer.close()
    (act,) = (one["act"] for one in folded(tmp_path).facts()["acts"])
    word = words_in(language, act)[act]
    if isinstance(row, rows.QuestionAnswered):
        assert (row.choice in word) is (row.choice == "SN-1_2")


def test_a_row_of_another_version_changes_nothing(tmp_path: Path) -> None:
    writer = journal(tmp_path)
    writer.write(plan_row(), 1)
    writer.close()
    fold = folded(tmp_path)
    before = fold.facts()
    (*_, row) = read_rows(tmp_path / JOURNAL_NAME, RUN)
    from dataclasses import replace

    fold.take(replace(row, seq=row.seq + 1, body={"steps": 7}))
    assert fold.facts() == before
    assert fold.seq == row.seq + 1


def test_rows_are_read_from_the_last_one_on(tmp_path: Path) -> None:
    writer = journal(tmp_path)
    writer.write(plan_row(), 1)
    path = tmp_path / JOURNAL_NAME
    assert newest_run(path) == RUN
    seen = [row.seq for row in read_rows_after(path, 0, RUN)]
    assert len(seen) == 2
    assert list(read_rows_after(path, seen[-1], RUN)) == []
    writer.write(rows.PathEnded(), 1)
    assert [row.name for row in read_rows_after(path, seen[-1], RUN)] == ["path_ended"]
    assert list(read_rows_after(path, 0, "another")) == []
    writer.close()


@pytest.fixture(scope="module")
def scene() -> CellScene:
    return CellScene(build_layout(load_cell(CELL)))


def test_the_arm_is_where_its_path_has_it(scene: CellScene) -> None:
    """Independent of the page: a joint line passes its ends, at the times of the timing model."""
    layout = scene.layout
    seconds = float(segment_seconds(layout, np.array(HERE), np.array(THERE)))
    arm = JournaledArm(HERE, ArmPath(HERE, (THERE,), 100.0))
    for elapsed_s, expected in ((0.0, HERE), (seconds, THERE), (seconds + 50.0, THERE)):
        found = scene.joints(arm, 100.0 + elapsed_s / 5.0, 5.0)
        assert found is not None
        np.testing.assert_allclose(found, expected, atol=1e-6)
    half = scene.joints(arm, 100.0 + seconds / 10.0, 5.0)
    assert half is not None
    np.testing.assert_allclose(half, (np.array(HERE) + np.array(THERE)) / 2, atol=1e-6)
    assert scene.joints(JournaledArm(), 0.0, 1.0) is None


def test_the_part_moves_with_the_gripper_and_stays_where_it_was_let_go(scene: CellScene) -> None:
    grasp = EYE  # the part's frame is the TCP's
    held = HeldPart(Custody.IN_ARM, 1, None, grasp)
    T = scene.moment(JournaledArm(HERE), held, 0.0, 1.0)["part"]
    np.testing.assert_allclose(
        np.array(T).reshape(4, 4), tcp_pose(scene.layout, np.array(HERE)), atol=1e-3
    )
    left = HeldPart(Custody.IN_FIXED, 1, None, None, let_go=(HERE, grasp))
    np.testing.assert_allclose(scene.moment(JournaledArm(THERE), left, 0.0, 1.0)["part"], T)
    assert (
        scene.moment(JournaledArm(HERE), HeldPart(Custody.LOST, 1, EYE), 0.0, 1.0)["part"] is None
    )


def test_a_motion_is_previewed_from_where_the_arm_stands_to_its_goal(scene: CellScene) -> None:
    held = HeldPart(Custody.IN_ARM, 1, T_part_tcp=EYE, arm_mm=20.0)
    motion = scene.ghost(held, (HERE, THERE))
    assert motion is not None
    ends = [tcp_pose(scene.layout, np.array(q))[:3, 3] for q in (HERE, THERE)]
    np.testing.assert_allclose([motion["tcp"][0], motion["tcp"][-1]], ends, atol=0.1)
    at_goal = scene.moment(JournaledArm(THERE), held, 0.0, 1.0)
    assert motion["stops"][-1] == {"T": at_goal["T"], "part": at_goal["part"]}
    stops = [stop["T"] for stop in motion["stops"]]
    assert len(stops) == 3
    assert stops[0] != stops[1] != stops[2]
    free = scene.ghost(HeldPart(Custody.ON_TABLE, 1, EYE), (HERE, THERE))
    assert free is not None
    assert [stop["part"] for stop in free["stops"]] == [None] * 3


@pytest.mark.parametrize("waypoints", [(), (HERE,), ((20.0,), (40.0,))])
def test_a_motion_without_a_path_of_the_arm_is_not_drawn(
    scene: CellScene, waypoints: tuple[tuple[float, ...], ...]
) -> None:
    assert scene.ghost(HeldPart(), waypoints) is None


async def test_a_paused_arm_is_shown_where_it_stands_and_where_it_goes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = {
        "words": "the arm", "tcp_mm": 3.0, "turn_deg": 0.0, "seconds": 1.0,
        "waypoints": [HERE, THERE],
    }  # fmt: skip
    status = StatusReply.model_validate(
        {**STATUS, "state": "suspended_grasping", "first_motion": first}
    )
    monkeypatch.setattr(RunningCell, "status", lambda _: status)
    writer = journal(tmp_path)
    writer.write(rows.PathBegun(effect_class=rows.EffectClass.ABSOLUTE, waypoints=(THERE,)), 1)
    writer.close()
    live = Live(tmp_path)
    poller = asyncio.create_task(live.run())
    stream = live.watch()
    last: dict[str, Any] = {"ghost": {"motion": None}, "moment": {"moves": True}}
    async with asyncio.timeout(60):
        # it stands halfway on its path, as the arm itself reports
        while last["ghost"]["motion"] is None or last["moment"]["moves"]:
            kind, message = await anext(stream)
            last[kind] = json.loads(message)
    motion, moment = last["ghost"]["motion"], last["moment"]
    poller.cancel()
    await asyncio.gather(poller, return_exceptions=True)
    assert moment["q"] == list(HERE)
    assert motion["stops"][-1]["T"] != moment["T"]
    assert "waypoints" not in live.now()["status"]["first_motion"]


def test_the_scene_has_all_that_stands_and_moves(scene: CellScene) -> None:
    standing = scene.standing
    names = {box["name"] for box in standing["boxes"]}
    assert {"column", "fixture_post", "accept", "reject", "quarantine"} <= names
    assert [camera["name"] for camera in standing["cameras"]] == ["overhead", "inspection"]
    moment = scene.moment(JournaledArm(HERE), HeldPart(), 0.0, 1.0)
    assert len(moment["T"]) == len(standing["moving"])
    assert all(len(T) == 16 for T in moment["T"])
    assert moment["known"]
    assert not scene.moment(JournaledArm(), HeldPart(), 0.0, 1.0)["known"]
    json.dumps([standing, moment], allow_nan=False)


@pytest.mark.parametrize(
    ("state", "has_run", "question", "light"),
    [
        ("execute_grasping", True, False, "working"),
        ("suspended_grasping", True, False, "attention"),
        ("held", True, False, "attention"),
        ("execute_acquiring", True, True, "question"),
        ("aborted", True, True, "fault"),
        ("aborted", False, False, "fault"),
        ("stopped", False, False, "off"),
        ("idle", True, False, "resting"),
    ],
)
def test_each_state_has_its_light(state: str, has_run: bool, question: bool, light: str) -> None:
    asked = {"number": 1, "code": "c", "text": "t", "choices": []} if question else None
    status = StatusReply.model_validate({**STATUS, "state": state, "question": asked})
    assert light_of(status if has_run else None, has_run, state) == light


def test_a_cell_that_does_not_answer_needs_attention() -> None:
    assert light_of(None, True, "execute_grasping") == "attention"


async def changes(live: Live, kinds: int) -> dict[str, Any]:
    found: dict[str, Any] = {}
    async for kind, message in live.watch():
        found[kind] = json.loads(message)
        if len(found) >= kinds:
            break
    return found


async def told(stream: AsyncIterator[tuple[str, str]], wanted: str) -> dict[str, Any]:
    """Return the next message of a kind."""
    async for kind, message in stream:
        if kind == wanted:
            found: dict[str, Any] = json.loads(message)
            return found
    raise AssertionError("the stream has ended")


async def test_a_row_reaches_a_browser_and_no_run_is_no_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def nobody(_: RunningCell) -> StatusReply:
        raise NoRunError("no run")

    monkeypatch.setattr(RunningCell, "status", nobody)
    live = Live(tmp_path)
    poller = asyncio.create_task(live.run())
    stream = live.watch()
    _, first = await anext(stream)
    assert json.loads(first)["run"] is None
    assert json.loads(first)["runs"] is False
    writer = journal(tmp_path, with_cell=False)
    async with asyncio.timeout(30):
        while (now := await told(stream, "now")).get("run") is None:
            pass
    assert now["run"]["run"] == RUN
    writer.write(plan_row(), 1)
    async with asyncio.timeout(30):
        while not (await told(stream, "now")).get("run.plan", {}).get("steps"):
            pass
    writer.close()
    poller.cancel()
    await asyncio.gather(poller, return_exceptions=True)


async def test_a_run_that_is_being_prepared_is_named_until_it_has_a_row_and_is_asked(
    tmp_path: Path,
) -> None:
    journal(tmp_path, "20260101-000000-000-before", with_cell=False).close()
    live = Live(tmp_path)
    with hold_cell(tmp_path, load_cell(CELL), RUN, tmp_path / "nobody.sock") as holder:
        poller = asyncio.create_task(live.run())
        stream = live.watch()
        async with asyncio.timeout(30):
            while not (now := await told(stream, "now")).get("preparing"):
                pass
            assert now["preparing"] == {
                "run": RUN, "user": holder.user, "pid": os.getpid(), "since": holder.since,
            }  # fmt: skip
            assert live.now()["silent"] == ""
            assert (live.now()["light"], live.now()["runs"]) == ("resting", True)
            journal(tmp_path, with_cell=False).close()  # it has a row, and still nobody listens
            while "preparing" not in (now := await told(stream, "now")):
                pass
            assert now["preparing"] is None
            assert "nobody listens there yet" in live.now()["silent"]
    poller.cancel()
    await asyncio.gather(poller, return_exceptions=True)


async def until(live: Live, is_so: Callable[[], bool]) -> None:
    """Read what the page sends until something is so."""
    async with asyncio.timeout(30):
        async for _ in live.watch():
            if is_so():
                return


def arm_of(live: Live) -> tuple[str, tuple[float, ...] | None]:
    return ("", None) if live.fold is None else (live.fold.run, live.fold.arm.q)


async def test_a_part_left_in_a_gripper_is_one_state_with_its_evidence_even_in_the_next_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found: list[StatusReply | None] = [None]

    def status(_: RunningCell) -> StatusReply:
        if found[0] is None:
            raise NoRunError("no run")
        return found[0]

    monkeypatch.setattr(RunningCell, "status", status)
    writer = journal(tmp_path)
    writer.write(rows.StoodFree(q=HERE), 1)
    writer.write(rows.CustodyChanged(name=Custody.IN_ARM.key, detail="jaws at 12 mm"), 1)
    writer.close()  # killed here
    live = Live(tmp_path)
    poller = asyncio.create_task(live.run())
    try:
        await until(live, lambda: live.now()["unfinished"] is not None)
        now = live.now()
        assert now["light"] == "fault"
        assert now["unfinished"]["custody"] == "in the arm gripper"
        (why,) = now["unfinished"]["evidence"]
        assert "jaws at 12 mm" in why
        # the next run asks what to do: nothing of its own says where arm and part are
        journal(tmp_path, "20261124-090000-001-holder").close()
        found[0] = StatusReply.model_validate({**STATUS, "state": "stopped"})
        live.refresh()
        await until(live, lambda: arm_of(live) == ("20261124-090000-001-holder", HERE))
        assert live.now()["unfinished"]["custody"] == "in the arm gripper"
        assert live.fold is not None
        assert live.fold.part.custody is Custody.IN_ARM
        found[0] = StatusReply.model_validate({**STATUS, "state": "execute_recovering"})
        live.refresh()
        await until(live, lambda: live.now()["unfinished"] is None)
    finally:
        poller.cancel()
        await asyncio.gather(poller, return_exceptions=True)


async def test_a_cell_that_ended_with_its_run_leaves_no_part(tmp_path: Path) -> None:
    writer = journal(tmp_path, with_cell=False)
    writer.close()
    began = rows.RunBegan(emulated_devices=("arm", "gripper"), emulator={"pid": 7})
    writer = journal(tmp_path, with_cell=False)
    writer.write(rows.CustodyChanged(name=Custody.IN_ARM.key), 1)
    writer.close()
    assert left_in_grippers(tmp_path / JOURNAL_NAME, began) == ()


def test_a_status_that_is_not_fresh_is_not_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    live = Live(tmp_path)
    live._status, live._has_run = StatusReply.model_validate(STATUS), True
    assert live.now()["light"] == "working"
    live._asked_s = 100.0
    monkeypatch.setattr(time, "monotonic", lambda: 104.0)
    now = live.now()
    assert (now["light"], now["status"]) == ("attention", None)
    assert "no answer" in now["silent"]


async def test_a_run_that_writes_its_report_is_at_rest_and_no_silent_cell(tmp_path: Path) -> None:
    writer = journal(tmp_path, with_cell=False)
    writer.write(rows.AtRest(state="complete", message="", code="", custody="PLACED"))
    writer.close()
    live = Live(tmp_path)
    with hold_cell(tmp_path, load_cell(CELL), RUN, tmp_path / "nobody.sock"):
        poller = asyncio.create_task(live.run())
        try:
            await until(live, lambda: live.fold is not None and live.now()["ending"])
        finally:
            poller.cancel()
            await asyncio.gather(poller, return_exceptions=True)
        assert (live.now()["light"], live.now()["silent"]) == ("resting", "")


async def test_a_browser_that_reads_nothing_costs_one_message_of_each_kind(tmp_path: Path) -> None:
    live = Live(tmp_path)
    stream = live.watch()
    live.publish()
    assert (await anext(stream))[0] == "now"
    writer = journal(tmp_path, with_cell=False)
    for number in range(50):
        writer.write(rows.TablePictures({"ring": f"{number}.png"}), number + 1)
        live.look()
        live.publish()
    writer.close()
    (now_kind, now), (kind, coverage) = [await anext(stream) for _ in range(2)]
    assert (now_kind, kind) == ("now", "coverage")
    assert json.loads(now)["run"]["part"] == json.loads(coverage)["part"] == 50
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(0.3):
            await anext(stream)


async def test_only_what_has_changed_is_sent_and_a_new_browser_gets_all(tmp_path: Path) -> None:
    writer = journal(tmp_path, with_cell=False)
    live = Live(tmp_path)
    live.look()
    live.publish()
    stream = live.watch()
    first = json.loads((await anext(stream))[1])
    assert {name: first[name] for name in first if name.startswith("run.")} == {
        f"run.{name}": live.now()["run"][name] for name in APART
    }
    assert {**first, **{f"run.{name}": None for name in APART}}.keys() == first.keys()
    await anext(stream)  # the coverage
    writer.write(plan_row(), 1)
    writer.write(rows.StepDone(label="pick", forecast_s=9.0, seconds=9.5), 1)
    live.look()
    live.publish()
    kind, message = await anext(stream)
    assert (kind, set(json.loads(message))) == ("now", {"run", "run.plan"})
    writer.write(rows.StepDone(label="show", forecast_s=4.0, seconds=4.5), 1)
    live.look()
    live.publish()
    writer.close()
    waiting = {kind: json.loads(message) async for kind, message in _two(stream)}
    assert set(waiting) == {"coverage", "now"}
    assert set(waiting["now"]) == {"run.plan"}
    new = live.watch()
    assert set(json.loads((await anext(new))[1])) == set(first)
    for one in (stream, new):
        await one.aclose()


async def _two(stream: AsyncIterator[tuple[str, str]]) -> AsyncIterator[tuple[str, str]]:
    for _ in range(2):
        yield await anext(stream)


async def test_a_page_that_ends_ends_its_streams(tmp_path: Path) -> None:
    live = Live(tmp_path)
    live.publish()
    stream = live.watch()
    await anext(stream)
    waiting = asyncio.create_task(anext(stream, None))
    await asyncio.sleep(0)
    live.hang_up()
    async with asyncio.timeout(30):
        assert await waiting is None
        assert [found async for found in live.watch()] == []


def test_the_server_ends_quietly_while_browsers_look(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    journal(tmp_path / "runs").close()
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port: int = free.getsockname()[1]
    page = bench(tmp_path, PageAddress.served("127.0.0.1", port, with_tls=False)).page
    app = serving.build(tmp_path / "runs", tmp_path, page.site, page.accounts, page.sessions)
    listens = threading.Event()
    server = serving.server_of(app, serving.Serving("127.0.0.1", port), listens.set)
    thread = threading.Thread(target=server.run)
    thread.start()
    assert listens.wait(timeout=600)  # it is said once browsers get in, and not before
    lines = [http.client.HTTPConnection("127.0.0.1", port) for _ in range(3)]
    lines[0].request("GET", f"/enter?token={page.sessions.link(Account('ada', Role.VIEWER))}")
    entered = lines[0].getresponse()
    entered.read()
    cookies = entered.headers.get_all("Set-Cookie") or []
    cookie = {"Cookie": "; ".join(one.partition(";")[0] for one in cookies)}
    looks = []
    for line in lines:
        line.request("GET", "/now/events", headers=cookie)
        looks.append(line.getresponse())
    assert all(look.readline().startswith(b"retry") for look in looks)
    server.should_exit = True
    assert all(b"event: now" in look.read() for look in looks)  # up to the end of the stream
    thread.join()
    for line in lines:
        line.close()
    assert [one.getMessage() for one in caplog.records if one.levelno >= logging.WARNING] == []


async def test_there_is_no_room_for_endless_browsers(tmp_path: Path) -> None:
    live = Live(tmp_path)
    live.publish()
    streams = [live.watch() for _ in range(41)]
    for stream in streams[:40]:
        await anext(stream)
    with pytest.raises(TooManyWatchersError):
        await anext(streams[40])
    await streams[0].aclose()
    stream = live.watch()
    await anext(stream)
    for one in (*streams[1:40], stream):
        await one.aclose()


def test_another_journal_in_the_same_place_is_read_anew(tmp_path: Path) -> None:
    writer = journal(tmp_path, with_cell=False)
    writer.write(rows.PathEnded(), 1)
    writer.close()
    live = Live(tmp_path)
    assert live.look()
    assert not live.look()
    for path in tmp_path.glob(f"{JOURNAL_NAME}*"):
        path.unlink()
    assert live.look()
    assert live.fold is None
    journal(tmp_path, "20261124-090000-002-holder", with_cell=False).close()
    assert live.look()
    assert live.fold is not None
    assert live.fold.run == "20261124-090000-002-holder"


def test_a_damaged_journal_is_named_and_the_page_goes_on(tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / JOURNAL_NAME).write_bytes(b"no database" * 100)
    at = bench(tmp_path)
    at.log_in()
    assert at.client.get("/now").status_code == 200
    assert at.client.get("/now/scene").status_code == 404
    assert at.client.get("/now/mesh").status_code == 404


def test_pictures_scene_and_mesh_are_handed_out(tmp_path: Path) -> None:
    writer = journal(tmp_path / "runs")
    picture(tmp_path / "runs", "pictures/a.png")
    writer.write(rows.TablePictures({"ring": "pictures/a.png"}), 1)
    writer.close()
    at = bench(tmp_path)
    at.read()
    at.log_in()
    reply = at.client.get(f"/now/picture/{RUN}/0")
    assert reply.headers["content-type"] == "image/jpeg"
    assert reply.content[:2] == b"\xff\xd8"
    assert at.client.get("/now/scene").json()["moving"]
    assert "why" in at.client.get("/now/mesh").json()  # the recipe's part is no file


def test_orders_that_the_cell_refuses_come_back_with_its_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reply = DecisionReply(decision="refused", state="resetting", reason="homing goes on")
    monkeypatch.setattr(RunningCell, "order", lambda *_: reply)
    at = bench(tmp_path)
    status, text = at.act("pause", {"kind": "now"}, at.log_in())
    assert (status, json.loads(text)["reason"]) == (409, "homing goes on")


def test_a_number_that_was_read_reaches_the_cell_as_an_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent: list[tuple[str, Order]] = []

    def order(_: RunningCell, name: str, body: Order) -> DecisionReply:
        sent.append((name, body))
        reason = "SN <1>: a part of this run has this number already"
        return DecisionReply(decision="refused", state="execute_acquiring", reason=reason)

    monkeypatch.setattr(RunningCell, "order", order)
    at = bench(tmp_path)
    csrf = at.log_in()
    status, text = at.act("answer", {"key": "SN <1>", "number": 4}, csrf)
    assert (status, "already" in json.loads(text)["reason"]) == (409, True)
    assert at.act("answer", {"key": "x" * 81, "number": 4}, csrf)[0] == 422
    assert at.act("answer", {"key": "", "number": 4}, csrf)[0] == 422
    ((name, body),) = sent
    assert (name, body.model_dump()["key"], body.model_dump()["number"]) == ("answer", "SN <1>", 4)


def test_without_a_run_an_order_is_answered_with_a_sentence(tmp_path: Path) -> None:
    at = bench(tmp_path)
    status, text = at.act("stop", {}, at.log_in())
    assert status == 503
    assert "no run at this cell" in text


def test_own_files_are_compressed_and_kept_by_the_browser(tmp_path: Path) -> None:
    at = bench(tmp_path)
    reply = at.client.get("/static/now/now.js")
    assert reply.headers["content-encoding"] == "gzip"
    again = at.client.get("/static/now/now.js", headers={"If-None-Match": reply.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    plain = at.client.get("/static/now/now.js", headers={"Accept-Encoding": "identity"})
    assert plain.text == reply.text
