"""One recipe, one plan: every command that plans uses the recipe's figures."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cad_solids import box, mesh_of, rod

from controller.cache import digest_of
from controller.cad.compiled import load_part
from controller.cell import compute
from controller.cell.compute import answers, context
from controller.cell.compute.checks import Checked, check_job
from controller.cell.control import socket_path
from controller.cell.lock import LOCK_NAME, read_holder
from controller.cell.plans import PlanCache
from controller.cli import main
from controller.cli.planning.plan_json import certificate_json, plan_json
from controller.cli.running import recipe_run
from controller.cli.terminal import progress
from controller.config import ConfigError, load_cell, load_recipe
from controller.inspection.lit import MIN_WIDTH_PX
from controller.planning import GraspRules, OnTable, PlanOptions, resting_pose
from controller.setup import planner as figures_module
from controller.setup.drivers import require_force
from controller.setup.planner import planner_setup

ROOT = Path(__file__).parents[2]
CELL = ROOT / "recipes/cells/emulated.yaml"
FEW = PlanOptions(
    arm_grasps_per_pose=3,
    arm_grasps_round=4,
    fixed_grasps=4,
    direction_count=30,
    rules=GraspRules().coarse(),
)
RECIPE = """
name: {name}
part: {name}.stl
unit: mm
density_g_cm3: {density}
inspection: {{max_incidence_deg: 65, min_coverage: 0.5, smallest_defect_mm: 2.5, least_gain: 0.01}}
grasp: {{force_n: 30, width_tolerance_mm: 0.5}}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recipes")
    mesh_of(box(50, 30, 20) - rod(5, 40, 32)).export(folder / "block.stl")
    mesh_of(box(120, 120, 30)).export(folder / "slab.stl")
    (folder / "block.yaml").write_text(RECIPE.format(name="block", density=7.85))
    return folder


@pytest.fixture(autouse=True)
def _coarse(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figures_module, "PlanOptions", lambda: FEW)
    monkeypatch.setattr(progress, "QUIET_S", 3600.0)  # a busy machine takes longer, and reports it
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))


def told(words: list[str], capsys: pytest.CaptureFixture[str], code: int = 0) -> dict[str, Any]:
    assert main([*words, "--cell", str(CELL), "--json"]) == code
    body = json.loads(capsys.readouterr().out)
    assert isinstance(body, dict)
    return body


def without_clock(body: dict[str, Any]) -> str:
    return json.dumps({k: v for k, v in body.items() if k not in {"seconds", "from_cache"}})


def test_all_figures_of_a_recipe_reach_the_planner(folder: Path) -> None:
    recipe, cell = load_recipe(folder / "block.yaml"), load_cell(CELL)
    part = load_part(recipe.part)
    setup = planner_setup(recipe, cell, part)
    options, layout = setup.options, setup.layout
    assert options.rules.density_kg_mm3 == pytest.approx(7.85e-6)
    assert (options.max_incidence_deg, options.least_gain) == (65.0, 0.01)
    # what is planned to be shown must be compared: a defect of 2.5 mm spans what inspection needs
    spans_px = 2.5 * np.array(options.min_px_per_mm)
    assert ((spans_px > MIN_WIDTH_PX) & (spans_px < 1.3 * MIN_WIDTH_PX)).all()
    assert options.opening_tolerance_mm == 0.5
    assert layout.fixed_gripper is not None
    assert (layout.arm_gripper.force_n, layout.fixed_gripper.force_n) == (30.0, 30.0)
    assert setup.mass_g == pytest.approx(part.solid.volume_mm3 * 7.85e-3)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("density_g_cm3: 7.85", "density_g_cm3: 7.8"),
        ("max_incidence_deg: 65", "max_incidence_deg: 64"),
        ("smallest_defect_mm: 2.5", "smallest_defect_mm: 2.4"),
        ("least_gain: 0.01", "least_gain: 0.02"),
        ("force_n: 30", "force_n: 31"),
        ("width_tolerance_mm: 0.5", "width_tolerance_mm: 0.6"),
        ("grasp: {", "grasp: {friction: 0.3, "),
    ],
)
def test_each_figure_is_in_the_key_of_kept_plans(key: str, value: str, folder: Path) -> None:
    text = (folder / "block.yaml").read_text()
    assert key in text
    other = folder / "other.yaml"
    other.write_text(text.replace(key, value))
    cell = load_cell(CELL)
    keys = set()
    for path in (folder / "block.yaml", other):
        recipe = load_recipe(path)
        setup = planner_setup(recipe, cell, load_part(recipe.part))
        keys.add(digest_of(setup.layout, setup.options))
    assert len(keys) == 2


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("fingers:  {length_mm: 78,", "fingers:  {friction: 0.5, length_mm: 78,"),
        ("fingers:  {length_mm: 78,", "fingers:  {compliance_mm: 0.2, length_mm: 78,"),
        ("fingers:  {length_mm: 64,", "fingers:  {friction: 0.5, length_mm: 64,"),
        ("fingers:  {length_mm: 64, width_mm: 22", "fingers:  {length_mm: 64, width_mm: 20"),
        ("jaw_max_mm: 85.0\n  park", "jaw_max_mm: 85.0\n  jaws: {force_n: 25}\n  park"),
        ("jaw_max_mm: 85.0\n  park", "jaw_max_mm: 85.0\n  jaws: {grasp_s: 2}\n  park"),
        ("jaw_max_mm: 85.0\n  body", "jaw_max_mm: 85.0\n  jaws: {force_n: 25}\n  body"),
        ("jaw_max_mm: 85.0\n  body", "jaw_max_mm: 85.0\n  jaws: {open_s: 2}\n  body"),
    ],
)
def test_force_pace_and_pads_of_a_cell_file_are_in_the_key(
    key: str, value: str, folder: Path, tmp_path: Path
) -> None:
    text = CELL.read_text()
    assert text.count(key) == 1
    other = tmp_path / "cell.yaml"
    other.write_text(text.replace(key, value))
    recipe = load_recipe(folder / "block.yaml")
    part = load_part(recipe.part)
    setups = [planner_setup(recipe, load_cell(path), part) for path in (CELL, other)]
    assert len({digest_of(s.layout, s.options) for s in setups}) == 2
    is_pace = "_s:" in value
    assert (setups[0].as_json() == setups[1].as_json()) is is_pace  # which forecasts alone show


