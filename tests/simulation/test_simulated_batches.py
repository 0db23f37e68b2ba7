"""A batch of two recipes in the simulated cell: killed with a part of the second, gone on with."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from controller.cell.batch import Papers, RunResult
from controller.cell.journal import first_flaw, is_of, read_rows, rows
from controller.results.judged import judged_parts
from controller.results.run import load_run
from simulation.cell import Controller, Scene, SimulatedCell
from simulation.loop import SimulatedLoop

TWO = Scene("holder", place=1, beside=Scene("idler_riser", place=2))
NUMBERS = Papers(counted_from="S01")
HELD = ("arm", "fixture", "both")


class Story:
    """Two parts on the table; the first controller may be killed with the second recipe's part."""

    def __init__(self, folder: Path, seed: int) -> None:
        self.loop = SimulatedLoop(seed)
        self.cell = SimulatedCell(self.loop, seed, TWO, folder)
        self.results: list[RunResult] = []
        self.runs: list[str] = []

    def run(self, rows_later: int | None = None) -> Story:
        """Run; kill the first controller so many rows after a gripper has the second part."""
        try:
            self.loop.run_until_complete(self._all(rows_later))
        finally:
            self.cell.close()
            self.loop.bury()
            self.loop.close()
        return self

    async def _all(self, rows_later: int | None) -> None:
        async with self.cell:
            more: dict[str, Any] = {"papers": NUMBERS}
            if rows_later is not None:
                await self._kill(self._controller(more), rows_later)
                more |= {"recovery": "auto", "papers": Papers()}
                first = self.cell.truth()["parts"][0]
                if first["tray"] or first["custody"] == "away":  # that recipe is done
                    left = self.cell.ordered[1]
                    more |= {"recipe_path": left.path, "recipe": left.recipe, "beside": ()}
            self.results.append(await self._controller(more).start())

    def _controller(self, options: dict[str, Any]) -> Controller:
        made = self.cell.controller(**options)
        self.runs.append(made.run_id)
        return made

    async def _kill(self, controller: Controller, rows_later: int) -> None:
        due: int | None = None
        killed = asyncio.Event()

        def after_step(owner: object) -> None:
            nonlocal due
            if owner is not controller.process or not controller.process.is_alive:
                return
            if due is None and self.cell.truth()["parts"][1]["custody"] in HELD:
                due = controller.row_count + rows_later
            if due is not None and controller.row_count >= due:
                controller.kill()
                killed.set()

        self.loop.after_step = after_step
        task, waiting = controller.start(), asyncio.ensure_future(killed.wait())
        await asyncio.wait({task, waiting}, return_when=asyncio.FIRST_COMPLETED)
        waiting.cancel()
        self.loop.after_step = None
        assert killed.is_set(), "the controller came to its end before it was killed"


@pytest.mark.slow
def test_each_part_is_inspected_by_its_own_recipe(tmp_path: Path) -> None:
    story = Story(tmp_path / "cell", 3).run()
    (result,) = story.results
    assert result.outcome.end == "complete"
    record = load_run(tmp_path / "cell", story.runs[0])
    parts = {one.header.part: one for one in judged_parts(record)}
    assert sorted(parts) == ["holder", "idler_riser"]
    assert sorted(one.header.serial for one in parts.values()) == ["S01", "S02"]
    for name, one in parts.items():
        assert one.header.recipe == f"{name}.yaml"
        assert one.verdict == "pass"
        assert one.part.tray == "accept"
    seen = [row for row in read_rows(story.cell.journal_path) if is_of(row, rows.Sightings)]
    assert len(seen[0].body["sightings"]) == 2  # the first one was taken from beside the other


@pytest.mark.slow
@pytest.mark.parametrize("rows_later", [4, 30])
def test_a_killed_batch_goes_on_with_the_part_by_its_own_recipe(
    rows_later: int, tmp_path: Path
) -> None:
    story = Story(tmp_path / "cell", 5).run(rows_later)
    (result,) = story.results
    assert result.outcome.end == "complete", result.outcome
    assert first_flaw(story.cell.journal_path) is None
    killed, went_on = (load_run(tmp_path / "cell", run) for run in story.runs)
    (left,) = [one for one in judged_parts(killed) if one.part.tray is None]
    again = judged_parts(went_on)[0]
    assert left.header.part == again.header.part == "idler_riser"
    assert again.header.serial == left.header.serial != ""
    assert again.part.resumed is not None
    assert again.part.tray == "accept"
