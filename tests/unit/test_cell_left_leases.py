"""`cellctl recover` finds the leases that a killed controller left in the cell's journal."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from controller.cell.custody.releasing import ReleaseVisit
from controller.cell.devices import Devices, resolve
from controller.cell.devices.clocks import FoundClock
from controller.cell.journal import JOURNAL_NAME, Journal, read_row, read_rows, rows
from controller.config import Cell, load_cell
from drivers.kinds import JawReading, Signal

CELL = Path(__file__).parents[2] / "recipes" / "cells" / "emulated.yaml"


def cell_at(folder: Path, name: str, host: str) -> Cell:
    """Return a cell whose devices stand at addresses of their own, under ``host``."""
    text = CELL.read_text()
    for old, new in (
        ("arm:         {address: emulated}", f"arm:         {{address: /dev/{host}}}"),
        ("{address: emulated, transport: tcp, unit: 9}", f"{{address: '{host}:502'}}"),
        (
            "{address: emulated, transport: tcp, analog_unit: 1, relay_unit: 2}",
            f"{{address: '{host}:503'}}",
        ),
        ("{address: emulated, transport: tcp, unit: 1}", f"{{address: '{host}:504'}}"),
        ("overhead:    {address: emulated}", "overhead:    {address: /dev/video0}"),
        ("inspection:  {address: emulated}", "inspection:  {address: /dev/video1}"),
    ):
        assert old in text
        text = text.replace(old, new)
    path = folder / f"{name}.yaml"
    path.write_text(text)
    return load_cell(path).model_copy(update={"name": name})


@pytest.fixture(autouse=True)
def at_rest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Give each visit grippers that stand open, and a folder for state of its own."""

    async def connect() -> dict[str, str]:
        return {}

    async def close() -> None:
        return None

    async def status() -> Any:
        return SimpleNamespace(
            opening_mm=85.0, is_activated=True, has_contact=False, has_arrived=True
        )

    devices = SimpleNamespace(
        connect_grippers=connect,
        aclose=close,
        jaws_found=JawReading(is_pressing=True, opening_mm=0.0),
        arm=SimpleNamespace(identity=SimpleNamespace(was_restarted=False), max_opening_mm=90.0),
        gripper=SimpleNamespace(status=status, max_opening_mm=85.0),
        io=SimpleNamespace(signal=lambda name: Signal.NOT_OK),
    )
    monkeypatch.setattr(Devices, "build", lambda *_: devices)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


def killed(runs: Path, run: str, cell: Cell) -> Journal:
    """Return the journal of a run that has begun, and whose controller is about to die."""
    journal = Journal(runs / JOURNAL_NAME, run)
    journal.write(rows.RunBegan(cell={"name": cell.name}, devices=resolve(cell, {})))
    return journal


async def left(cell: Cell, runs: Path) -> list[tuple[str, tuple[str, ...], str]]:
    async with ReleaseVisit(cell, FoundClock(), runs) as visit:
        standing = await visit.look()
    return [(one.by, one.resources, one.run) for one in standing.leases]


async def test_a_visit_names_what_the_killed_run_had(tmp_path: Path) -> None:
    cell = cell_at(tmp_path, "north", "10.0.0.1")
    journal = killed(tmp_path, "first", cell)
    journal.write(rows.LeaseTaken(by="acquire", resources=("table",)))
    journal.write(rows.LeaseReturned(by="acquire", resources=("table",)))
    journal.write(rows.LeaseTaken(by="grasp", resources=("table", "arm")), 1)
    journal.close()
    assert await left(cell, tmp_path) == [("grasp", ("table", "arm"), "first")]


async def test_a_visit_names_nothing_of_a_run_that_gave_all_back(tmp_path: Path) -> None:
    cell = cell_at(tmp_path, "north", "10.0.0.1")
    for run in ("first", "second"):
        journal = killed(tmp_path, run, cell)
        journal.write(rows.LeaseTaken(by="grasp", resources=("arm",)))
        if run == "second":
            journal.write(rows.LeaseReturned(by="grasp", resources=("arm",)))
        journal.close()
    assert await left(cell, tmp_path) == []


async def test_what_another_cell_has_in_the_same_journal_is_not_left(tmp_path: Path) -> None:
    north = cell_at(tmp_path, "north", "10.0.0.1")
    south = cell_at(tmp_path, "south", "10.0.0.2")
    for run, cell in (("first", north), ("second", south)):
        journal = killed(tmp_path, run, cell)
        journal.write(rows.LeaseTaken(by=f"grasp of {run}", resources=("arm",)))
        journal.close()
    assert await left(north, tmp_path) == [("grasp of first", ("arm",), "first")]


async def test_leases_of_a_journal_that_had_them_as_decisions_are_found(tmp_path: Path) -> None:
    cell = cell_at(tmp_path, "north", "10.0.0.1")
    journal = killed(tmp_path, "first", cell)
    for name, by in (
        ("lease_taken", "acquire"), ("lease_returned", "acquire"), ("lease_taken", "grasp"),
    ):  # fmt: skip
        journal.record("decision", name, {"by": by, "resources": ["arm"]})
    journal.record("decision", "plan_kept", {"reason": "no lease"})
    journal.close()
    assert await left(cell, tmp_path) == [("grasp", ("arm",), "first")]
    found = [
        row for row in read_rows(tmp_path / JOURNAL_NAME, "first") if row.name == "lease_taken"
    ]
    first = read_row(found[0].kind, found[0].name, found[0].body)
    assert first == rows.LeaseTaken(by="acquire", resources=("arm",))