def test_the_cell_and_the_recipe_each_limit_what_grippers_do(folder: Path, tmp_path: Path) -> None:
    cell = tmp_path / "cell.yaml"
    text = CELL.read_text().replace("pad_length_mm: 24}", "pad_length_mm: 24, friction: 0.5}")
    text = text.replace(
        "jaw_max_mm: 85.0\n  park", "jaw_max_mm: 85.0\n  jaws: {force_n: 70}\n  park"
    )
    text = text.replace(
        "jaw_max_mm: 85.0\n  body", "jaw_max_mm: 85.0\n  jaws: {force_n: 50}\n  body"
    )
    cell.write_text(text)
    recipe = load_recipe(folder / "block.yaml")
    part = load_part(recipe.part)

    def figures(**grasp: float) -> dict[str, Any]:
        own = recipe.model_copy(update={"grasp": recipe.grasp.model_copy(update=grasp)})
        return planner_setup(own, load_cell(cell), part).as_json()

    gentle, firm, oily = figures(), figures(force_n=60.0), figures(friction=0.2)
    assert (gentle["arm_gripper_n"], gentle["fixed_gripper_n"]) == (30.0, 30.0)
    assert (firm["arm_gripper_n"], firm["fixed_gripper_n"]) == (60.0, 50.0)
    assert [firm[key]["friction"] for key in ("arm_pads", "fixed_pads")] == [0.5, 0.6]
    assert [oily[key]["friction"] for key in ("arm_pads", "fixed_pads")] == [0.2, 0.2]
    firmer = tmp_path / "firm.yaml"
    firmer.write_text((folder / "block.yaml").read_text().replace("force_n: 30", "force_n: 60"))
    with pytest.raises(ConfigError, match=r"firm.yaml:7: `grasp.force_n`: 60 N.* 50 N at the most"):
        require_force(firmer, 60.0, load_cell(cell))
    require_force(firmer, 50.0, load_cell(cell))


def test_no_more_is_counted_on_of_the_arm_than_is_known(folder: Path) -> None:
    path = folder / "firm.yaml"
    path.write_text((folder / "block.yaml").read_text().replace("force_n: 30", "force_n: 150"))
    recipe = load_recipe(path)
    layout = planner_setup(recipe, load_cell(CELL), load_part(recipe.part)).layout
    assert layout.fixed_gripper is not None
    assert (layout.arm_gripper.force_n, layout.fixed_gripper.force_n) == (40.0, 150.0)


