"""`cellctl plan`: its answers about a small part, from the cache and anew, and its refusals."""

from __future__ import annotations

import copy
import json
import shutil
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from cad_solids import box, mesh_of, rod
from plan_auditor import audit

from controller.cache import digest_of
from controller.cad.compiled import load_part
from controller.cell.plans import planning as plans
from controller.cli import main
from controller.cli.planning import site
from controller.cli.terminal import progress
from controller.config import load_cell
from controller.planning import Box, GraspRules, NotGraspableError, PlanOptions
from controller.planning.planner import certificates
from controller.results.plan_page import coverage, strip
from controller.setup import planner
from controller.setup.layout import build_layout
from controller.siting import PartScore, SiteReport, SiteScore, site_of

ROOT = Path(__file__).parents[2]
CELL = ROOT / "recipes/cells/emulated.yaml"
HOLDER = ROOT / "recipes/parts/holder.stl"
KINDS = {"pick", "present", "hand_over", "take_back", "set_down", "look", "place", "park"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("plan")


@pytest.fixture(autouse=True)
def _coarse(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Few grips and views are enough to see what the command makes of a plan."""
    few = PlanOptions(
        arm_grasps_per_pose=3,
        arm_grasps_round=4,
        fixed_grasps=4,
        direction_count=30,
        rules=GraspRules().coarse(),
    )
    monkeypatch.setattr(planner, "PlanOptions", lambda: few)
    monkeypatch.setattr(progress, "QUIET_S", 3600.0)  # a busy machine takes longer, and reports it
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
    monkeypatch.setattr(strip, "WIDTHS_PX", (60, 60, 60))
    monkeypatch.setattr(coverage, "SIZE_PX", (60, 48))


@pytest.fixture(scope="module")
def block(folder: Path) -> Path:
    """A block of 50 x 30 x 20 mm with a bore of 10 mm through it."""
    path = folder / "block.stl"
    mesh_of(box(50, 30, 20) - rod(5, 40, 32)).export(path)
    return path


@pytest.fixture
def told(block: Path, capsys: pytest.CaptureFixture[str]) -> Any:
    assert main(["plan", str(block), "--cell", str(CELL), "--pose", "0", "--json"]) == 0
    out = capsys.readouterr()
    # on a slow machine it reports that it is at work; nothing else
    assert all(json.loads(line)["event"] == "progress" for line in out.err.splitlines())
    return json.loads(out.out)


def without_clock(body: dict[str, Any]) -> dict[str, Any]:
    return {k: v for k, v in body.items() if k not in {"seconds", "from_cache"}}


def test_a_plan_has_the_promised_keys(told: dict[str, Any]) -> None:
    for key in ("forecast_s", "covered_fraction", "reachable_fraction", "seconds"):
        assert isinstance(told[key], float)
    assert 0 < told["covered_fraction"] <= told["reachable_fraction"] + 1e-9
    assert set(told["proof"]) == {"cost_s", "bound_s", "gap", "optimal", "scope"}
    for step in told["steps"]:
        assert step["kind"] in KINDS
        assert len(step["q"]) == 6
        assert np.array(step["T_world_part"]).shape == (4, 4)
        assert (step["view_id"] is None) == (step["kind"] not in {"present", "look"})
        assert ("seen_fraction" in step) == (step["kind"] in {"present", "look"})
    for piece in told["unseen"]:
        assert set(piece) >= {"face", "area_fraction", "reason", "kind", "remedy"}
    regrips = [s for s in told["steps"] if s["kind"] in {"take_back", "set_down"}]
    assert told["regrips"] == len(regrips)


def test_seconds_and_shares_of_the_steps_add_up(told: dict[str, Any]) -> None:
    assert sum(s["seconds"] for s in told["steps"]) == pytest.approx(told["forecast_s"])
    new = sum(s.get("new_fraction", 0.0) for s in told["steps"])
    assert new == pytest.approx(told["covered_fraction"])


def test_the_part_is_picked_where_it_lies_and_passed_over_without_moving(
    told: dict[str, Any],
) -> None:
    steps = told["steps"]
    first = next(s for s in steps if s["kind"] != "look")  # what lies may be looked at first
    assert first["kind"] == "pick"
    assert np.allclose(first["T_world_part"], told["T_world_part"], atol=0.05)
    for give, take in pairwise(steps):
        if (give["kind"], take["kind"]) == ("hand_over", "take_back"):
            assert np.allclose(give["T_world_part"], take["T_world_part"], atol=0.05)


def test_the_view_of_every_picture_is_in_the_list(told: dict[str, Any]) -> None:
    shown = [s["view_id"] for s in told["steps"] if s["kind"] == "present"]
    assert [v["view"] for v in told["views"]] == shown


def test_a_plan_from_the_cache_is_the_plan_made_anew_and_is_there_at_once(
    told: dict[str, Any], block: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["plan", str(block), "--cell", str(CELL), "--pose", "0", "--json"]
    assert main(words) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["from_cache"]
    assert again["seconds"] < 1.0  # measured as 0.05 s; a loaded machine is no reason to fail
    assert main([*words, "--no-cache"]) == 0
    anew = json.loads(capsys.readouterr().out)
    assert not anew["from_cache"]
    assert without_clock(anew) == without_clock(again) == without_clock(told)


def test_drawings_are_two_pictures_of_each_step(
    block: Path, told: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["plan", str(block), "--cell", str(CELL), "--pose", "0", "--json"]
    assert main([*words, "--drawings", str(tmp_path / "drawn")]) == 0
    steps = json.loads(capsys.readouterr().out)["steps"]
    assert len(steps) == len(told["steps"])
    names = [step[key] for step in steps for key in ("picture", "picture_outside")]
    assert len(set(names)) == 2 * len(steps)
    for name in names:
        image = cv2.imread(str(tmp_path / "drawn" / name))
        assert image.std() > 1.0


def test_an_auditor_that_has_only_the_json_finds_nothing_wrong(told: dict[str, Any]) -> None:
    assert audit(told) == []
    assert set(told["trays"]) == {"accept", "reject", "quarantine"}
    # not for want of anything to check
    actions = [action for step in told["steps"] for action in step["actions"]]
    assert sum(len(action.get("waypoints", ())) for action in actions) > len(told["steps"])
    assert {action["action"] for action in actions} >= {"open", "move", "close", "look"}
    assert sum(len(step.get("samples", ())) for step in told["steps"]) > 100


def step_of(plan: dict[str, Any], kind: str) -> dict[str, Any]:
    found = next(step for step in plan["steps"] if step["kind"] == kind)
    assert isinstance(found, dict)
    return found


def first_move(plan: dict[str, Any]) -> dict[str, Any]:
    moves = (a for a in step_of(plan, "pick")["actions"] if a["action"] == "move")
    point = next(moves)["waypoints"][0]
    assert isinstance(point, dict)
    return point


def lift_zed(plan: dict[str, Any]) -> None:
    first_move(plan)["q"][3] = 4.0  # zed ends at 0, and somewhat below it


def hurry(plan: dict[str, Any]) -> None:
    point = first_move(plan)
    point["speeds"] = [2.0 * speed for speed in point["speeds"]]


def never_close(plan: dict[str, Any]) -> None:
    step = step_of(plan, "pick")
    step["actions"] = [a for a in step["actions"] if a["action"] != "close"]


def jump_to_the_arm(plan: dict[str, Any]) -> None:
    step_of(plan, "present")["custody"]["before"] = "in_fixture"


def misstate(plan: dict[str, Any]) -> None:
    plan["covered_fraction"] -= 0.01


def see_less(plan: dict[str, Any]) -> None:
    best = max(plan["steps"], key=lambda step: step.get("new_fraction", 0.0))
    del best["samples"][::2]


def move_the_part(plan: dict[str, Any]) -> None:
    step_of(plan, "present")["T_world_part"][0][3] += 0.1


def promise_haste(plan: dict[str, Any]) -> None:
    plan["forecast_s"] -= 1.0


@pytest.mark.parametrize(
    ("spoil", "word"),
    [
        (lift_zed, "zed is at 4.000"),
        (hurry, "faster than the arm"),
        (never_close, "of on_table"),
        (jump_to_the_arm, "begins in_fixture"),
        (misstate, "stated are"),
        (see_less, "not what it states"),
        (move_the_part, "has the part elsewhere"),
        (promise_haste, "forecast are"),
    ],
)
def test_the_auditor_finds_what_is_wrong_with_a_plan(
    spoil: Callable[[dict[str, Any]], None], word: str, told: dict[str, Any]
) -> None:
    plan = copy.deepcopy(told)
    spoil(plan)
    assert any(word in sentence for sentence in audit(plan))


def test_the_page_is_written_beside_the_answer(
    told: dict[str, Any], block: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "deep" / "plan.html"
    words = ["plan", str(block), "--cell", str(CELL), "--pose", "0", "--report", str(page)]
    assert main([*words, "--json"]) == 0
    assert without_clock(json.loads(capsys.readouterr().out)) == without_clock(told)
    text = page.read_text(encoding="utf-8")
    assert text.count('alt="step ') == 2 * len(told["steps"])
    assert len(text) < 5_000_000
    (tmp_path / "file").write_text("")
    assert main([*words[:-1], str(tmp_path / "file" / "plan.html")]) == 2
    assert "--report" in capsys.readouterr().err


def test_people_are_told_what_machines_are(
    told: dict[str, Any], block: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["plan", str(block), "--cell", str(CELL), "--pose", "0"]) == 0
    said = capsys.readouterr().out
    for step in told["steps"]:
        assert step["label"] in said
    assert f"forecast {told['forecast_s']:.0f} s" in said


def test_a_place_out_of_reach_is_the_cells_no(
    block: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = ["--pose", "0", "--at", "2000,0,0"]
    assert main(["plan", str(block), "--cell", str(CELL), *place, "--json"]) == 1
    out = capsys.readouterr()
    body = json.loads(out.out)
    assert body["steps"] == []
    assert body["error"] in out.err
    assert body["certificates"] == []  # of one pose only


def test_without_a_pose_all_are_told_and_the_likeliest_with_a_plan_is_taken(
    told: dict[str, Any],
    block: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    part = load_part(block)
    setup = planner.planner_setup(None, load_cell(CELL), part)
    planning = plans.PlanCache(part, setup.layout, setup.options)
    made = planning.plan_at(part.poses[0], told["x_mm"], told["y_mm"], 0.0).plan
    assert planning.is_from_cache

    def only_pose_two(part: Any, layout: Any, start: Any, **more: Any) -> Any:
        if start.pose_index != 2:
            raise NotGraspableError(f"pose {start.pose_index} is not to be had")
        return made

    monkeypatch.setattr(plans, "plan_from", only_pose_two)
    monkeypatch.setattr(certificates, "plan_from", only_pose_two)
    monkeypatch.setattr(certificates, "PLACE_COUNT", 1)
    words = ["plan", str(block), "--cell", str(CELL), "--at", "350,10,5"]
    assert main([*words, "--json"]) == 0
    body = json.loads(capsys.readouterr().out)
    assert body["pose"] == 2
    assert [c["pose"] for c in body["certificates"]] == list(range(6))  # a block lies on 6 sides
    # the pose opposite is the same by a half turn of the block, and so is its certificate
    planned = [i for i, c in enumerate(body["certificates"]) if c["planned"]]
    assert planned == [2, 3]
    assert body["certificates"][3]["same_as"] == 2
    assert sum(c["probability"] for c in body["certificates"]) == pytest.approx(1.0, abs=0.02)
    assert 0 < body["certificates"][2]["pickable"] <= 1
    assert main(words) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "pose 4 is not to be had" in printed
    assert "as from pose 2, which a symmetry of the part makes the same" in printed


def test_compile_tells_how_a_part_is_held_and_shown_in_a_cell(
    told: dict[str, Any],
    block: Path,
    folder: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert told["steps"]  # so the part is prepared; what is told of it here is not to be kept
    shutil.copytree(folder / "cache", tmp_path / "cache")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    for file in (tmp_path / "cache" / "cellctl").glob("certificate-*"):
        file.unlink()

    def never(*args: Any, **more: Any) -> Any:
        raise NotGraspableError("not today")

    monkeypatch.setattr(certificates, "plan_from", never)
    monkeypatch.setattr(certificates, "PLACE_COUNT", 1)
    assert main(["compile", str(block), "--cell", str(CELL), "--json"]) == 0
    body = json.loads(capsys.readouterr().out)
    assert body["grasps"]["arm"] > 0
    assert body["grasps"]["fixture"] > 0
    assert [c["reason"] for c in body["certificates"]] == ["not today"] * 6
    assert main(["compile", str(block), "--cell", "nowhere.yaml", "--json"]) == 2
    out = capsys.readouterr()
    assert out.out == ""
    assert "nowhere.yaml" in out.err
    assert main(["compile", str(block), "--json"]) == 0
    assert "certificates" not in json.loads(capsys.readouterr().out)


@pytest.mark.parametrize(
    ("more", "needed"),
    [
        (["--pose", "77"], "has stable poses 0 to 2"),
        (["--at", "300,20"], "X,Y,THETA"),
        (["--at", "a,b,c"], "X,Y,THETA"),
        (["--at", "nan,0,0"], "X,Y,THETA"),
        (["--cell", "nowhere.yaml"], "nowhere.yaml"),
    ],
)
def test_a_wrong_option_is_answered_in_a_sentence(
    more: list[str], needed: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["plan", str(HOLDER), "--cell", str(CELL), *more, "--json"]) == 2
    out = capsys.readouterr()
    assert out.out == ""
    assert needed in out.err
    assert len(out.err.strip().splitlines()) == 1


def test_several_parts_are_for_a_site_only(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(HOLDER), str(HOLDER), "--cell", str(CELL)]) == 2
    assert "`plan` takes one part" in capsys.readouterr().err
    assert main(["plan", str(HOLDER), "--cell", str(CELL), "--site", "--pose", "1"]) == 2
    assert "cannot be combined with --pose" in capsys.readouterr().err


def test_a_site_is_told_in_words_and_in_json(
    told: dict[str, Any],
    block: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert told["steps"]  # so the part is prepared
    asked: dict[str, Any] = {}

    def report(parts: Any, layout: Any, options: Any, progress: Any) -> SiteReport:
        asked.update(names=[p.solid.name for p in parts], keep=options.keep_free_mm)
        progress("trying", 1, 2)
        score = PartScore("block", 1.0, 1.0, 0.98, 0.9, 0.5, 0.5, 0.5, 1.0, 20.0, float("nan"))
        now = SiteScore(site_of(layout), (score,), "checked", 0.9, None, {"accept": 0.5})
        moving = {"post": Box.from_bounds(0, 1, 0, 1, 0, 1)}
        words = ("Leave camera and fixed gripper where they are.",)
        return SiteReport(
            now, now, (), 1.0, True, 100, 10, np.eye(4), np.eye(4), moving, sentences=words
        )

    monkeypatch.setattr(site, "site_report", report)
    words = ["plan", str(block), str(block), "--cell", str(CELL), "--site"]
    assert main([*words, "--json"]) == 0
    body = json.loads(capsys.readouterr().out)
    cell = load_cell(CELL)
    glowing = cell.table.glowing_area
    assert asked == {"names": ["block", "block"], "keep": (glowing.x, glowing.y)}
    assert body["stay"] is True
    assert body["best"]["site"]["station_mm"] == list(cell.station.position)
    assert body["present"]["parts"][0]["regrip_s"] is None  # JSON knows no NaN
    assert main(words) == 0
    assert "Leave camera" in capsys.readouterr().out


def test_a_file_that_is_no_part_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "text.stl"
    path.write_text("not a part")
    assert main(["plan", str(path), "--cell", str(CELL)]) == 2
    assert "text.stl" in capsys.readouterr().err
    assert main(["plan", str(tmp_path / "none.stl"), "--cell", str(CELL)]) == 2
    assert "none.stl" in capsys.readouterr().err


def test_a_key_tells_apart_all_that_decides_a_plan() -> None:
    layout = build_layout(load_cell(CELL))
    same = build_layout(load_cell(CELL))
    assert digest_of(layout) == digest_of(same)
    same.station_mm[1] += 1e-9
    assert digest_of(layout) != digest_of(same)
    assert digest_of("ab", "c") != digest_of("a", "bc")
    assert digest_of((1, 2), 3) != digest_of((1,), 2, 3)
    assert digest_of(1) != digest_of(1.0) != digest_of("1")
    with pytest.raises(TypeError, match="object"):
        digest_of(object())
