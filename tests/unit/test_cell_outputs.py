"""24 V signals of a run: what is told when, and that no part is ever told wrongly."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from itertools import groupby
from typing import cast

import numpy as np
import pytest

from controller.cell.batch.outputs import (
    ASKS,
    AT_REST,
    FAULTS,
    LOOKS,
    PlcSignals,
    result_of,
    signals_of,
)
from controller.cell.journal import Journal
from controller.cell.machine.table import STAGES
from controller.cell.machine.table import STATES as MACHINE_STATES
from controller.cell.services.records import BatchRecord, PartRecord, RunProgress
from drivers.clock import CellClock
from drivers.errors import LinkError
from drivers.kinds import SignalOutputs

ALL = ("ready", "busy", "held", "fault", "accept", "reject", "result_valid")
STATES = (
    *("idle", "acquiring", "recognising", "planning", "presenting", "placing", "completing"),
    *("suspended_acquiring", "held", "aborting", "stopping", "stopped", "complete"),
)
TRAYS = ("accept", "reject", "quarantine", None)


class Block:
    """Outputs that remember each writing; some of them fail, done or not."""

    def __init__(self, failing: frozenset[int] = frozenset()) -> None:
        self.on = dict.fromkeys(ALL, False)
        self.seen: list[dict[str, bool]] = []
        self._failing = failing
        self._count = 0
        self._written = asyncio.Event()

    async def set_outputs(self, outputs: Mapping[str, bool]) -> None:
        self._count += 1
        for number, (name, is_on) in enumerate(outputs.items()):
            if self._count in self._failing and number > self._count % 3:
                raise LinkError("the block is silent")
            if self.on[name] != is_on:
                self.on[name] = is_on
                self.seen.append(dict(self.on))
        self._written.set()
        self._written = asyncio.Event()

    async def written(self) -> None:
        """Wait for the next writing."""
        await self._written.wait()


class Run:
    """A run that a test leads through its states."""

    def __init__(self, block: Block, wired: tuple[str, ...] = ALL) -> None:
        self.record = BatchRecord(cast(Journal, None), RunProgress(), lambda: self.signals.note())
        outputs: SignalOutputs = block
        self.clock = CellClock(1000.0)
        self.signals = PlcSignals(outputs, wired, self.record, self.clock)

    def done(self, tray: str | None) -> None:
        self.record.part = PartRecord(number=self.record.part.number + 1, tray=tray)
        self.record._finished.append(self.record.part)
        self.record.show_state("completing")

    async def until(self, state: str, block: Block, **wanted: bool) -> None:
        self.record.show_state(state)
        async with asyncio.timeout(10.0):
            while {name: block.on[name] for name in wanted} != wanted:
                await block.written()


def test_the_signals_of_each_state() -> None:
    told = {state: {n for n, on in signals_of(state, None).items() if on} for state in STATES}
    assert told == {
        **{state: {"ready"} for state in ("idle", "acquiring", "recognising")},
        **{state: {"busy"} for state in ("planning", "presenting", "placing", "completing")},
        **{state: {"busy"} for state in ("suspended_acquiring", "stopping")},
        "held": {"busy", "held"},
        "aborting": {"fault"},
        "stopped": set(),
        "complete": set(),
    }


def test_a_result_stands_until_another_part_is_worked_on_or_a_fault_comes() -> None:
    done, other = PartRecord(1, tray="accept"), PartRecord(2)
    assert result_of("completing", done, done) is done
    assert result_of("acquiring", other, done) is done
    assert result_of("suspended_recognising", other, done) is done
    assert result_of("planning", other, done) is None
    assert result_of("aborting", done, done) is None
    assert result_of("acquiring", other, None) is None
    assert result_of("acquiring", other, PartRecord(1)) is None  # a person took it out


@pytest.mark.parametrize("tray", ["accept", "reject", "quarantine"])
async def test_the_tray_is_on_before_its_result_is_valid_and_after_it(tray: str) -> None:
    block = Block()
    run = Run(block)
    async with run.signals.told():
        await run.until("acquiring", block, ready=True)
        await run.until("placing", block, busy=True)
        run.done(tray)
        await run.until("completing", block, result_valid=True)
        run.record.part = PartRecord(9)
        await run.until("planning", block, result_valid=False, accept=False, reject=False)
    valid = [one for one in block.seen if one["result_valid"]]
    assert {(one["accept"], one["reject"]) for one in valid} == {
        (tray == "accept", tray == "reject")
    }
    rose = block.seen.index(valid[0])
    fell = rose + len(valid)
    for beside in (block.seen[rose - 1], block.seen[fell]):
        assert (beside["accept"], beside["reject"]) == (tray == "accept", tray == "reject")
    assert not any(block.on.values())


async def test_the_last_result_stands_its_time_though_the_run_ends() -> None:
    block = Block()
    run = Run(block)
    async with run.signals.told():
        run.done("accept")
        run.record.show_state("complete")
    assert any(one["result_valid"] and one["accept"] for one in block.seen)
    assert not any(block.on.values())


async def test_an_error_of_the_run_leaves_no_output_on() -> None:
    block = Block()
    run = Run(block)

    async def broken() -> None:
        async with run.signals.told():
            run.done("accept")
            await run.until("completing", block, accept=True, result_valid=True)
            raise RuntimeError("a bug")

    with pytest.raises(RuntimeError):
        await broken()
    assert not any(block.on.values())


async def test_a_cell_without_outputs_writes_none() -> None:
    block = Block()
    run = Run(block, ())
    async with run.signals.told():
        run.done("accept")
    assert block.seen == []


@pytest.mark.parametrize("seed", range(12))
async def test_whatever_a_run_does_each_part_is_told_once_at_most_and_never_wrongly(
    seed: int,
) -> None:
    rng = np.random.default_rng(seed)
    failing = frozenset(rng.integers(1, 200, 40 if seed % 2 else 0).tolist())
    block = Block(failing)
    run = Run(block)
    finished: list[str] = []
    async with run.signals.told():
        for _ in range(60):
            if rng.random() < 0.2:
                tray = TRAYS[rng.integers(len(TRAYS))]
                run.done(tray)
                finished += [] if tray is None else [tray]
            else:
                if rng.random() < 0.5:
                    run.record.part = PartRecord(run.record.part.number + 1)
                run.record.show_state(STATES[rng.integers(len(STATES))])
            async with asyncio.timeout(10.0):
                await run.clock.sleep(float(rng.choice([0.0, 0.1, 1.0])))
    assert not any(block.on.values()) or failing  # else the block's watchdog opens them
    assert not any(one["accept"] and one["reject"] for one in block.seen)
    told = told_in(block.seen)
    assert told
    left = iter(finished)
    assert all(tray in left for tray in told), (told, finished)  # in order, each once at most


def told_in(seen: list[dict[str, bool]]) -> list[str]:
    """Return the tray of each stretch in which a result is valid; it is one tray throughout."""
    stretches = groupby(seen, lambda one: one["result_valid"])
    told = [{tray_in(one) for one in stretch} for is_valid, stretch in stretches if is_valid]
    assert all(len(trays) == 1 for trays in told), told
    return [tray for (tray,) in told]


def tray_in(signals: dict[str, bool]) -> str:
    return next((name for name in ("accept", "reject") if signals[name]), "quarantine")


async def test_a_part_that_is_looked_for_again_does_not_bring_the_last_result_back() -> None:
    block = Block()
    run = Run(block)
    async with run.signals.told():
        run.done("accept")
        await run.until("completing", block, result_valid=True)
        run.record.part = PartRecord(9)
        await run.until("planning", block, result_valid=False, busy=True)
        await run.until("acquiring", block, ready=True)
    assert told_in(block.seen) == ["accept"]


def test_the_states_named_are_the_machines() -> None:
    assert set(MACHINE_STATES) >= FAULTS | AT_REST | ASKS
    assert LOOKS - set(STAGES) <= set(MACHINE_STATES)