def test_plan_check_compile_and_run_agree_to_the_byte(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = folder / "block.yaml"
    planned = told(["plan", "--recipe", str(path)], capsys)
    checked = told(["check", str(path)], capsys)
    compiled = told(["compile", "--recipe", str(path)], capsys)
    likely = {c["pose"] for c in checked["certificates"]}
    assert likely
    assert [c for c in planned["certificates"] if c["pose"] in likely] == checked["certificates"]
    assert planned["certificates"] == compiled["certificates"]
    views = {c["pose"]: c["views"] for c in checked["certificates"]}
    assert {pose["pose_index"]: pose["views"] for pose in checked["poses"]} == views
    assert planned["planned_with"] == checked["planned_with"] == compiled["planned_with"]
    # what a run plans with, for the same part at the same place
    job = compute.Job(path, CELL)
    c = compute.context(job)
    T = resting_pose(c.solid, c.poses[planned["pose"]], planned["x_mm"], planned["y_mm"], 0.0)
    plan = answers.plan(job, OnTable(planned["pose"], T), None, frozenset(), ())
    body = plan_json(c.solid, c.samples, c.layout, plan, c.not_inspected)
    assert json.dumps(body) == json.dumps({key: planned[key] for key in body})
    certificates = [
        certificate_json(p.certified.certificate, c.setup) for p in check_job(job).poses
    ]
    assert certificates == checked["certificates"]
    # and once more without any cache
    anew = told(["plan", "--recipe", str(path), "--no-cache"], capsys)
    assert without_clock(anew) == without_clock(planned)


def test_a_run_that_is_still_planned_has_the_cell_and_is_named(
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ["run", str(folder / "block.yaml"), "--cell", str(CELL), "--runs", str(tmp_path)]
    holders = []

    def looked_at(job: Any, *_: object) -> Any:
        holders.append(read_holder(tmp_path / LOCK_NAME))
        assert main(words) != 0  # another one meanwhile
        return Checked(context(job).setup, (), ("no plan, for the test",))

    monkeypatch.setattr(recipe_run, "check_plans", looked_at)
    assert main(words) == 1
    (holder,) = holders
    assert holder is not None
    assert (holder.pid, holder.run.endswith("-block")) == (os.getpid(), True)
    assert holder.control == str(socket_path(tmp_path))
    said = capsys.readouterr().err
    assert f"the cell is busy: {holder} has it" in said
    assert "no plan, for the test" in said
    assert read_holder(tmp_path / LOCK_NAME) is None
    assert not (tmp_path / holder.run).exists()


def test_a_part_too_heavy_in_steel_is_refused_by_all_for_the_same_reason(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    light, heavy = folder / "slab_light.yaml", folder / "slab.yaml"
    firm = RECIPE.replace("force_n: 30", "force_n: 60").replace("defect_mm: 2.5", "defect_mm: 6")
    light.write_text(firm.format(name="slab", density=1.0))
    heavy.write_text(firm.format(name="slab", density=7.85))
    reasons = set()
    for words in (["check", str(heavy)], ["plan", "--recipe", str(heavy)]):
        body = told(words, capsys, code=1)
        reasons |= {c["reason"] for c in body["certificates"]}
    body = told(["compile", "--recipe", str(heavy)], capsys)
    reasons |= {c["reason"] for c in body["certificates"]}
    words = ["compile", str(folder / "slab.stl"), "--density", "7.85"]
    reasons |= {c["reason"] for c in told(words, capsys)["certificates"]}
    assert main(["plan", "--site", "--recipe", str(heavy), "--cell", str(CELL)]) == 1
    reasons.add(capsys.readouterr().err.strip().removeprefix("cellctl: "))
    assert main(["run", str(heavy), "--cell", str(CELL), "--runs", str(folder / "runs")]) == 1
    said = capsys.readouterr().err
    assert len(reasons) == 1
    (reason,) = reasons
    assert "3.39 kg" in reason
    assert "friction limit" in reason
    assert reason in said
    # nothing but the lock, by which others saw that a run was being prepared
    assert [path.name for path in (folder / "runs").iterdir()] == [LOCK_NAME]
    body = told(["compile", "--recipe", str(light)], capsys)  # in foam some poses have a plan
    assert any(c["planned"] for c in body["certificates"])


def test_a_certificate_names_the_density_up_to_which_its_grasps_hold(folder: Path) -> None:
    recipe, cell = load_recipe(folder / "block.yaml"), load_cell(CELL)
    part = load_part(recipe.part)
    setup = planner_setup(recipe, cell, part)
    planning = PlanCache(part, setup.layout, setup.options)
    certificate = next(c for c in (planning.certified(p).certificate for p in part.poses) if c.plan)
    plan = certificate.plan
    assert plan is not None
    body = certificate_json(certificate, setup)
    assert (body["density_g_cm3"], body["density_from"]) == (7.85, "recipe")
    heaviest = body["heaviest_g_cm3"]
    # heavier than it is, and no heavier than what slips without any lever: W = 2 mu N, half of it
    # allowed, of the block's 50 x 30 x 20 mm less a bore of 10 mm
    volume_cm3 = part.solid.volume_mm3 / 1000
    slips_g_cm3 = 0.5 * 2 * 0.6 * 30.0 / 9.81 * 1000 / volume_cm3
    assert 7.85 < heaviest <= slips_g_cm3
    # what weight uses is in proportion to it: the most loaded grasp is just allowed
    assert max(grasp.load for grasp in plan.grasps) * heaviest / 7.85 == pytest.approx(0.5)


def test_faces_that_the_recipe_leaves_out_are_named_in_the_plan(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, other = (folder / "block.yaml").read_text(), folder / "gauged.yaml"
    other.write_text(text.replace("least_gain", "not_inspected: {F0: gauged by hand}, least_gain"))
    planned = told(["plan", "--recipe", str(other)], capsys)
    assert planned["not_inspected"] == {"0": "gauged by hand"}
    for piece in planned["unseen"]:
        assert piece["not_inspected"] == ("gauged by hand" if piece["face"] == 0 else None)
    other.write_text(text.replace("least_gain", "not_inspected: {F99: gauged by hand}, least_gain"))
    refused = []
    for words in (["plan", "--recipe"], ["check"]):
        assert main([*words, str(other), "--cell", str(CELL)]) == 2
        refused.append(capsys.readouterr().err)
    assert "no face 'F99' on the part" in refused[0]
    assert refused[0] == refused[1]


@pytest.mark.slow
def test_without_a_recipe_what_is_assumed_is_said(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["plan", str(folder / "block.stl"), "--cell", str(CELL), "--pose", "0"]
    assert main(words) == 0
    assert "2.7 g/cm3 (aluminium, assumed)" in capsys.readouterr().out
    figures = told([*words[:2], "--pose", "0"], capsys)["planned_with"]
    assert (figures["density_g_cm3"], figures["density_from"]) == (2.7, "assumed")
    assert figures["from_recipe"] is False
    words = ["compile", str(folder / "block.stl"), "--cell", str(CELL)]
    assert main(words) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "2.7 g/cm3 (aluminium, assumed)" in printed
    assert re.search(r"held up to \d+\.\d g/cm3, the density is assumed", printed)


def test_what_is_in_sight_is_not_called_inspected(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = str(folder / "block.yaml")
    assert main(["check", path, "--cell", str(CELL)]) == 0
    checked = capsys.readouterr().out
    assert re.search(r"% \(± \d+\.\d%\) of the surface in sight, ", checked)
    assert "1 regrasps" not in checked
    (told,) = re.findall(r"^forecast from pose \d+: (.*) in sight$", checked, re.MULTILINE)
    compared, seen = map(float, re.findall(r"(\d+\.\d)%", told))
    assert 0 < compared < seen <= 100
    assert re.search(
        r"ready for \d+% of landings \(the pictures decide how much can be compared\)\n$", checked
    )
    assert main(["plan", "--recipe", path, "--cell", str(CELL)]) == 0
    planned = capsys.readouterr().out
    assert re.search(r"%\) of the surface in sight; at most \d+\.\d% is possible in this", planned)
    assert re.search(r"proven optimal in regrasp time, .* per view over \d+ arm grasps, ", planned)


def test_a_bare_recipe_plans_as_no_recipe_does(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bare = folder / "bare.yaml"
    bare.write_text("name: bare\npart: block.stl\n")
    with_recipe = told(["plan", "--recipe", str(bare), "--pose", "0"], capsys)
    without = told(["plan", str(folder / "block.stl"), "--pose", "0"], capsys)
    for body in (with_recipe, without):
        body["planned_with"].pop("from_recipe")
    assert without_clock(with_recipe) == without_clock(without)


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (["plan"], "a CAD file or --recipe is required"),
        (["compile"], "a CAD file or --recipe is required"),
        (["plan", "--recipe", "RECIPE", "--unit", "mm"], "--unit is not allowed with --recipe"),
        (
            ["compile", "--recipe", "RECIPE", "--density", "2"],
            "--density is not allowed with --recipe",
        ),
        (["plan", "--recipe", "RECIPE", "--recipe", "RECIPE"], "`plan` takes one part"),
        (
            ["plan", "a.stl", "--site", "--recipe", "RECIPE", "--recipe", "RECIPE"],
            "recipes name their own parts",
        ),
    ],
)
def test_options_that_contradict_each_other_are_named(
    words: list[str], part: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    filled = [str(folder / "block.yaml") if word == "RECIPE" else word for word in words]
    assert main([*filled, "--cell", str(CELL)]) == 2
    assert part in capsys.readouterr().err


def test_the_cache_of_one_density_is_not_taken_for_another(folder: Path) -> None:
    cell = load_cell(CELL)
    part = load_part(folder / "block.stl")
    light, heavy = (planner_setup(None, cell, part, density) for density in (2.7, 7.85))
    PlanCache(part, light.layout, light.options).plan_at(part.poses[0], 360.0, 0.0, 0.0)
    planning = PlanCache(part, heavy.layout, heavy.options)
    planning.plan_at(part.poses[0], 360.0, 0.0, 0.0)
    assert not planning.is_from_cache
