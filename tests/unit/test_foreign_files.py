"""Files as other programs write them (tests/data/foreign): read rightly, or refused in words."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from controller.cad import CadError, load_solid
from controller.cad.reading.step.files import read_step_part
from controller.config import ConfigError, load_recipe, split_cad
from controller.config.cad_files import body_path

FOLDER = Path(__file__).resolve().parents[1] / "data" / "foreign"
TRUTH: dict[str, dict[str, Any]] = json.loads((FOLDER / "truth.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", sorted(TRUTH))
def test_a_foreign_file_is_read_rightly_or_refused_in_words(name: str) -> None:
    truth = TRUTH[name]
    path = body_path(FOLDER / name, truth["body"]) if "body" in truth else FOLDER / name
    if "refused" in truth:
        with pytest.raises(CadError) as caught:
            load_solid(path)
        assert str(caught.value).startswith(str(FOLDER / name)), "the file is named first"
        assert re.search(truth["refused"], str(caught.value)), str(caught.value)
        return
    solid = load_solid(path)
    assert solid.mesh.extents == pytest.approx(truth["size_mm"], abs=1e-4)
    assert solid.volume_mm3 == pytest.approx(truth["volume_mm3"], rel=1e-6)
    if "caution" in truth:
        said = " ".join(read_step_part(FOLDER / name, body=truth["body"]).warnings)
        assert re.search(truth["caution"], said), said


def test_a_recipe_unites_the_bodies_of_its_step_file(tmp_path: Path) -> None:
    (tmp_path / "angle.step").write_bytes((FOLDER / "step_touching.step").read_bytes())
    recipe = tmp_path / "angle.yaml"
    recipe.write_text("name: angle\npart: angle.step\nunite: true\n")
    part = load_recipe(recipe).part
    assert part.name == "angle.step#*"
    assert split_cad(part).part_name == "angle"
    recipe.write_text("name: angle\npart: angle.step#bolt\nunite: true\n")
    with pytest.raises(ConfigError, match=r"angle\.yaml:3: `unite`: is for a STEP file of several"):
        load_recipe(recipe)


def test_the_corpus_has_forty_files_and_nothing_that_is_not_listed() -> None:
    there = {path.name for path in FOLDER.iterdir() if path.is_file()}
    assert there - {"make.py", "truth.json"} == set(TRUTH)
    assert len(TRUTH) >= 40
