"""Parts with codes on them, over the wires: each is named by what the cameras read."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import ROOT, Run

from controller.cell.journal import read_rows, rows


@pytest.mark.slow
def test_two_parts_are_named_by_the_codes_on_them_which_are_no_findings(
    start: Callable[..., Run], tmp_path: Path
) -> None:
    recipes = tmp_path / "recipes"
    shutil.copytree(ROOT / "recipes", recipes)
    recipe = recipes / "holder.yaml"
    recipe.write_text(recipe.read_text() + "serial_code: {code: data_matrix, form: SN-####}\n")
    ran = start(str(recipe), "--seed", "12", "--count", "2", "--surfaces", "machined").follow()
    assert ran.result["end"] == "complete", ran.stderr
    parts = ran.result["parts"]
    assert [part["serial"] for part in parts] == ["SN-0001", "SN-0002"]
    assert [part["tray"] for part in parts] == ["accept", "accept"]
    run = ran.result["run"]
    named = [row.body for row in read_rows(ran.journal, run)
             if row.name == rows.PartIdentified.row_name and row.body.get("code")]  # fmt: skip
    assert [body["code"]["number"] for body in named] == ["SN-0001", "SN-0002"]
    assert all((ran.folder / body["code"]["picture"]).is_file() for body in named)
    verdicts = [row.body for row in read_rows(ran.journal, run) if row.name == "verdict"]
    assert all(
        any("on the code" in reason for face in verdict["faces"] for reason in face.get("rest", {}))
        for verdict in verdicts
    )
