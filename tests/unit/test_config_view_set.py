"""SET.json: what is read, and what is wrong with a wrong one, by file and key."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import view_sets
from shown_part import hand, moved, part, shown

from controller.cad import sample_surface
from controller.config import ConfigError
from controller.config.view_set import load_view_set
from controller.inspection import InspectionLimits
from controller.stored.view_set import build_pose, build_view_set

Tree = dict[str, Any]


def saved(folder: Path, tree: Any) -> Path:
    path = folder / "SET.json"
    path.write_text(tree if isinstance(tree, str) else json.dumps(tree), encoding="utf-8")
    return path


def test_files_are_named_from_where_the_set_lies(tmp_path: Path) -> None:
    file = load_view_set(saved(tmp_path, view_sets.tree()))
    assert file.part == tmp_path / "shown.stl"
    assert file.views[1].pictures["ring"] == tmp_path / "v01_ring.png"


def put(*keys: Any, value: Any) -> Callable[[Tree], None]:
    def change(tree: Tree) -> None:
        section: Any = tree
        for key in keys[:-1]:
            section = section[key]
        section[keys[-1]] = value

    return change


def drop(*keys: Any) -> Callable[[Tree], None]:
    def change(tree: Tree) -> None:
        section: Any = tree
        for key in keys[:-1]:
            section = section[key]
        del section[keys[-1]]

    return change


MIRROR = [[-1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1]]
SHEARED = [[1.0, 0.01, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1]]
OPEN_ENDED = [[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, 0], [0, 0, 1, 1]]
WRONG: dict[str, tuple[Callable[[Tree], None], str, str]] = {
    "another form": (put("schema", value="cellctl.views/2"), "schema", "cellctl.views/1"),
    "key misspelt": (put("views", 0, "prior_m", value=1.5), "views.0.prior_m", "`prior_mm`"),
    "no part": (drop("part"), "part", "missing"),
    "part is a number": (put("part", value=3), "part", "name of a file"),
    "no calibration": (drop("camera"), "camera", "missing"),
    "no camera matrix": (drop("camera", "K"), "camera.K", "missing"),
    "no pose of the camera": (drop("camera", "T_world_cam"), "camera.T_world_cam", "missing"),
    "K of two rows": (put("camera", "K", value=[[1, 0, 0], [0, 1, 0]]), "camera.K", "3 rows of 3"),
    "K with words": (put("camera", "K", 1, 1, value="f"), "camera.K", "3 rows of 3 numbers"),
    "K with skew": (put("camera", "K", 0, 1, value=2.0), "camera.K", "[[fx, 0, cx]"),
    "no focal length": (put("camera", "K", 0, 0, value=0), "camera.K", "above 0"),
    "four of distortion": (put("camera", "distortion", value=[0, 0, 0, 0]), "distortion", "few"),
    "picture of no size": (put("camera", "size_px", value=[0, 512]), "size_px", "16"),
    "pose of a mirror": (put("views", 1, "T_world_part", value=MIRROR), "T_world_part", "mirror"),
    "sheared pose": (put("camera", "T_world_cam", value=SHEARED), "T_world_cam", "off by 0.01"),
    "pose of three rows": (
        put("views", 0, "T_world_part", value=MIRROR[:3]), "T_world_part", "4 rows of 4",
    ),
    "last row of a pose": (
        put("views", 0, "gripper_boxes", 0, "T", value=OPEN_ENDED), "gripper_boxes.0.T", "last row",
    ),
    "box without size": (
        put("views", 0, "gripper_boxes", 0, "half_mm", value=[1, 0, 1]), "half_mm",
        "greater than 0",
    ),
    "prior of zero": (put("views", 2, "prior_deg", value=0), "views.2.prior_deg", "greater than 0"),
    "one name twice": (put("views", 2, "id", value="v00"), "views.2.id", "views.0"),
    "lamp unknown": (
        put("views", 0, "pictures", "top", value="a.png"), "views.0.pictures.top",
        "backlight, ring, side",
    ),
    "no picture before the panel": (
        drop("views", 1, "pictures", "backlight"), "views.1.pictures", "kind panel",
    ),
    "kind of lamp unknown": (put("lamps", "side", "kind", value="arc"), "lamps.side.kind", "ring"),
    "ring without radius": (drop("lamps", "ring", "radius"), "lamps.ring.radius", "radius"),
    "panel without size": (drop("lamps", "backlight", "size"), "lamps.backlight", "size"),
    "views is a name": (put("views", value="v00"), "views", "list"),
    "yes for a number": (put("views", 0, "prior_mm", value=True), "prior_mm", "true and false"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_set_is_refused_by_file_and_key(tmp_path: Path, name: str) -> None:
    change, key, words = WRONG[name]
    tree = view_sets.tree()
    change(tree)
    path = saved(tmp_path, tree)
    with pytest.raises(ConfigError) as refused:
        load_view_set(path)
    said = str(refused.value)
    assert said.startswith(str(path))
    assert key in said
    assert words in said


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("[]", "no JSON object"),
        ('{"schema": "cellctl.views/1", "schema": "x"}', "stands twice"),
        ('{"schema": ', "not valid JSON"),
        ("[" * 100_000, "not valid JSON"),
        ('{"schema": "cellctl.views/1", "part": NaN}', "nan is no number of sense"),
        ('{"schema": "cellctl.views/1", "part": 1e999}', "part"),
        ("schema: cellctl.views/1", "not valid JSON"),
    ],
)
def test_a_text_that_is_no_set_is_refused(tmp_path: Path, text: str, words: str) -> None:
    path = saved(tmp_path, text)
    with pytest.raises(ConfigError, match=words):
        load_view_set(path)


@pytest.mark.parametrize("number", ["NaN", "Infinity", "1e400", "-1e12"])
def test_a_pose_with_what_is_no_place_is_refused(tmp_path: Path, number: str) -> None:
    tree = view_sets.tree()
    tree["views"][0]["T_world_part"][0][3] = "HERE"
    with pytest.raises(ConfigError, match=r"SET\.json"):
        load_view_set(saved(tmp_path, json.dumps(tree).replace('"HERE"', number)))


def test_a_pose_is_taken_as_it_stands_and_a_rounded_one_made_rigid() -> None:
    T = shown(20, 12, 5)
    exact = tuple(map(tuple, T.tolist()))
    assert np.array_equal(build_pose(exact), T)
    rounded = build_pose(tuple(map(tuple, np.round(T, 4).tolist())))
    assert np.abs(rounded[:3, :3].T @ rounded[:3, :3] - np.eye(3)).max() < 1e-12
    assert np.abs(rounded - T).max() < 1e-4


def grasps_of(tmp_path: Path, tree: Tree) -> list[int]:
    file = load_view_set(saved(tmp_path, tree))
    blank = {v.id: dict.fromkeys(v.pictures, np.zeros((512, 640), np.uint8)) for v in file.views}

    class Part:
        solid = part().solid
        samples = sample_surface(part().solid, 5.0)

    views = build_view_set(file, Part(), blank, InspectionLimits())  # type: ignore[arg-type]  # all of a part that is read
    return [view.grasp for view in views.views]


def test_views_whose_gripper_stands_alike_to_the_part_share_a_grasp(tmp_path: Path) -> None:
    tree = view_sets.tree()
    T = shown(-25, -8, 10)
    # the arm repeats to a tenth of a millimetre and a tenth of a degree
    tree["views"][1]["T_world_part"] = view_sets.rows(
        moved(shown(20, 12, 5), (0.1, -0.1, 0.05), 0.1)
    )
    # the same pose of the part, and the gripper 8 mm further along it
    tree["views"][2] = view_sets.view("v02", T, hand(moved(T, (8.0, 0, 0), 0.0)))
    assert grasps_of(tmp_path, tree) == [0, 0, 1]


def test_the_set_may_number_its_grasps(tmp_path: Path) -> None:
    tree = view_sets.tree()
    tree["views"][0]["grasp"] = 4
    assert grasps_of(tmp_path, tree) == [4, 5, 5]


def test_views_without_boxes_are_of_one_grasp(tmp_path: Path) -> None:
    tree = view_sets.tree()
    for view in tree["views"]:
        view["gripper_boxes"] = []
    assert grasps_of(tmp_path, tree) == [0, 0, 0]


def test_the_worked_example_of_the_documents_is_a_set(tmp_path: Path) -> None:
    page = Path(__file__).parents[2] / "docs" / "inspect.md"
    _, _, begin = page.read_text(encoding="utf-8").partition("```json\n")
    file = load_view_set(saved(tmp_path, begin.partition("```")[0]))
    assert [view.id for view in file.views] == ["v00"]
    assert file.panel_of(file.views[0]) == "backlight"
