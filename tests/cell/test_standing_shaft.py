"""A shaft that stands on its end, or lies on its side, is judged at any turn about its axis."""

from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import Run

from controller.cad.compiled import load_part
from controller.cell.journal import read_rows

SHAFT = """
unit: mm
tolerance_mm: 0.02
part:
  difference:
    - union:
        - cylinder: {diameter: 30, height: 26}
        - cylinder: {diameter: 20, height: 60}
    - cylinder: {diameter: 6, height: 40}
      turn: {about: y, deg: 90}
      move: [-20, 0, 13]
    - block: {from: [6.5, -3, 32], to: [12, 3, 52]}
"""
RECIPE = """
name: shaft
part: shaft.csg.yaml
density_g_cm3: 2.7
inspection: {required: stated}
"""


@pytest.mark.slow
@pytest.mark.parametrize("rolls", [False, True], ids=["on its end", "on its side"])
def test_a_good_shaft_is_not_rejected_for_a_turn_that_was_a_guess(
    start: Callable[..., Run], tmp_path: Path, *, rolls: bool
) -> None:
    cad = tmp_path / "shaft.csg.yaml"
    cad.write_text(SHAFT, encoding="utf-8")
    (tmp_path / "shaft.yaml").write_text(RECIPE, encoding="utf-8")
    poses = [pose.index for pose in load_part(cad).poses if pose.rolling is rolls]

    ran = start(str(tmp_path / "shaft.yaml"), "--seed", "7", "--pose", str(poses[0])).follow()
    assert ran.result["end"] == "complete"
    (part,) = ran.result["parts"]
    assert part["verdict"] in ("pass", "indeterminate"), part
    rows = list(read_rows(ran.journal, ran.result["run"]))
    (seen,) = next(row for row in rows if row.name == "sightings").body["sightings"]
    assert seen["free_turn"]
    assert not seen["ambiguous_with"]
    recovered = [row.body["trouble"] for row in rows if row.name == "recovery"]
    assert "held_otherwise" in recovered
    assert "ambiguous" not in recovered
