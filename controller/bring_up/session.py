"""Runs the steps of a commissioning in order, and keeps the result of each."""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from controller.cell.devices import Devices
from controller.cell.devices.clocks import FoundClock
from controller.cell.devices.supervision import CallerPrograms
from controller.cell.operator import Operator
from controller.config import Cell, ConfigError, load_yaml
from controller.config.calibration_reference import CalibrationName

from .evidence import StepEvidence
from .person import EmulatedPerson
from .procedure import (
    CommissioningFolder,
    StepEnd,
    StepRecord,
    StepStanding,
    StepStatus,
    cell_digest,
    standings,
)
from .steps import STEPS, CommissioningStep, step_plans
from .visit import Build, StepVisit, VisitOrder

STEP_NAMES: Final = tuple(step.name for step in STEPS)


@dataclass(frozen=True, slots=True)
class CommissionOrder:
    """The order of a commissioning.

    Attributes
    ----------
    cell_path : the nominal cell file
    folder : folder of the commissioning
    by : name of the person who commissions
    recipes : files of those that the cell is to run
    """

    cell_path: Path
    folder: CommissioningFolder
    by: str
    recipes: tuple[Path, ...] = ()

    def nominal(self) -> Cell:
        """Return the cell as drawn, without calibrations.

        Raises
        ------
        ConfigError : the cell file is wrong
        """
        return load_yaml(self.cell_path, Cell).read_from(self.cell_path)

    def standings(self, now: datetime) -> tuple[StepStanding, ...]:
        """Return the state of each step.

        Raises
        ------
        ConfigError : the cell file or a record is wrong
        """
        return standings(
            step_plans(),
            self.folder.read_records(STEP_NAMES),
            now,
            cell_digest(self.nominal()),
            self.hashes(),
        )

    def hashes(self) -> dict[CalibrationName, str]:
        """Return the hash of each calibration that there is."""
        return {name: one.sha256 for name, one in self.folder.references().items()}


class CommissioningSession:
    """A commissioning under way; anything that would end it stops it instead.

    Parameters
    ----------
    order : order to commission
    emulated : report of the emulator about itself; empty without one
    clock : clock of the cell
    operator : answers for a person
    helper : helper with errands in an emulated cell; None if a person does them
    show : printer of a line for the spectators
    build : function that builds the drivers from cell, addresses and clock
    callers : callers whose stop orders the supervisor takes while the event loop is late
    """

    def __init__(
        self,
        order: CommissionOrder,
        emulated: Mapping[str, Any],
        clock: FoundClock,
        operator: Operator,
        helper: EmulatedPerson | None,
        show: Callable[[str], None],
        build: Build = Devices.build,
        callers: CallerPrograms | None = None,
    ) -> None:
        self._callers = callers
        self._order = order
        self._emulated = emulated
        self._clock = clock
        self._operator = operator
        self._helper = helper
        self._show = show
        self._build = build
        self._visit: StepVisit | None = None
        self._end: tuple[str, str] | None = None

    def request_stop(self, message: str, code: str) -> None:
        """Stop the step at hand; none begins after it."""
        self._end = self._end or (message, code)
        if self._visit is not None:
            self._visit.stop(message, code)

    def request_abort(self, message: str, code: str) -> None:
        """Stop as `request_stop` does; a step has no part to put away."""
        self.request_stop(message, code)

    async def run(
        self, steps: Sequence[str], on_step: Callable[[StepRecord], None]
    ) -> tuple[StepRecord, ...]:
        """Run steps until one does not pass; return their records.

        Parameters
        ----------
        steps : their names, in order
        on_step : called with each record once it is kept

        Raises
        ------
        ConfigError : a file is wrong or cannot be written
        """
        by_name = {step.name: step for step in STEPS}
        done: list[StepRecord] = []
        for name in steps:
            if self._end is not None:
                break
            record = await self._run_step(by_name[name])
            done.append(record)
            on_step(record)
            if record.outcome is not StepEnd.PASSED:
                break
        return tuple(done)

    async def _run_step(self, step: CommissioningStep) -> StepRecord:
        order = self._order
        nominal = order.nominal()
        cell = await asyncio.to_thread(order.folder.load_for, order.cell_path, step.makes)
        now = datetime.now(UTC)
        place = order.folder.begin_evidence(step.name, now)
        hashes = order.hashes()
        visit = StepVisit(
            VisitOrder(
                step=step,
                recipe={"name": f"commission {step.name}"},
                cell=cell,
                digest=cell_digest(nominal),
                emulated=self._emulated,
                clock=self._clock,
                folder=order.folder.path,
                run_id=place.name,
                by=order.by,
                based_on={name: hashes[name] for name in step.uses if name in hashes},
                recipes=order.recipes,
            ),
            self._operator,
            self._helper,
            StepEvidence(place, self._show),
            self._build,
            self._callers,
        )
        self._visit = visit
        self._show(f"step {step.name}: {step.title}")
        try:
            record = await visit.run()
        finally:
            self._visit = None
        if record.outcome is StepEnd.PASSED:
            made = order.folder.keep(order.cell_path, visit.made)
            record = record.model_copy(update={"made": made})
        order.folder.write_record(record)
        return record


def due(standings: Sequence[StepStanding], only: str | None) -> tuple[str, ...]:
    """Return the steps to run.

    Parameters
    ----------
    standings : standings of all steps, in order
    only : a step to repeat; None for all that are not done

    Raises
    ------
    ConfigError : no such step, or one that it needs is not done
    """
    if only is None:
        return tuple(one.step for one in standings if one.status is not StepStatus.DONE)
    by_name = {step.name: step for step in STEPS}
    if only not in by_name:
        raise ConfigError(f"--step {only:.40}: the steps are {', '.join(by_name)}")
    status = {one.step: one for one in standings}
    for need in by_name[only].needs:
        if status[need].status is not StepStatus.DONE:
            raise ConfigError(
                f"--step {only}: it needs `{need}`, which is {status[need].status.value} "
                f"({status[need].reason}); leave --step out, or run {need} first"
            )
    return (only,)
