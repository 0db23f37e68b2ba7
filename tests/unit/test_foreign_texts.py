"""Lists, settings and models as text of other programs (tests/data/foreign/texts)."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from controller.cad import CadError, load_solid
from controller.cli.inputs.calibration_file import load_calibration
from controller.cli.inputs.parts_list import load_parts_list
from controller.config import ConfigError, load_recipe
from controller.results.gauge import read_references

FOLDER = Path(__file__).resolve().parents[1] / "data" / "foreign" / "texts"
TRUTH: dict[str, dict[str, Any]] = json.loads((FOLDER / "truth.json").read_text(encoding="utf-8"))


def camera_facts(path: Path) -> list[float]:
    camera = load_calibration(path)
    return [float(camera.K[0, 0]), float(camera.T_world_cam[2, 3])]


def recipe_facts(path: Path) -> list[object]:
    found = load_recipe(path)
    return [found.name, found.density_g_cm3]


READERS: dict[str, Callable[[Path], object]] = {
    "block": lambda path: load_solid(path).volume_mm3,
    "camera": camera_facts,
    "list": lambda path: [label.serial for _, label in load_parts_list(path, "").labels],
    "recipe": recipe_facts,
    "reference": lambda path: [one.value for one in read_references(path, ["d1"], [])],
}


@pytest.mark.parametrize("name", sorted(TRUTH))
@pytest.mark.parametrize("before", ["", os.fsdecode(b"gr\xf6\xdfe ")], ids=["plain", "no utf-8"])
def test_a_foreign_text_is_read_rightly_or_refused_in_words(
    tmp_path: Path, name: str, before: str
) -> None:
    """In a file of its own name, and of one that is no UTF-8."""
    truth, read = TRUTH[name], READERS[name.partition("_")[0]]
    for part in ("part.stl", "widget.yaml"):
        (tmp_path / part).write_bytes(b"")
    path = tmp_path / f"{before}{name}"
    path.write_bytes((FOLDER / name).read_bytes())
    if "refused" in truth:
        with pytest.raises((ConfigError, CadError)) as caught:
            read(path)
        assert str(caught.value).startswith(str(path)), "the file is named first"
        assert re.search(truth["refused"], str(caught.value)), str(caught.value)
        return
    found, means = read(path), truth["means"]
    assert found == (pytest.approx(means) if isinstance(means, float) else means)


def test_each_foreign_text_is_listed() -> None:
    there = {path.name for path in FOLDER.iterdir()}
    assert there - {"make.py", "truth.json", "__pycache__"} == set(TRUTH)
