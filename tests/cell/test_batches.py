"""A batch of two recipes on one table: killed with a part of the second, gone on with, done."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from kill_world import kill_world, lines_of, start

from controller.cell.journal import first_flaw, is_of, read_rows, rows
from controller.config.view_set import load_view_set
from controller.results.judged import judged_parts
from controller.results.run import load_run

RECIPES = ("recipes/holder.yaml", "recipes/idler_riser.yaml")
PARTS = ("recipes/parts/holder.stl", "recipes/parts/idler_riser.stl")
SECOND = 1  # number of the second recipe in its order


def recipe_at_hand(journal: Path) -> int | None:
    """Return the number of the recipe of the part at hand, by the last row on it."""
    found = [row for row in read_rows(journal) if is_of(row, rows.PartIdentified)]
    return int(found[-1].body["recipe"]) if found else None


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_a_killed_batch_goes_on_with_the_recipe_of_the_part_in_the_gripper(
    tmp_path: Path,
) -> None:
    runs = tmp_path / "runs"
    journal = runs / "journal.sqlite"
    numbers = ("--serial-from", "S01", "--across-runs")
    with kill_world(tmp_path, *PARTS, seed=4, speed=10.0) as world:
        first = start(world, RECIPES[0], runs, RECIPES[1], *numbers)
        with first:
            for line in lines_of(first):
                if line.get("state") == "presenting" and recipe_at_hand(journal) == SECOND:
                    os.kill(first.pid, signal.SIGKILL)
                    break
        world.when_still()
        killed = load_run(runs, next(row.run for row in read_rows(journal)))
        (left,) = [one for one in judged_parts(killed) if one.part.tray is None]
        assert left.header.part == "idler_riser"

        done = [one.header.part for one in judged_parts(killed) if one.part.tray is not None]
        wanted = [recipe for recipe in RECIPES if Path(recipe).stem not in done]
        again = start(world, wanted[0], runs, *wanted[1:], "--auto-recover", *numbers)
        with again:
            *_, result = lines_of(again)
    assert result["end"] == "complete"
    went_on = result["parts"][0]
    assert (went_on["recipe"], went_on["serial"]) == ("idler_riser", left.header.serial)
    assert first_flaw(journal) is None

    parts = [*judged_parts(killed), *judged_parts(load_run(runs, result["run"]))]
    finished = [one for one in parts if one.part.tray is not None]
    assert sorted(one.header.part for one in finished) == ["holder", "idler_riser"]
    assert len({one.header.serial for one in finished}) == 2
    for one in finished:  # each was judged by its own recipe, from its own CAD
        assert one.header.recipe == f"{one.header.part}.yaml"
        assert one.header.cad == f"{one.header.part}.stl"
        views = runs / one.header.run_id / f"part{one.part.number:03d}.views.json"
        if views.is_file():
            file = load_view_set(views)
            assert file.recipe is not None
            assert file.recipe.name == one.header.part
            assert file.part.name == f"{one.header.part}.stl"
