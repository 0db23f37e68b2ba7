"""Damaged CAD files give a typed error or a right answer."""

from __future__ import annotations

from pathlib import Path

import pytest
from cad_solids import box, mesh_of, prism, rod
from damaged_files import Original, bombs, facts_of, make_cases, originals_of, run

from controller.cad import load_solid

WIDGET = Path(__file__).resolve().parents[2] / "recipes" / "parts" / "widget.csg.yaml"


def originals() -> list[Original]:
    plate = box(60, 40, 12) - rod(6, 30, 24).translate((12, 4, 0))
    wedge = prism([(0, 0), (50, 0), (50, 10), (0, 30)], 20) - rod(5, 60, 20).translate((15, 10, 0))
    text = Original("widget", "csg.yaml", WIDGET.read_bytes(), facts_of(load_solid(WIDGET).mesh))
    solids = {"plate": plate, "wedge": wedge}
    return [o for n, b in solids.items() for o in originals_of(n, mesh_of(b))] + [text]


@pytest.mark.parametrize("with_bombs", [False, True])
def test_every_damaged_file_gives_a_typed_error_or_a_right_answer(
    tmp_path: Path, with_bombs: bool
) -> None:
    count = len(bombs()) if with_bombs else 60
    cases = make_cases(count, 7, originals(), with_bombs)
    outcomes = {}
    for case, outcome, told in run(cases, tmp_path):
        assert not outcome.startswith("WRONG"), (case.kind, case.name, outcome, told)
        assert told["rss_mb"] < 1024
        outcomes.setdefault(case.kind, set()).add(outcome)
    if not with_bombs:
        harmless = {"shuffled", "no area", "needle"}
        assert all(outcomes[kind] == {"solid as before"} for kind in harmless)
        assert outcomes["NaN"] == outcomes["infinite"] == {"CoordinatesCadError"}
        assert outcomes["count 4e9"] == {"UnreadableCadError"}
        assert "solid as before" not in outcomes["facets lost"] | outcomes["self cut"]
