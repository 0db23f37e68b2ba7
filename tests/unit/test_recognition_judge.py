"""The judge of recognition: what it counts as right, wrong, missed and made up."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from cad_solids import box, mesh_of, prism, rod
from data_files import part_file, true_pictures
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from recognition_judge import (
    Alternative,
    Answer,
    Judge,
    Thing,
    confusion,
    failures,
    figures,
    pair,
    read_answer,
    read_things,
    reliability,
)
from recognition_runs import run, smaller
from recognition_symmetry import Surface

Array = NDArray[np.float64]
UPRIGHT = np.eye(3)


def about(axis: str, degrees: float) -> Array:
    return np.asarray(Rotation.from_euler(axis, degrees, degrees=True).as_matrix())


def l_block() -> trimesh.Trimesh:
    """An L of unequal legs: no turn of any kind takes it into itself."""
    return mesh_of(prism([(0, 0), (40, 0), (40, 10), (15, 10), (15, 25), (0, 25)], 12))


def made(kind: str) -> trimesh.Trimesh:
    solids = {
        "plate": lambda: mesh_of(box(40, 30, 10)),
        "tile": lambda: mesh_of(box(40, 40, 10)),
        "hex": lambda: mesh_of(rod(20, 10, 6)),
        "disc": lambda: mesh_of(rod(20, 10, 128)),
        "l": l_block,
    }
    return solids[kind]()


_surfaces: dict[str, Surface] = {}


def surface(kind: str) -> Surface:
    if kind not in _surfaces:
        _surfaces[kind] = Surface(made(kind))
    return _surfaces[kind]


@pytest.fixture
def judge() -> Judge:
    return Judge(surface)


def thing(part: str = "l", x: float = 0.0, y: float = 0.0, theta: float = 0.0) -> Thing:
    return Thing("a.png", part, True, UPRIGHT, x, y, theta)


def told(of: Thing) -> Answer:
    """The perfect answer."""
    return Answer(of.image, of.part, of.R, of.x_mm, of.y_mm, of.theta_deg, 0.9, (), 0.1, "")


def test_perfect_answers_are_all_right(judge: Judge) -> None:
    things = [thing("l", 10, 20, 30), thing("plate", -40, 0, 200), thing("disc", 50, 50, 1)]
    numbers = figures(judge.judge(things, [told(t) for t in reversed(things)]))
    assert (numbers["right_part"], numbers["right_pose"]) == (1.0, 1.0)
    assert numbers["position_mm"]["worst"] == 0.0
    assert numbers["angle_deg"]["worst"] == pytest.approx(0.0, abs=1e-6)
    assert numbers["angle_deg"]["count"] == 2  # a disc has no angle
    assert numbers["angle_asymmetric_deg"]["count"] == 1  # a plate has two
    assert numbers["tally"] == {"right": 3}


@pytest.mark.parametrize(
    ("part", "fold"), [("l", 1), ("plate", 2), ("tile", 4), ("hex", 6), ("disc", 0)]
)
def test_a_resting_part_has_the_turns_that_its_outline_has(part: str, fold: int) -> None:
    turns = surface(part).turns(UPRIGHT, UPRIGHT)
    assert turns.is_round == (fold == 0)
    assert len(turns.turns_rad) == fold
    if fold:
        even = np.arange(fold) * 2 * np.pi / fold
        assert np.cos(turns.turns_rad - even) == pytest.approx(np.ones(fold), abs=1e-9)


@pytest.mark.parametrize(("part", "turn"), [("plate", 180), ("tile", 270), ("hex", 120)])
def test_a_part_turned_by_its_own_symmetry_is_right(judge: Judge, part: str, turn: float) -> None:
    lies = thing(part, theta=17.0)
    [verdict] = judge.judge([lies], [replace(told(lies), theta_deg=17.0 + turn)])
    assert verdict.kind == "right"
    assert verdict.angle_deg == pytest.approx(0.0, abs=1e-6)


def test_a_part_turned_upside_down_by_its_own_symmetry_is_right(judge: Judge) -> None:
    lies = thing("plate", theta=17.0)
    for axis in "xy":
        flipped = about("z", 60) @ about(axis, 180)
        [verdict] = judge.judge([lies], [replace(told(lies), R=flipped, theta_deg=17.0 - 60 + 1)])
        assert verdict.kind == "right"
        assert verdict.angle_deg == pytest.approx(1.0, abs=0.01)


def test_an_l_upside_down_is_the_right_part_in_the_wrong_pose(judge: Judge) -> None:
    lies = thing("l")
    verdicts = judge.judge([lies], [replace(told(lies), R=about("x", 180))])
    assert verdicts[0].kind == "wrong pose"
    numbers = figures(verdicts)
    assert (numbers["right_part"], numbers["right_pose"]) == (1.0, 0.0)
    assert numbers["position_mm"] is None


def test_a_box_on_another_of_its_sides_is_the_wrong_pose(judge: Judge) -> None:
    lies = thing("plate")
    [verdict] = judge.judge([lies], [replace(told(lies), R=about("x", 90))])
    assert verdict.kind == "wrong pose"


@settings(max_examples=15, deadline=None)
@given(st.floats(-360, 360), st.floats(-360, 360), st.floats(-3, 3))
def test_any_orientation_with_the_side_down_is_judged_with_its_own_theta(
    theta: float, frame: float, off: float
) -> None:
    # Rz(theta) R = Rz(theta - frame) (Rz(frame) R)
    lies = thing("l", theta=theta)
    answer = replace(told(lies), R=about("z", frame), theta_deg=theta - frame + off)
    [verdict] = Judge(surface).judge([lies], [answer])
    assert verdict.kind == "right"
    assert verdict.angle_deg == pytest.approx(abs(off), abs=1e-3)


def test_the_side_down_may_come_from_another_computation(judge: Judge) -> None:
    lies = thing("l", theta=40.0)
    answer = replace(told(lies), R=about("x", 0.3) @ about("z", 25), theta_deg=15.0)
    [verdict] = judge.judge([lies], [answer])
    assert verdict.kind == "right"
    assert verdict.angle_deg == pytest.approx(0.0, abs=0.02)


def test_errors_of_place_and_angle_are_measured(judge: Judge) -> None:
    lies = thing("l", 5, 5, 359.5)
    [verdict] = judge.judge([lies], [replace(told(lies), x_mm=5.3, y_mm=4.6, theta_deg=0.25)])
    assert verdict.position_mm == pytest.approx(0.5)
    assert verdict.angle_deg == pytest.approx(0.75)


def test_no_shift_makes_up_for_an_error_of_place(judge: Judge) -> None:
    lies = thing("tile")
    [verdict] = judge.judge([lies], [replace(told(lies), x_mm=14.0, theta_deg=44.0)])
    assert (verdict.kind, verdict.position_mm) == ("right", pytest.approx(14.0))
    assert verdict.angle_deg == pytest.approx(44.0)


def test_missing_and_made_up_answers_are_counted(judge: Judge) -> None:
    things = [thing("l", 0, 0), thing("plate", 100, 0)]
    made_up = replace(told(thing("tile", -100, 0)), part="tile")
    verdicts = judge.judge(things, [told(things[0]), made_up])
    assert sorted(v.kind for v in verdicts) == ["missed", "right", "spurious"]
    assert figures(verdicts)["right_pose"] == 0.5
    assert confusion(verdicts) == {
        "l": {"l": 1},
        "nothing": {"tile": 1},
        "plate": {"nothing": 1},
    }


def test_an_answer_too_far_away_is_named_but_never_right(judge: Judge) -> None:
    lies = thing("l")
    [verdict] = judge.judge([lies], [replace(told(lies), x_mm=20.0)])
    assert verdict.kind == "wrong part"
    assert verdict.distance_mm == pytest.approx(20.0)
    beyond = judge.judge([lies], [replace(told(lies), x_mm=41.0)])
    assert sorted(v.kind for v in beyond) == ["missed", "spurious"]


def test_one_answer_is_not_counted_for_two_objects(judge: Judge) -> None:
    things = [thing("tile", 0, 0), thing("tile", 12, 0)]
    verdicts = judge.judge(things, [told(things[0])])
    assert sorted(v.kind for v in verdicts) == ["missed", "right"]


def test_pairing_takes_the_least_sum_of_distances() -> None:
    # answer 0 is nearest to object 1, but then object 0 would go without
    things = [thing("tile", 0, 0), thing("tile", 12, 0)]
    answers = [replace(told(things[0]), x_mm=8.0), replace(told(things[0]), x_mm=16.0)]
    assert sorted(pair(things, answers)) == [(0, 0, True), (1, 1, True)]


def test_unknown_is_right_for_a_stranger_and_wrong_for_a_known_part(judge: Judge) -> None:
    stranger = replace(thing("gearbox"), is_known=False)
    known = thing("l", 100, 0)
    blind = [replace(told(t), part=None, R=None) for t in (stranger, known)]
    verdicts = judge.judge([stranger, known], blind)
    numbers = figures(verdicts)
    assert numbers["unknown_called_unknown"] == 1.0
    assert numbers["known_called_unknown"] == 1.0
    assert numbers["right_part"] == 0.0
    assert [row["kind"] for row in failures(verdicts)] == ["called unknown"]


def test_a_stranger_with_a_name_and_one_overlooked_are_failures(judge: Judge) -> None:
    strangers = [replace(thing("gearbox", x), is_known=False) for x in (0, 100)]
    verdicts = judge.judge(strangers, [replace(told(strangers[0]), part="l")])
    assert [row["kind"] for row in failures(verdicts)] == ["named", "overlooked"]
    assert figures(verdicts)["unknown_called_unknown"] == 0.0
    assert figures(verdicts)["right_part"] is None


def test_an_unknown_blob_is_paired_further_away_than_a_named_part(judge: Judge) -> None:
    stranger = replace(thing("gearbox"), is_known=False)
    [verdict] = judge.judge([stranger], [replace(told(stranger), part=None, x_mm=30.0)])
    assert verdict.kind == "refused"


def test_alternatives_are_judged_beside_the_answer_not_instead_of_it(judge: Judge) -> None:
    lies = thing("l")
    flipped = replace(told(lies), R=about("x", 180), alternatives=(Alternative("l", UPRIGHT),))
    other = replace(told(lies), part="tile", alternatives=(Alternative("l", about("x", 180)),))
    for answer, strict, loose in (
        (flipped, "wrong pose", "right"),
        (other, "wrong part", "wrong pose"),
    ):
        [verdict] = judge.judge([lies], [answer])
        assert (verdict.kind, verdict.with_alternatives) == (strict, loose)
    numbers = figures(judge.judge([lies], [flipped]))
    assert numbers["right_pose"] == 0.0
    assert numbers["right_pose_with_alternatives"] == 1.0
    assert numbers["ambiguous_answers"] == 1


def test_what_is_no_orientation_is_a_wrong_pose(judge: Judge) -> None:
    lies = thing("l")
    for R in (None, np.eye(2), np.diag([1.0, 1.0, -1.0]), np.full((3, 3), np.nan)):
        [verdict] = judge.judge([lies], [replace(told(lies), R=R)])
        assert verdict.kind == "wrong pose"


def test_a_mirror_plane_is_no_turn() -> None:
    # both cuts leave the plane x = 0 a mirror; no axis takes the body into itself
    cut = (
        box(40, 30, 10)
        - box(20, 10, 40).translate((0, 15, 0))
        - box(50, 8, 6).translate((0, -13, 4))
    )
    faced = Surface(mesh_of(cut))
    assert len(faced.turns(UPRIGHT, UPRIGHT).turns_rad) == 1
    assert not any(faced.turns(UPRIGHT, about(axis, 180)).exist for axis in "xy")


def test_a_small_hole_off_the_middle_breaks_the_symmetry() -> None:
    drilled = Surface(mesh_of(box(40, 40, 10) - rod(2, 40).translate((14, 3, 0))))
    assert len(drilled.turns(UPRIGHT, UPRIGHT).turns_rad) == 1


def test_distances_from_a_box_are_those_on_paper() -> None:
    plate = surface("plate")  # 40 x 30 x 10 round the origin
    points = np.array([[20, 0, 0], [25, 0, 0], [0, 0, 8], [23, 19, 0], [0, 0, 0], [12, -15.5, 3]])
    assert plate.distances_mm(points) == pytest.approx([0, 5, 3, 5, 5, 0.5], abs=1e-9)


def test_scores_are_compared_with_how_often_they_are_right(judge: Judge) -> None:
    things = [thing("l", 100.0 * k) for k in range(10)]
    answers = [replace(told(t), score=0.85) for t in things]
    wrong = [replace(a, part="tile") if k < 3 else a for k, a in enumerate(answers)]
    found = reliability(judge.judge(things, wrong))
    assert found["expected_error"] == pytest.approx(0.85 - 0.7)
    assert [(b["answers"], b["right"]) for b in found["bins"]] == [(10, pytest.approx(0.7))]


def test_lines_and_truth_are_read_as_the_files_have_them() -> None:
    line = {
        "image": "a.png",
        "part": "l",
        "stable_pose_R": np.eye(3).tolist(),
        "x_mm": 1.0,
        "y_mm": 2.0,
        "theta_deg": 3.0,
        "score": 0.5,
        "ambiguous_with": [{"part": "l", "pose_index": 4}, {"part": "tile"}],
        "seconds": 0.04,
    }
    answer = read_answer(line, lambda part, index: about("x", 45.0 * index))
    assert (answer.x_mm, answer.y_mm, answer.theta_deg) == (1.0, 2.0, 3.0)
    assert np.allclose(answer.alternatives[0].R, about("x", 180))
    assert answer.alternatives[1].R is None
    refused = read_answer(line | {"part": None, "stable_pose_R": None, "theta_deg": None})
    assert refused.part is None
    assert refused.R is None
    entry = {"part": "l", "known": True, "stable_pose_R": np.eye(3).tolist()}
    entry |= {"x_mm": 1.0, "y_mm": 2.0, "theta_deg": 3.0}
    [lies] = read_things({"images": [{"image": "a.png", "objects": [entry]}]})
    assert (lies.image, lies.part, lies.is_known, lies.theta_deg) == ("a.png", "l", True, 3.0)


def printing(text: str, code: int) -> list[str]:
    return [sys.executable, "-S", "-c", f"print({text!r}); raise SystemExit({code})"]


def test_a_run_keeps_the_answers_and_says_why_it_stopped() -> None:
    text = 'loading\n{"image": "a.png"}\n{"image": "b.png"}\n{"image": "b.png"}\n[1]'
    good = run(printing(text, 1), one_core=True)  # 1: a picture shows nothing known
    assert [line["image"] for line in good.lines] == ["a.png", "b.png", "b.png"]
    assert good.error == ""
    assert good.peak_mb > 1
    assert run(printing(text, 2), one_core=False).error.startswith("exit 2")


def test_the_small_camera_sees_points_where_the_small_pictures_have_them(tmp_path: Path) -> None:
    body = {"size_px": [1280, 1024], "K": [[3470.0, 0, 634.2], [0, 3474.0, 511.8], [0, 0, 1]]}
    large, small = tmp_path / "hi.json", tmp_path / "lo.json"
    large.write_text(json.dumps(body))
    smaller(large, "", small)
    ray = np.array([0.05, -0.03, 1.0])
    u, v, _ = np.array(body["K"]) @ ray
    # a small pixel covers 5 x 4 large ones; pixel 0's centre is at 0 in both
    expected = [(u + 0.5) / 5 - 0.5, (v + 0.5) / 4 - 0.5, 1.0]
    assert np.array(json.loads(small.read_text())["K"]) @ ray == pytest.approx(expected)


@pytest.mark.slow
def test_the_true_answers_to_the_stored_pictures_are_all_right() -> None:
    things = read_things(true_pictures())
    surfaces: dict[str, Surface] = {}

    def of_others(name: str) -> Surface:
        if name not in surfaces:
            surfaces[name] = Surface(trimesh.load(part_file(f"{name}.stl")))
        return surfaces[name]

    answers = [replace(told(t), part=t.part if t.is_known else None) for t in things]
    numbers = figures(Judge(of_others).judge(things, answers))
    assert set(numbers["tally"]) == {"right", "refused"}
    assert numbers["angle_deg"]["worst"] == pytest.approx(0.0, abs=1e-4)
