"""However often controllers are killed, one part is one part in all that is counted afterwards."""

from __future__ import annotations

from pathlib import Path

import pytest

from controller.history import Filters, figures, list_parts
from controller.results.judged import counted_parts
from controller.results.run import list_runs, load_run
from simulation.case import Case, Ended, Kill, run_case
from simulation.cell import Scene
from tests.unit.outlets import OUTLETS, store_of

PART = Scene("holder")
KILLED_AT = tuple(range(12, 132, 8))


def counted_once(runs: Path, ended: Ended) -> None:
    """Check that every count of a folder of runs has one part, with its verdict and its tray."""
    records = [load_run(runs, one.run_id) for one in list_runs(runs)]
    (judged,) = (part for record in records for part in counted_parts(record))
    assert (judged.verdict, judged.part.tray) == ("pass", "accept"), ended.killed_in
    for name, outlet in OUTLETS.items():
        found = outlet(runs)
        assert len(found) == 1, f"{name}: {found}, {ended.killed_in}"
    with store_of(runs) as store:
        (part,) = list_parts(store, Filters(), 9).parts
        assert (part["verdict"], part["tray"], part["custody"]) == ("pass", "accept", "placed")
        (group,) = figures(store, Filters()).groups
        counts = (group.part_count, group.judged_count, group.pass_count, group.first_count)
        assert counts == (1, 1, 1, 1)


@pytest.mark.parametrize(
    "row",
    [pytest.param(row, marks=pytest.mark.slow) for row in KILLED_AT if row != 108] + [108],
)
def test_a_part_whose_run_was_killed_counts_once(tmp_path: Path, row: int) -> None:
    ended = run_case(Case(4000 + row, PART, Kill(row=row, steps=60), "auto"), tmp_path / "cell")
    assert ended.ends == ["killed", "complete"], ended.killed_in
    assert ended.violations == []
    counted_once(tmp_path / "cell", ended)
