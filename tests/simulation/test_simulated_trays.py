"""Trays in the simulated cell: hands set the finger tips down, and the arm knows where they are."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from controller.bring_up import CommissioningSession, CommissionOrder, Errand
from controller.bring_up.person import HELPER
from controller.bring_up.procedure import CommissioningFolder, StepEnd, StepRecord
from controller.cell.devices.clocks import FoundClock
from controller.cell.operator import Answer, Question
from controller.config import load_cell
from simulation.cell import BEAT_S, Scene, SimulatedCell
from simulation.loop import SimulatedLoop, SimulatedProcess

MOVED_MM = np.array([4.0, -3.0])
ACCEPT = np.array([100.0, 390.0])  # recipes/cells/emulated.yaml


class Hands:
    """Answers for a person and carries out what it is sent to do, unless something befalls it."""

    def __init__(self, cell: SimulatedCell, then: Callable[[Mapping[str, Any]], Any]) -> None:
        self.cell, self.then = cell, then

    async def decide(self, question: Question) -> Answer:
        return Answer(question.choices[0].key, HELPER)

    async def do(self, errand: Errand) -> None:
        for order in errand.orders:
            changed = dict(self.then(order) or order)
            self.cell.befall(changed.pop("do"), **changed)


def run(
    tmp_path: Path, then: Callable[[CommissioningSession, Mapping[str, Any]], Any], times: int = 1
) -> tuple[StepRecord, Path]:
    """Run the step `trays` so often, on a cell whose trays stand beside their marks.

    ``then`` is called with the session and each order to hands before it is carried out in the
    first run, and may return another in its place.
    """
    loop = SimulatedLoop(5)
    cell = SimulatedCell(loop, 5, Scene("holder"), tmp_path / "cell")
    out = tmp_path / "out"

    async def once(number: int) -> StepRecord:
        order = CommissionOrder(cell.cell_path, CommissioningFolder(out), "a tester")
        found: list[CommissioningSession] = []
        hands = Hands(cell, lambda what: then(found[0], what) if number == 0 else None)
        session = CommissioningSession(
            order,
            {},
            FoundClock(monotonic=loop.time, beat_wall_s=BEAT_S),
            hands,
            hands,  # type: ignore[arg-type]  (it has no control port)
            lambda line: None,
            cell.controller()._devices,
        )
        found.append(session)
        process = SimulatedProcess(f"session {number}")
        (record,) = await loop.spawn(process, session.run(("trays",), lambda record: None))
        return record

    async def all_of_it() -> StepRecord:
        async with cell:
            world = cell.cell.world
            trays = tuple(
                replace(one, centre_mm=one.centre_mm + MOVED_MM) for one in world.layout.trays
            )
            world.layout = replace(world.layout, trays=trays)
            for number in range(times):
                record = await once(number)
            return record

    try:
        return loop.run_until_complete(all_of_it()), out
    finally:
        cell.close()
        loop.bury()
        loop.close()


def test_trays_beside_their_marks_are_found_and_used(tmp_path: Path) -> None:
    record, out = run(tmp_path, lambda session, order: None)
    assert (record.outcome, record.message) == (StepEnd.PASSED, "")
    cell = load_cell(out / "cell.yaml")
    # a hand is up to 0.5 mm off along each axis, rounding of joints less
    np.testing.assert_allclose(cell.trays.accept.centre, ACCEPT + MOVED_MM, atol=0.7)
    assert any("obstacles, as drawn" in text for text in record.findings)
    heights = [one for one in record.figures if one.name == "table: its height in the drop area"]
    assert len(heights) == 1


def test_another_corner_than_the_one_named_is_noticed(tmp_path: Path) -> None:
    def beside(session: CommissioningSession, order: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the place at hand instead: straight down, wherever the corner is."""
        near = np.array(order["corner"]) if "corner" in order else np.zeros(2)
        return {**order, "corner": [int(near[0]), int(-near[1])]} if "corner" in order else order

    record, out = run(tmp_path, beside)
    assert record.outcome is StepEnd.FAILED
    assert "it was another corner, or the tray stands elsewhere" in record.message
    assert not (out / "calibrations" / "trays.json").exists()


@pytest.mark.slow
def test_a_stop_half_way_keeps_what_was_found_and_the_next_start_goes_on(tmp_path: Path) -> None:
    seen: list[str] = []

    def half_way(session: CommissioningSession, order: Mapping[str, Any]) -> None:
        seen.append(order["do"])
        if len(seen) == 3:
            session.request_stop("Ctrl-C", "stop")

    record, out = run(tmp_path, half_way, times=2)
    assert record.outcome is StepEnd.PASSED
    kept = sorted(out.glob("evidence/*-trays*/record.json"))
    assert len(kept) == 2
    first = StepRecord.model_validate_json(kept[0].read_text())
    assert first.outcome is StepEnd.BROKEN_OFF
    assert "Ctrl-C" in first.message
    assert any(one.name.startswith("tray accept") for one in first.figures)
