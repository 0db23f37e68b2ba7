"""`cellctl check` names every stable pose, what becomes of it, and how many landings are served."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh
from planning_cells import LAYOUT

from controller.cad import StablePose, make_solid, sample_surface, stable_poses
from controller.cell.compute.checks import Checked, CheckedPose
from controller.cli.app import main
from controller.cli.planning import recipe_check
from controller.planning import OnTable, PlanOptions, plan_from, prepare_part, resting_pose

CELL = Path(__file__).resolve().parents[2] / "recipes" / "cells" / "emulated.yaml"

PIN = """\
unit: mm
tolerance_mm: 0.02
part:
  union:
    - cylinder: {radius: 7, height: 36}
      move: [0, 0, 18]
    - cylinder: {radius: 13, height: 10}
      move: [0, 0, 36]
"""


def pose(index: int, probability: float, *, rolling: bool = False) -> StablePose:
    return StablePose(index, np.eye(3), probability, 10.0, 5.0, rolling)


class _Planned:
    """A certified pose, as far as `is_served` asks of it."""

    def __init__(self, is_served: bool) -> None:
        self.certificate = self
        self.plan = "a plan" if is_served else None


def checked(*shares: tuple[float, bool]) -> Checked:
    poses = tuple(
        CheckedPose(pose(k, share), _Planned(is_served))  # type: ignore[arg-type]
        for k, (share, is_served) in enumerate(shares)
    )
    return Checked(None, poses, ())  # type: ignore[arg-type]


def test_a_part_that_mostly_lands_as_no_plan_can_serve_it_is_not_ready() -> None:
    (sentence,) = recipe_check._unserved(checked((0.9, False), (0.08, True)))
    assert sentence.startswith(
        "8% of dropped parts rest in a pose with a plan; feed the part so that it rests in pose 1"
    )
    assert recipe_check._unserved(checked((0.4, False), (0.6, True))) == []


def test_a_pose_without_a_plan_has_a_reason_and_a_rare_one_is_named() -> None:
    assert checked((0.5, True), (0.3, True)).served_fraction == pytest.approx(0.8)
    later = Checked(None, (), (), met_later=(pose(3, 0.01),))  # type: ignore[arg-type]
    (landing,) = recipe_check._landings(later)
    assert (landing.outcome, landing.words) == (
        "planned when met",
        "rare; planned when a part rests that way",
    )


def test_a_part_without_flat_faces_gets_a_plan() -> None:
    ring = trimesh.creation.torus(major_radius=15.0, minor_radius=7.0)
    solid = make_solid(ring, "ring", "5eed" * 16, where="ring")
    assert not any(face.kind == "plane" for face in solid.faces)
    options = PlanOptions(
        direction_count=60, arm_grasps_per_pose=4, arm_grasps_round=6, fixed_grasps=4
    )
    part = prepare_part(solid, sample_surface(solid, 3.0), LAYOUT, options)
    lying = stable_poses(solid)[0]
    start = OnTable(lying.index, resting_pose(solid, lying, 350.0, 0.0, 0.3))
    assert plan_from(part, LAYOUT, start).covered_fraction > 0.5


@pytest.mark.slow
def test_a_pin_that_rolls_in_most_landings_is_named_with_its_share_and_planned(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "pin.csg.yaml").write_text(PIN)
    recipe = tmp_path / "pin.yaml"
    recipe.write_text("name: pin\npart: pin.csg.yaml\ncell: emulated.yaml\n")
    shutil.copy(CELL, tmp_path / "emulated.yaml")
    assert main(["check", str(recipe)]) == 0
    said = capsys.readouterr()
    assert re.search(r"^pose 0 \(\d\d%\): rolls all round on a \w+ of \d+ strips; ", said.out, re.M)
    assert re.search(r"pin.yaml: ready for \d+% of landings", said.out, re.M)
    assert main(["check", "--json", str(recipe)]) == 0
    body = json.loads(capsys.readouterr().out)
    assert sum(one["probability"] for one in body["landings"]) == pytest.approx(1.0, abs=0.03)
    assert body["landings"][0]["rolling"]
    assert body["served_fraction"] > 0.5
