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
