"""One step of commissioning in the cell: connect, check, run, come to rest in any case.

A visit has the same parts as a run: journal, custody, latch, interlocks, watchers, permit, and
stops that come before tasks are ended. Each visit connects anew and leaves the cell halted and
dark, so that continuing after any end is the same as going from one step to the next.
"""

import asyncio
import logging
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from controller.cell.batch import (
    ArmWatcher,
    DiskWatcher,
    InterlockWatcher,
    ModbusWatcher,
    MotorSupplyWatcher,
)
from controller.cell.custody import CellIdentity, fold_custody
from controller.cell.custody.known_journals import (
    after_known,
    note_journal,
    open_noted_journal,
    rows_of_all_journals,
)
from controller.cell.custody.openings import presses_on_something, read_openings
from controller.cell.custody.start_check import require_empty_grippers
from controller.cell.devices import Devices, resolve
from controller.cell.devices.clocks import FoundClock
from controller.cell.devices.in_use import counted
from controller.cell.devices.interlocks import rules_of
from controller.cell.devices.stopping import Stopping
from controller.cell.devices.supervision import CallerPrograms, Supervised
from controller.cell.errors import CellError, InterlockError
from controller.cell.journal import JOURNAL_NAME, Journal, JournalError, rows
from controller.cell.machine import Event
from controller.cell.operator import Journaled, Operator, require_acknowledged
from controller.cell.services import (
    Approval,
    CameraName,
    Gate,
    Imaging,
    Interlocks,
    Motion,
    Permits,
    Retries,
    fault_policy,
)
from controller.cell.services.records import BatchRecord, RunProgress
from controller.config import Cell
from controller.config.calibration_reference import CalibrationName
from controller.config.calibrations import Calibration
from controller.setup.layout import build_layout
from controller.setup.software import software_versions
from drivers.clock import CellClock
from drivers.errors import DeviceError
from drivers.kinds import Arm, Camera, Stop
from messages import joined, say

from .bench import Bench, HandedOver
from .errors import DeclinedError, NobodyThereError
from .evidence import StepEvidence
from .person import EmulatedPerson, Person
from .procedure import StepEnd, StepRecord, worst_of
from .steps import CommissioningStep

log = logging.getLogger(__name__)

Build = Callable[[Cell, Mapping[str, dict[str, Any]], CellClock], Devices]
CAMERAS: Final[tuple[CameraName, ...]] = ("overhead", "inspection")
# Ends that are nobody's fault: the step was not finished and may be begun again.
_BROKEN_OFF: Final = (DeclinedError, NobodyThereError, InterlockError, JournalError)


@dataclass(frozen=True, slots=True, kw_only=True)
class VisitOrder:
    """The order of one visit.

    Attributes
    ----------
    step : step to run
    recipe : recipe for the journal, its name at least
    cell : as commissioned so far
    digest : digest of what the nominal cell file describes
    emulated : report of the emulator about itself; empty without one
    clock : clock of the cell, as it was found
    folder : folder of the commissioning; the journal stands in it
    run_id : run id of this visit
    by : name of the person who commissions
    based_on : hashes of the calibrations that the step uses
    files : SHA-256 of what was read, by path
    is_dry : only motions, for a part that is not there
    is_stepwise : a person lets each motion begin
    recipes : files of those that the cell is to run
    """

    step: CommissioningStep
    recipe: Mapping[str, Any]
    cell: Cell
    digest: str
    emulated: Mapping[str, Any]
    clock: FoundClock
    folder: Path
    run_id: str
    by: str
    based_on: Mapping[CalibrationName, str]
    files: Mapping[str, str] = field(default_factory=dict)
    is_dry: bool = False
    is_stepwise: bool = False
    recipes: tuple[Path, ...] = ()


