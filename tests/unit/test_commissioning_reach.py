"""What the calibrated arm gets to, by places and by recipes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from planning_cell import emulated_layout

from controller.bring_up.evidence import StepEvidence
from controller.bring_up.procedure import worst_of
from controller.bring_up.proof import ReachedPose, RecipeReach, check_reach
from controller.bring_up.steps.reach import judge
from controller.calibration.reach import rows_down, unreached
from controller.cli.bring_up.guided import recipes_beside
from controller.config import EMULATED_CELL, SHIPPED
from controller.planning.geometry import Box
from controller.planning.motion import Scene, tcp_pose

LAYOUT = emulated_layout()
RECIPES = Path(SHIPPED)


def scene(layout: Any = LAYOUT) -> Scene:
    return Scene(layout, layout.arm_gripper.max_mm, layout.fixed_open_mm)


def test_fingers_point_down_along_the_column_however_it_leans() -> None:
    c, s = np.cos(0.01), np.sin(0.01)
    T = np.array([[1, 0, 0, 1.0], [0, c, -s, 2.0], [0, s, c, 0.0], [0, 0, 0, 1]])
    leaning = replace(LAYOUT, T_world_arm=T)
    place = np.array([360.0, 20.0, 30.0])
    rows = rows_down(leaning, place)
    assert len(rows) > 20
    for pose in tcp_pose(leaning, rows):
        np.testing.assert_allclose(pose[:3, 3], place, atol=1e-6)
        np.testing.assert_allclose(pose[:3, 0], -T[:3, 2], atol=1e-6)


def test_places_are_named_with_what_keeps_the_arm_from_them() -> None:
    places = {
        "middle": np.array([360.0, 0.0, 20.0]),
        "far": np.array([620.0, 0.0, 20.0]),  # the wrist gets to 2 x 253.5 mm
    }
    (far,) = unreached(LAYOUT, scene(), places, 0.5)
    assert (far.name, far.why) == ("far", "beyond the reach or the limits of the joints")


def test_a_place_in_something_that_stands_is_not_reached() -> None:
    crate = Box.from_bounds(300, 420, -60, 60, 0, 150)
    full = replace(LAYOUT, obstacles={**LAYOUT.obstacles, "big_crate": crate})
    (one,) = unreached(full, scene(full), {"middle": np.array([360.0, 0.0, 20.0])}, 0.5)
    assert "in contact with big crate" in one.why


def test_a_place_nearer_to_the_limits_than_is_uncertain_is_not_reached() -> None:
    place = {"edge": np.array([506.0, 0.0, 20.0])}  # a millimetre within reach
    assert unreached(LAYOUT, scene(), place, 0.5) == ()
    (one,) = unreached(LAYOUT, scene(), place, 2.0)
    assert "within 2.0 mm (k = 2) of the limits" in one.why


@pytest.mark.parametrize(
    ("pickable", "covered", "problems", "bad"),
    [(0.9, 0.7, (), 0), (0.3, 0.7, (), 1), (0.9, None, ("no grasp",), 1)],
)
def test_a_recipe_is_held_to_what_it_requires(
    tmp_path: Path, pickable: float, covered: float | None, problems: tuple[str, ...], bad: int
) -> None:
    evidence = StepEvidence(tmp_path, lambda text: None)
    bench: Any = SimpleNamespace(evidence=evidence)
    found = RecipeReach((ReachedPose(2, 0.6, pickable, covered),), problems)
    judge(bench, Path("part.yaml"), found)
    assert len(worst_of(evidence.figures)) == bad
    assert evidence.findings == [f"part.yaml: {one}" for one in problems]


def test_a_recipe_that_cannot_be_read_is_a_reason(tmp_path: Path) -> None:
    recipe = tmp_path / "part.yaml"
    recipe.write_text("name: part\n")
    found = check_reach(recipe, EMULATED_CELL)
    assert found.poses == ()
    assert "part.yaml" in found.problems[0]


def test_recipes_beside_the_cell_file_are_found_and_nothing_else(tmp_path: Path) -> None:
    assert recipes_beside(EMULATED_CELL) == ()  # in that folder are cell files only
    names = [path.name for path in recipes_beside(RECIPES / "cell.yaml")]
    assert "holder.yaml" in names
