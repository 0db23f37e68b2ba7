"""The recipe key `inspection.learned`: what it may name, and what a run makes of it."""

from __future__ import annotations

import hashlib
import json
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import view_sets

from controller.cell.batch import RunOrder, product_of
from controller.cell.batch.beginning import input_files, keep_inputs
from controller.cell.compute import Compute, Job
from controller.cell.compute.job import context
from controller.cell.journal import rows
from controller.cell.recovery import Interrupted
from controller.cell.services import PartFileWriter
from controller.cell.services.records import PartRecord
from controller.cli import main
from controller.cli.running.accepting import recipe_of
from controller.config import EMULATED_CELL, ConfigError, load_cell, load_recipe
from controller.config.view_set import load_view_set
from controller.inspection import Appearance
from controller.setup.layout import build_layout
from controller.stored import AcceptedPart, LearnedHeader, cad_sha256, write_learned
from controller.stored.learned_file import SCHEMA

BLOCK = "unit: mm\npart:\n  block: {size: [60, 40, 20]}\n"


def write_empty(path: Path, cad: Path) -> None:
    """A learned file of a part, of no view."""
    header = LearnedHeader(
        schema=SCHEMA, part="block", cad_sha256=cad_sha256(cad), p_part_mm=(0.0, 0.0, 0.0),
        made=datetime(2026, 3, 14, tzinfo=UTC), software="1", parts=(AcceptedPart(name="a"),),
        compared=0.9, in_sight=0.9,
    )  # fmt: skip
    write_learned(path, Appearance((), np.zeros(3)), header)


@pytest.fixture
def recipe(tmp_path: Path) -> Path:
    """A recipe with a learned file in a folder below its own."""
    there = tmp_path / "there"
    (there / "learned").mkdir(parents=True)
    (there / "block.csg.yaml").write_text(BLOCK)
    write_empty(there / "learned" / "good.learned", there / "block.csg.yaml")
    path = there / "block.yaml"
    path.write_text(
        "name: block\npart: block.csg.yaml\ninspection:\n  min_coverage: 0.6\n"
        "  learned: learned/good.learned\n"
    )
    return path


def naming(recipe: Path, value: str) -> str:
    """The message that a recipe with this value is refused with."""
    recipe.write_text(
        f"name: block\npart: block.csg.yaml\ninspection:\n  min_coverage: 0.6\n  learned: {value}\n"
    )
    with pytest.raises(ConfigError) as caught:
        load_recipe(recipe)
    return str(caught.value)


def test_a_recipe_names_it_from_its_own_folder(recipe: Path) -> None:
    found = load_recipe(recipe).inspection.learned
    assert found == recipe.parent / "learned" / "good.learned"


def test_without_the_key_nothing_is_learned(recipe: Path) -> None:
    recipe.write_text("name: block\npart: block.csg.yaml\n")
    assert load_recipe(recipe).inspection.learned is None


@pytest.mark.parametrize("value", ["none.learned", "learned"])
def test_a_file_that_is_not_there_is_named_with_its_line(recipe: Path, value: str) -> None:
    said = naming(recipe, value)
    assert said.startswith(f"{recipe}:5: `inspection.learned`: no file ")
    assert value in said
    assert "`cellctl learn` writes it" in said


@pytest.mark.parametrize("value", ["../other.learned", "/etc/hostname", "out/other.learned"])
def test_a_file_outside_the_recipes_folder_is_refused_with_its_line(
    recipe: Path, value: str
) -> None:
    write_empty(recipe.parent.parent / "other.learned", recipe.parent / "block.csg.yaml")
    (recipe.parent / "out").symlink_to(recipe.parent.parent)
    said = naming(recipe, value)
    assert said.startswith(f"{recipe}:5: `inspection.learned`: {value} is outside")


@pytest.mark.parametrize("value", ["7", "[a, b]", "{a: b}", "true"])
def test_what_is_no_file_name_is_refused_with_its_line(recipe: Path, value: str) -> None:
    said = naming(recipe, value)
    assert said.startswith(f"{recipe}:5: ")
    assert "learned" in said


def test_a_set_of_views_names_it_from_its_own_folder(tmp_path: Path) -> None:
    path = tmp_path / "SET.json"
    path.write_text(json.dumps(view_sets.tree() | {"learned": "inputs/a.learned"}))
    assert load_view_set(path).learned == tmp_path / "inputs" / "a.learned"


# -- a run ----------------------------------------------------------------------------------------


def order_of(recipe: Path, folder: Path) -> RunOrder:
    """What a run's beginning reads of an order."""
    one = SimpleNamespace(recipe=load_recipe(recipe), path=recipe)
    order = SimpleNamespace(
        recipe_path=recipe, cell_path=EMULATED_CELL, ordered=(one,), beside=(),
        cell=SimpleNamespace(calibration={}), folder=folder,
    )  # fmt: skip
    return cast("RunOrder", order)


def test_a_run_keeps_a_copy_with_its_hash_and_notes_the_file_itself(
    recipe: Path, tmp_path: Path
) -> None:
    order = order_of(recipe, tmp_path / "run")
    learned = recipe.parent / "learned" / "good.learned"
    digests = keep_inputs(order)
    copy = tmp_path / "run" / "inputs" / "good.learned"
    assert copy.read_bytes() == learned.read_bytes()
    assert digests["inputs/good.learned"] == hashlib.sha256(copy.read_bytes()).hexdigest()
    # a recording of the wires and a recovery bring along what is listed here
    assert learned in input_files(order)


def test_the_views_of_a_part_name_the_runs_own_copy(recipe: Path, tmp_path: Path) -> None:
    cell, found = load_cell(EMULATED_CELL), load_recipe(recipe)
    compute = Compute(Job(recipe, EMULATED_CELL), None)  # type: ignore[arg-type]  # not asked
    part_file = PartFileWriter(cell, build_layout(cell), tmp_path)
    text = part_file.text(PartRecord(number=1), product_of(compute, found, cell), ())
    assert json.loads(text)["learned"] == "inputs/good.learned"


def test_a_part_goes_on_by_the_learned_file_that_its_run_began_with(
    recipe: Path, tmp_path: Path
) -> None:
    run = tmp_path / "run"
    order = order_of(recipe, run)
    keep_inputs(order)
    files = {
        str(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in input_files(order)
    }
    body = load_recipe(recipe).model_dump(mode="json", by_alias=True)
    left = Interrupted("run", 1, rows.RunBegan(files=files, recipe=body))
    assert recipe_of(left, run) == recipe
    learned = recipe.parent / "learned" / "good.learned"
    before = learned.read_bytes()
    learned.write_bytes(b"learned anew")
    again = recipe_of(left, run)
    assert again != recipe
    own = load_recipe(again).inspection.learned
    assert own is not None
    assert own.read_bytes() == before


def test_one_of_another_cad_file_is_refused_before_anything_moves(
    recipe: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The job of a worker is built before the first device is asked for anything."""
    (recipe.parent / "block.csg.yaml").write_text(BLOCK.replace("60", "61"))
    with pytest.raises(ConfigError, match="was learned with another CAD model"):
        context(Job(recipe, EMULATED_CELL))
    assert main(["check", str(recipe)]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert "was learned with another CAD model" in said.err
    assert "learn again with `cellctl learn`" in said.err


def test_a_damaged_one_is_refused_before_anything_moves(
    recipe: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (recipe.parent / "learned" / "good.learned").write_bytes(b"PK")
    assert main(["check", str(recipe)]) == 2
    assert "good.learned: is no file of learned parts" in capsys.readouterr().err
