"""The CAD model that a run's part is drawn from: the run's own copy, as the journal has it."""

from __future__ import annotations

import hashlib
import shutil
from pathlib import Path

import pytest

from controller.cad import Solid
from controller.results.judged.cad import solid_of
from tests.data_files import part_file

RECIPE = {"name": "flange", "part": "recipes/parts/flange_xy.stl"}
FILE = part_file("flange_xy.stl")
FILES = {RECIPE["part"]: hashlib.sha256(FILE.read_bytes()).hexdigest()}


@pytest.mark.parametrize("inputs", ["inputs", "inputs/2"])
def test_a_part_is_drawn_from_the_copy_in_the_folder_of_its_run(
    inputs: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, elsewhere = tmp_path / "runs" / "one", tmp_path / "elsewhere"
    elsewhere.mkdir()
    (run / inputs).mkdir(parents=True)
    shutil.copyfile(FILE, run / inputs / FILE.name)
    monkeypatch.chdir(elsewhere)
    assert isinstance(solid_of(RECIPE, FILES, run), Solid)


def test_a_run_without_copies_is_drawn_from_the_file_that_it_read(tmp_path: Path) -> None:
    read = tmp_path / RECIPE["part"]
    read.parent.mkdir(parents=True)
    shutil.copyfile(FILE, read)
    assert isinstance(solid_of(RECIPE, FILES, tmp_path / "runs" / "one"), Solid)


def test_a_copy_that_was_changed_is_not_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "inputs").mkdir()
    (tmp_path / "inputs" / FILE.name).write_bytes(FILE.read_bytes() + b" ")
    assert "was changed since the run" in str(solid_of(RECIPE, FILES, tmp_path))


def test_a_file_that_is_gone_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert "flange_xy.stl" in str(solid_of(RECIPE, FILES, tmp_path))
    assert "does not name" in str(solid_of(RECIPE, {}, tmp_path))
