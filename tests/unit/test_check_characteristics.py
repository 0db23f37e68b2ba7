"""What `cellctl check` refuses: stated tolerances beyond the cell, never general ones."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
from cad_solids import box, rod, solid_of

from controller.cad.compiled import CompiledPart, compile_solid
from controller.cell.compute.checks import (
    CheckedCharacteristic,
    check_characteristics,
)
from controller.config import load_cell, load_recipe
from controller.config.shipped import EMULATED_CELL

METROLOGY_CELL = EMULATED_CELL.with_name("metrology.yaml")


@cache
def part() -> CompiledPart:
    bored = box(60, 40, 20) - rod(6, 30, 128) - rod(2.5, 30, 96).translate((20, 10, 0))
    bored = bored - rod(2, 6, 96).translate((-20, 10, 7))
    return compile_solid(solid_of(bored, "block"))


@cache
def shaft() -> CompiledPart:
    """A shaft with a blind cross hole, whose mouth lies in no plane."""
    blind = rod(2, 8, 96).rotate((90, 0, 0)).translate((0, -12, 0))
    return compile_solid(solid_of(rod(12, 60, 256) - blind, "block"))


def checked(
    folder: Path, cell: Path, *entries: str, of: Callable[[], CompiledPart] = part
) -> tuple[dict[str, CheckedCharacteristic], tuple[str, ...]]:
    (folder / "block.stl").write_bytes(b"solid")
    lines = "".join(f"    - {entry}\n" for entry in entries)
    path = folder / "block.yaml"
    listed = f"inspection:\n  characteristics:\n{lines}" if entries else ""
    path.write_text(f"name: block\npart: block.stl\n{listed}")
    found, problems = check_characteristics(path, load_recipe(path), load_cell(cell), of())
    return {each.characteristic.id: each for each in found}, problems


def test_general_tolerances_stop_no_recipe(tmp_path: Path) -> None:
    found, problems = checked(tmp_path, EMULATED_CELL)
    assert problems == ()
    diameter = found["hole 5 mm diameter"]  # +-0.1 at 0.19 mm a pixel
    assert not diameter.capability.is_capable
    assert "above 30%" in diameter.characteristic.exempt
    length = next(each for name, each in found.items() if name.startswith("length 60"))
    assert length.capability.is_capable  # +-0.3
    assert length.characteristic.exempt == ""


def test_a_stated_tolerance_that_is_too_tight_is_refused_with_what_the_cell_can_do(
    tmp_path: Path,
) -> None:
    entry = "{id: hole 12 mm diameter, plus: 0.05, minus: 0.05}"
    found, problems = checked(tmp_path, EMULATED_CELL, entry)
    assert len(problems) == 1
    assert "hole 12 mm diameter: 11.95 to 12.05 mm (recipe)" in problems[0]
    allowed = re.search(r"allows \+-(\d+\.\d+) mm", problems[0])
    assert allowed is not None
    assert found["hole 12 mm diameter"].characteristic.exempt == ""
    widened = float(allowed[1]) + 0.01  # it is printed to two digits
    wide = f"{{id: hole 12 mm diameter, plus: {widened}, minus: {widened}}}"
    assert checked(tmp_path, EMULATED_CELL, wide)[1] == ()


def test_limits_of_what_nothing_measures_are_refused_unless_it_is_left_out(tmp_path: Path) -> None:
    blind = "{id: hole 4 mm depth, plus: 0.1, minus: 0.1}"
    _, problems = checked(tmp_path, EMULATED_CELL, blind, of=shaft)
    assert len(problems) == 1
    assert "hole 4 mm depth: " in problems[0]
    assert "(recipe) cannot be verified" in problems[0]
    assert "no picture shows the depth of a hole; gauge it elsewhere" in problems[0]
    left_out = "{id: hole 4 mm depth, ignore: gauged by hand}"
    assert checked(tmp_path, EMULATED_CELL, blind, left_out, of=shaft)[1] == ()


def test_a_depth_needs_about_three_times_the_tolerance_of_a_diameter(tmp_path: Path) -> None:
    """It shows by the sine of 18 to 20 degrees, the angle to its axis."""
    found, _ = checked(tmp_path, EMULATED_CELL)
    depth, diameter = (found[f"hole 4 mm {word}"] for word in ("depth", "diameter"))
    assert depth.characteristic.is_measured
    assert depth.capability.U_mm / diameter.capability.U_mm == pytest.approx(3.1, abs=0.3)


@pytest.mark.parametrize(
    "entry",
    [
        "{id: hole 12 mm diameter, plus: 0.05, minus: 0.05}",
        "{id: hole 12 mm diameter, fit: H12}",
        "{id: hole 12 mm position, upper: 0.1}",
    ],
)
def test_smaller_pixels_verify_what_larger_ones_do_not(tmp_path: Path, entry: str) -> None:
    assert len(checked(tmp_path, EMULATED_CELL, entry)[1]) == 1
    assert checked(tmp_path, METROLOGY_CELL, entry)[1] == ()


def test_a_fit_for_a_bearing_is_for_no_camera_of_ours(tmp_path: Path) -> None:
    (problem,) = checked(tmp_path, METROLOGY_CELL, "{id: hole 12 mm diameter, fit: H7}")[1]
    assert "(recipe H7)" in problem


def test_what_is_left_out_is_not_refused(tmp_path: Path) -> None:
    entries = "{id: hole 12 mm diameter, fit: H7}", "{id: hole 12 mm, ignore: plug gauge}"
    found, problems = checked(tmp_path, EMULATED_CELL, *entries)
    assert problems == ()
    assert "plug gauge" in found["hole 12 mm diameter"].characteristic.exempt


def test_all_of_class_m_is_verified_by_the_metrology_cell(tmp_path: Path) -> None:
    found, _ = checked(tmp_path, METROLOGY_CELL)
    short = [name for name, each in found.items() if not each.capability.is_capable]
    assert short == ["hole 4 mm depth"]
    assert found["hole 4 mm depth"].capability.share < 0.5
