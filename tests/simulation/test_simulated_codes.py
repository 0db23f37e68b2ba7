"""A part with a code in the simulated cell: read in a view, or by nobody; and over a kill."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from controller.cell.compute import SeenCode
from controller.cell.journal import JOURNAL_NAME, Row, read_rows
from simulation import cell
from simulation.case import Case, Kill, run_case
from simulation.stand_ins import StandIns

CORNERS = np.array([(-5, -5, 0), (5, -5, 0), (5, 5, 0), (-5, 5, 0)], float)


@pytest.fixture
def codes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Have the recipe ask for a code, and held views show those returned; the table shows none."""
    shutil.copytree(cell.ROOT / "recipes", tmp_path / "recipes")
    recipe = tmp_path / "recipes" / "holder.yaml"
    recipe.write_text(recipe.read_text() + "serial_code: {code: data_matrix, form: SN-##}\n")
    monkeypatch.setattr(cell, "ROOT", tmp_path)
    shown: list[str] = []

    async def read_codes(
        self: StandIns, pictures: Any, T: Any, *, is_held: bool
    ) -> tuple[SeenCode, ...]:
        await self._take("inspect")
        return tuple(SeenCode(one, {}, 0, CORNERS) for one in shown) if is_held else ()

    monkeypatch.setattr(StandIns, "read_codes", read_codes)
    return shown


def named(folder: Path, name: str) -> list[Row]:
    return [row for row in read_rows(folder / JOURNAL_NAME) if row.name == name]


def test_a_number_read_in_a_view_is_the_parts_and_its_area_is_left_out(
    tmp_path: Path, codes: list[str]
) -> None:
    codes.append("SN-07")
    ended = run_case(Case(1, cell.Scene("holder")), tmp_path / "cell")
    assert (ended.ends, ended.truth["tray"]) == (["complete"], "accept")
    assert ended.violations == []
    first, last = named(tmp_path / "cell", "part_identified")
    assert "serial" not in first.body or first.body["serial"] == ""
    assert last.body["serial"] == "SN-07"
    taken = [file for row in named(tmp_path / "cell", "view_pictures")
             for file in row.body["pictures"].values()]  # fmt: skip
    assert last.body["code"]["picture"] in taken
    (views,) = (tmp_path / "cell").rglob("part001.views.json")
    assert '"codes_mm"' in views.read_text()


@pytest.mark.parametrize(
    "shown",
    [
        ["SN-07", "SN-08"],
        pytest.param([], marks=pytest.mark.slow),
        pytest.param(["SUPPLIER"], marks=pytest.mark.slow),
    ],
)
def test_a_part_that_nobody_can_name_goes_to_quarantine_and_the_run_goes_on(
    shown: list[str], tmp_path: Path, codes: list[str]
) -> None:
    codes.extend(shown)
    ended = run_case(Case(1, cell.Scene("holder")), tmp_path / "cell")
    assert (ended.ends, ended.truth["tray"]) == (["complete"], "quarantine")
    (verdict,) = named(tmp_path / "cell", "verdict")
    assert verdict.body["verdict"] == "indeterminate"
    assert verdict.body["reasons"][0].startswith("not identified: part 1: ")


@pytest.mark.slow
@pytest.mark.parametrize("steps", [60_000, 90_000])
def test_a_part_keeps_its_number_over_a_kill(steps: int, tmp_path: Path, codes: list[str]) -> None:
    codes.append("SN-07")
    case = Case(3, cell.Scene("holder"), kill=Kill(0, steps), recovery="auto")
    ended = run_case(case, tmp_path / "cell")
    assert ended.is_in_tray
    assert ended.violations == []
    assert named(tmp_path / "cell", "part_identified")[-1].body["serial"] == "SN-07"