class StepVisit:
    """One step in the cell.

    Parameters
    ----------
    order : order to run
    operator : answers for a person
    helper : helper with errands in an emulated cell; None if a person does them
    evidence : keeps what is found
    build : function that builds the drivers from cell, addresses and clock
    callers : callers whose stop orders the supervisor takes while the event loop is late
    """

    def __init__(
        self,
        order: VisitOrder,
        operator: Operator,
        helper: EmulatedPerson | None,
        evidence: StepEvidence,
        build: Build = Devices.build,
        callers: CallerPrograms | None = None,
    ) -> None:
        self._build = build
        self._callers = callers
        self._order = order
        self._operator = operator
        self._helper = helper
        self._evidence = evidence
        self._why = ""
        self._code = ""
        self._stopped = asyncio.Event()
        self._made: Mapping[CalibrationName, Calibration] = {}

    def stop(self, why: str, code: str) -> None:
        """Have the step stop: metal first, then its task. The first reason counts.

        Parameters
        ----------
        why : a sentence for people
        code : stable short name
        """
        if not self._stopped.is_set():
            self._why, self._code = why, code
            self._stopped.set()

    @property
    def made(self) -> Mapping[CalibrationName, Calibration]:
        """The calibrations that the step found; empty unless it passed."""
        return self._made

    async def run(self) -> StepRecord:
        """Run the step and return its record, however it ended.

        Raises
        ------
        BaseException : a bug; the cell was halted
        """
        began = datetime.now(UTC)
        outcome, message = StepEnd.PASSED, ""
        try:
            self._made = await self._in_the_cell()
        except _BROKEN_OFF as error:
            outcome, message = StepEnd.BROKEN_OFF, str(error)
        except (CellError, DeviceError) as error:
            outcome, message = StepEnd.FAILED, str(error)
        else:
            over = worst_of(self._evidence.figures)
            if over:
                outcome, message = StepEnd.FAILED, joined("; ", (figure.words for figure in over))
                self._made = {}
        order, evidence = self._order, self._evidence
        return StepRecord(
            step=order.step.name,
            outcome=outcome,
            message=message,
            began=began,
            ended=datetime.now(UTC),
            by=order.by,
            software=f"cellctl {software_versions()['cellctl']}",
            cell=order.cell.name,
            cell_digest=order.digest,
            emulated=tuple(sorted(self._emulated)),
            evidence=str(evidence.folder.relative_to(order.folder)),
            based_on=dict(order.based_on),
            figures=tuple(evidence.figures),
            findings=tuple(evidence.findings),
            pictures=tuple(evidence.pictures),
            answers=tuple(evidence.answers),
        )

    @property
    def _emulated(self) -> frozenset[str]:
        cell = self._order.cell
        names = type(cell.devices).model_fields
        is_all = self._order.clock.path is not None
        return frozenset(names if is_all else cell.emulated_devices)

    # ---- in the cell -----------------------------------------------------------------------------
    async def _in_the_cell(self) -> Mapping[CalibrationName, Calibration]:
        order = self._order
        where = resolve(order.cell, order.emulated.get("devices", {}))
        began = await asyncio.to_thread(after_known, self._began(where))
        opened = await asyncio.to_thread(
            open_noted_journal, order.folder / JOURNAL_NAME, order.run_id, began
        )
        journal = opened.journal
        loop = asyncio.get_running_loop()

        def stop(error: JournalError) -> None:
            loop.call_soon_threadsafe(self.stop, str(error), "journal")

        journal.on_failure = stop
        if not order.clock.is_virtual:
            journal.write_behind()
        if opened.notice:
            self._evidence.find(opened.notice)
        try:
            await journal.write_secured(began)
            note_journal(journal, began)
            try:
                made = await self._connected(journal, began, where)
            except BaseException as error:
                with suppress(JournalError):
                    journal.write(
                        rows.RunBrokeOff(error=str(error) or type(error).__name__, where="")
                    )
                raise
            journal.write(rows.AtRest(state="complete", where="No part was at hand."))
            journal.write(rows.RunEnded(end="complete"))
            return made
        finally:
            journal.on_failure = None
            if unwritten := await asyncio.to_thread(journal.close):
                self._evidence.find(f"{unwritten} rows could not be written to {journal.path}")

    def _began(self, where: Mapping[str, dict[str, Any]]) -> rows.RunBegan:
        order = self._order
        return rows.RunBegan(
            recipe=dict(order.recipe),
            files=dict(order.files),
            cell=order.cell.model_dump(mode="json", by_alias=True),
            devices=where,
            emulated_devices=tuple(sorted(self._emulated)),
            emulator={k: v for k, v in order.emulated.items() if k != "devices"},
            clock=None if order.clock.path is None else str(order.clock.path),
            speed=order.clock.speed,
            count=0,
            software=software_versions(),
            operator=order.by,
            **({"is_dry": True} if order.is_dry else {}),
        )

    async def _connected(
        self, journal: Journal, began: rows.RunBegan, where: Mapping[str, dict[str, Any]]
    ) -> Mapping[CalibrationName, Calibration]:
        order = self._order
        operator = Journaled(self._operator, journal)
        known = fold_custody(rows_of_all_journals(journal.path, began), CellIdentity.of(began))
        latch = await require_acknowledged(journal, order.cell.name, operator)
        if latch is not None:
            raise InterlockError(latch.words, latch.code)
        clock = order.clock.open()
        try:
            devices = self._build(order.cell, where, clock)
            async with clock.attending():
                try:
                    journal.write(rows.Connected(await devices.connect()))
                    await require_empty_grippers(
                        known,
                        await read_openings(devices),
                        journal,
                        lambda: presses_on_something(devices),
                        is_part_removed=False,
                    )
                    return await self._supervised(journal, operator, devices, clock)
                finally:
                    await devices.aclose()
        finally:
            clock.close()

    async def _supervised(
        self, journal: Journal, operator: Operator, devices: Devices, clock: CellClock
    ) -> Mapping[CalibrationName, Calibration]:
        """Run the step while a supervisor stops the cell if the event loop cannot."""
        if self._order.clock.is_virtual:
            return await self._watched(journal, operator, devices, clock)
        shared = self._order.clock.path
        supervised = Supervised(
            devices,
            clock,
            "" if shared is None else str(shared),
            lambda: True,
            lambda why: self.stop(why, "supervised"),
            self._callers,
        )
        async with supervised.beating():
            for name in supervised.unreached:
                self._evidence.find(say("{name}: the supervisor cannot reach it", name=name))
            return await self._watched(journal, operator, devices, clock)

    async def _watched(
        self, journal: Journal, operator: Operator, devices: Devices, clock: CellClock
    ) -> Mapping[CalibrationName, Calibration]:
        """Run the step beside the watchers; stop metal first when anything ends it early."""
        order = self._order
        arm, in_use = counted(devices.arm, clock)
        stopping = Stopping(
            arm, devices.gripper, devices.lights, clock, order.cell.detection.stop_confirm_s
        )
        bench, gate, interlocks, retries = self._bench(journal, operator, devices, arm, clock)
        beat_s = order.cell.detection.device_beat_s
        watchers = (
            InterlockWatcher(devices.io, interlocks),
            MotorSupplyWatcher(devices.io),
            DiskWatcher(order.folder, clock),
            ModbusWatcher(devices.gripper, devices.lights, retries, beat_s, clock),
            ArmWatcher(arm, in_use, order.cell.detection.arm_beat_s, clock),
        )

        def report(event: Event, message: str = "", code: str = "") -> None:
            if event is not Event.ACKNOWLEDGE:  # a visit that ended does not go on
                self.stop(message, code)

        step = asyncio.create_task(order.step.run(bench), name=order.step.name)
        beside = [asyncio.create_task(one.run(report)) for one in watchers]
        stopped = asyncio.create_task(self._stopped.wait())
        try:
            await asyncio.wait({step, stopped}, return_when=asyncio.FIRST_COMPLETED)
            if self._stopped.is_set():
                await self._halt(journal, gate, stopping)
                raise InterlockError(self._why, self._code)
            return await step
        finally:
            gate.permits.withdraw("end of step")
            for task in (step, stopped, *beside):
                task.cancel()
            await asyncio.gather(step, stopped, *beside, return_exceptions=True)
            for name, error in (await stopping.stop_all(Stop.RAMP)).items():
                log.warning("%s did not confirm the stop: %s", name, error)

    async def _halt(self, journal: Journal, gate: Gate, stopping: Stopping) -> None:
        gate.permits.withdraw(self._code or "stop")
        await stopping.stop_all(Stop.DEAD)
        with suppress(JournalError):
            row = {"from": "commissioning", "to": "stopped"}
            journal.write(
                rows.CellEvent(
                    name=Event.FAULT.value,
                    answer="taken",
                    message=self._why,
                    code=self._code,
                    **row,
                )
            )

    def _bench(
        self,
        journal: Journal,
        operator: Operator,
        devices: Devices,
        arm: Arm,
        clock: CellClock,
    ) -> tuple[Bench, Gate, Interlocks, Retries]:
        order = self._order
        cell = order.cell
        layout, handed = build_layout(cell), HandedOver()
        record = BatchRecord(journal, RunProgress(), lambda: None)
        policy = fault_policy(cell.faults)
        retries = Retries(record, lambda: policy, clock)
        gate = Gate(Permits(journal), clock, Approval(operator) if order.is_stepwise else None)
        interlocks = Interlocks(
            devices.io,
            devices.gripper,
            layout,
            lambda: handed.custody,
            retries,
            rules_of(cell.interlock_rules),
        )
        cameras: dict[CameraName, Camera] = {
            "overhead": devices.overhead,
            "inspection": devices.inspection,
        }
        quick = frozenset(n for n in CAMERAS if getattr(cell.cameras, n).settle_frames == 0)
        bench = Bench(
            cell=cell,
            layout=layout,
            devices=devices,
            arm=arm,
            clock=clock,
            motion=Motion(arm, interlocks, clock, gate, layout, record.note, record.note_secured),
            imaging=Imaging(devices.lights, cameras, quick, self._evidence.folder, retries=retries),
            gate=gate,
            interlocks=interlocks,
            person=Person(operator, self._evidence, self._helper),
            evidence=self._evidence,
            emulated=self._emulated,
            by=order.by,
            based_on=dict(order.based_on),
            note=record.note,
            recipes=order.recipes,
            handed=handed,
        )
        return bench, gate, interlocks, retries
