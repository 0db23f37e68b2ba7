"""`cellctl init`: what it lays out, and that it works there."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from controller.cli import main
from controller.config import EMULATED_CELL, SHIPPED, load_cell, load_recipe

FILES = [
    "README.md", "cell.yaml", "parts/LICENSE-trimesh", "parts/holder.stl", "plan_part.py",
    "recipe.yaml",
]  # fmt: skip


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    assert main(["init", "new/project"]) == 0
    return tmp_path / "new" / "project"


def test_it_writes_what_it_names(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "project"
    folder.mkdir()  # an empty folder will do
    assert main(["init", str(folder), "--json"]) == 0
    body = json.loads(capsys.readouterr().out)
    assert body["files"] == FILES
    there = [p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()]
    assert sorted(there) == FILES


def test_recipe_and_cell_belong_together_and_to_nothing_else(project: Path) -> None:
    recipe = load_recipe(project / "recipe.yaml")
    assert recipe.cell == project / "cell.yaml"
    assert recipe.part == project / "parts" / "holder.stl"
    assert load_cell(recipe.cell).model_dump() == load_cell(EMULATED_CELL).model_dump()
    licence = (project / "parts" / "LICENSE-trimesh").read_text()
    assert licence == (SHIPPED / "parts" / "LICENSE-trimesh").read_text()


def test_a_folder_with_files_is_left_as_it_is(
    project: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (project / "recipe.yaml").write_text("mine")
    assert main(["init", "new/project"]) == 2
    assert "has files in it" in capsys.readouterr().err
    assert (project / "recipe.yaml").read_text() == "mine"


def test_check_and_plan_need_no_argument_there(
    project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(project)
    capsys.readouterr()
    assert main(["check", "--json"]) == 0
    checked = json.loads(capsys.readouterr().out)
    assert checked["recipe"] == "recipe.yaml"
    assert checked["ok"]
    pose = str(checked["poses"][0]["pose_index"])
    assert main(["plan", "--json", "--pose", pose]) == 0
    plan = json.loads(capsys.readouterr().out)
    assert plan["part"] == "holder"
    assert plan["planned_with"]["from_recipe"]


def test_its_script_plans_the_part(project: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-P", str(project / "plan_part.py")],
        cwd=project.parent, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "% of the surface" in done.stdout


def test_a_part_of_ones_own_is_in_it_and_is_planned(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "on off.csg.yaml").write_text(
        "unit: mm\npart:\n  block: {size: [40, 30, 20]}\n", encoding="utf-8"
    )
    monkeypatch.chdir(tmp_path)
    assert main(["init", "mine", "--part", "on off.csg.yaml", "--density", "7.85"]) == 0
    recipe = load_recipe(tmp_path / "mine" / "recipe.yaml")
    assert (recipe.name, recipe.density_g_cm3, recipe.unit) == ("on off", 7.85, None)
    assert recipe.part == tmp_path / "mine" / "parts" / "on off.csg.yaml"
    assert "holder" not in (tmp_path / "mine" / "README.md").read_text(encoding="utf-8")
    capsys.readouterr()
    assert main(["check", "mine/recipe.yaml", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["ok"]
    script = (tmp_path / "mine" / "plan_part.py").read_text(encoding="utf-8")
    assert '"on off.csg.yaml"' in script


def test_the_unit_of_a_file_that_names_none_is_written_down(tmp_path: Path) -> None:
    part = SHIPPED / "parts" / "holder.stl"
    for unit, arguments in (("mm", []), ("inch", ["--unit", "inch"])):
        folder = tmp_path / unit
        assert main(["init", str(folder), "--part", str(part), *arguments]) == 0
        assert load_recipe(folder / "recipe.yaml").unit == unit


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--part", "missing.step"], "No such file"),
        (["--part", "notes.pages"], "is not read"),
        (["--unit", "cm"], "require --part"),
        (["--part", "notes.pages", "--driver", "acme"], "exclude each other"),
    ],
)
def test_what_cannot_be_a_part_leaves_no_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    arguments: list[str], message: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    Path("notes.pages").write_text("about the part", encoding="utf-8")
    assert main(["init", "mine", *arguments]) == 2
    assert message in capsys.readouterr().err
    assert not Path("mine").exists()
