"""A part that has failed is put down without its last views, where the recipe asks for that."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from controller import inspection as inspecting
from controller.cell.journal import JOURNAL_NAME, Row, read_rows
from controller.config.view_set import load_view_set
from simulation import cell
from simulation.case import Case, run_case
from simulation.stand_ins import StandIns

CHIP = inspecting.Finding(
    kind=inspecting.FindingKind.CHIP,
    lamp="station_backlight",
    area_mm2=4.0,
    size_mm=3.0,
    at_px=(600.0, 500.0),
    box_px=(590, 490, 610, 510),
    p_part_mm=np.zeros(3),
    face_ids=(0,),
)


@pytest.fixture
def damaged(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the stand-ins find a chip in some views, and judge a part with two of them as failed."""
    inspect, judge = StandIns.inspect, StandIns.judge

    async def chipped(self: StandIns, view_id: str, *rest: Any) -> inspecting.ViewResult:
        found = await inspect(self, view_id, *rest)
        return replace(found, findings=(CHIP,) if found.evaluated else ())

    async def judged(self: StandIns, set_path: Path) -> inspecting.PartInspection:
        found = await judge(self, set_path)
        held = [view for view in load_view_set(set_path).views if view.camera is None]
        if len(held) < 2:
            return found
        fail = inspecting.Verdict.FAIL
        ledger = replace(found.ledger, verdict=fail, reasons=("a chip in two views",))
        return replace(found, verdict=fail, reasons=ledger.reasons, ledger=ledger)

    monkeypatch.setattr(StandIns, "inspect", chipped)
    monkeypatch.setattr(StandIns, "judge", judged)


@pytest.mark.usefixtures("damaged")
def test_a_part_that_failed_is_put_down_without_its_last_views(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(cell.ROOT / "recipes", tmp_path / "recipes")
    recipe = tmp_path / "recipes" / "holder.yaml"
    asked = "inspection:\n  stop_at_fail: true"
    recipe.write_text(recipe.read_text().replace("inspection:", asked, 1))
    monkeypatch.setattr(cell, "ROOT", tmp_path)
    ended = run_case(Case(1, cell.Scene("holder")), tmp_path / "cell")
    assert ended.ends == ["complete"]
    assert ended.truth["tray"] == "reject"
    assert ended.violations == []
    journal = list(read_rows(tmp_path / "cell" / JOURNAL_NAME))
    # one plan to inspect it, one to the trays from where the arm stood
    inspecting_plan, to_trays = named(journal, "plan")
    planned, left = (
        sum(label.startswith("show") for label in plan.body["steps"])
        for plan in (inspecting_plan, to_trays)
    )
    shown = sum(bool(row.body["q"]) for row in named(journal, "view_pictures"))
    assert left == 0
    assert 2 <= shown < planned
    (verdict,) = named(journal, "verdict")
    assert verdict.body["verdict"] == "fail"
    said = f"put down as it had failed; views not shown: {planned - shown}"
    assert said in verdict.body["reasons"]


def named(journal: list[Row], name: str) -> list[Row]:
    return [row for row in journal if row.name == name]
