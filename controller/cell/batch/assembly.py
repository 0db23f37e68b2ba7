"""Puts a cell together for one batch: services, the action of each effect, the dispatcher."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from controller.config import Cell, Recipe
from controller.config.interlock_rules import SIGNALS
from controller.config.view_set import SetCalibration
from controller.planning.model import CellLayout
from drivers.clock import CellClock
from drivers.kinds import Camera, Signal, SignalOutputs

from ..actions import (
    AbortMotionAction,
    AcquireAction,
    Action,
    Actions,
    ClearFaultAction,
    CompleteAction,
    ConsultAction,
    GraspAction,
    HandOffAction,
    HoldAction,
    HomeAction,
    InspectAction,
    PlaceAction,
    PlanAction,
    PresentAction,
    ReadyAction,
    RecogniseAction,
    RecoverAction,
    ResetAction,
    SetDownAction,
    StopMotionAction,
    SuspendAction,
    UnsuspendAction,
    WithdrawAction,
)
from ..compute import Compute, PartCompute
from ..custody import TrayRecord
from ..devices import Devices
from ..devices.in_use import counted
from ..devices.interlocks import rules_of
from ..devices.stopping import Stopping
from ..journal import Journal
from ..journal.rows import CellEvent, StoredFields
from ..machine import Budgets, Effect
from ..operator import NOBODY, Operator
from ..services import (
    Approval,
    Background,
    CameraName,
    Codes,
    Disambiguation,
    Gate,
    Grippers,
    HeldPose,
    Imaging,
    Interlocks,
    JudgingAhead,
    Leases,
    Motion,
    PartFileWriter,
    Permits,
    PlanSteps,
    Preparation,
    Recoveries,
    Resumption,
    Retries,
    Standstill,
    StoredViews,
    Views,
    fault_policy,
    faults_section,
)
from ..services.records import BatchProduct, BatchRecord, RunProgress
from ..services.table import NO_NUMBERS, LabelOrder, Labels, Taking
from .dispatcher import Dispatcher
from .outputs import PlcSignals
from .watching import (
    ArmWatcher,
    DiskWatcher,
    FixedGripperWatcher,
    InterlockWatcher,
    LoopWatcher,
    ModbusWatcher,
    MotorSupplyWatcher,
)

CAMERAS: tuple[CameraName, ...] = ("overhead", "inspection")


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """A cell that is ready for one batch.

    Attributes
    ----------
    record : the part at hand and those done
    motion : the arm
    gate : gate that every motion passes
    actions : one for each effect of the table
    dispatcher : runs the batch
    resumption : whether it begins with the part of an interrupted run
    taking : choice of the next part; its plan ahead is dropped at the end
    ahead : judges the part at hand ahead; dropped at the end
    signals : tells a PLC at 24 V what the run does
    """

    record: BatchRecord
    motion: Motion
    gate: Gate
    actions: Actions
    dispatcher: Dispatcher
    resumption: Resumption
    taking: Taking
    ahead: JudgingAhead
    signals: PlcSignals


def product_of(
    compute: Compute,
    recipe: Recipe,
    cell: Cell,
    count: int = 1,
    number: int = 0,
    ahead: Compute | None = None,
) -> BatchProduct:
    """Return a product of a batch.

    Parameters
    ----------
    compute : the compute service of the recipe
    recipe, cell : as read from their files
    count : parts that were ordered
    number : number of the recipe in the order, from 0
    ahead : the same service by a worker process that nothing waits for; None for none
    """
    faults = faults_section(cell, recipe)
    budgets = Budgets(faults.demote_after, faults.window)
    return BatchProduct(number, recipe, count, compute, fault_policy(faults), budgets, ahead)


def assemble(
    products: Sequence[BatchProduct],
    cell: Cell,
    layout: CellLayout,
    devices: Devices,
    clock: CellClock,
    journal: Journal,
    folder: Path,
    progress: RunProgress,
    on_progress: Callable[[], None],
    operator: Operator = NOBODY,
    calibration: SetCalibration | None = None,
    *,
    numbers: LabelOrder = NO_NUMBERS,
    stored: tuple[StoredFields, ...] = (),
    on_alarm: Callable[[CellEvent], None] = lambda _: None,
    is_stepwise: bool = False,
) -> Batch:
    """Return a cell that is ready for one batch; no device is moved or read.

    Parameters
    ----------
    products : the recipes of the batch, each with its compute service; at least one
    cell : as read from its file
    layout : the cell as planning sees it
    devices : the drivers, connected or not
    clock : clock of the cell
    journal : journal of the run
    folder : folder of the run, for its pictures
    progress, on_progress : state shown to the operator; called after each change of it
    operator : answers questions
    numbers : source of the parts' serial numbers and lots
    stored : parts that stand in the trays
    on_alarm : called with each event that raises an alarm; must return at once
    is_stepwise : the operator lets each motion begin
    calibration : calibrations of the cell that no longer count
    """
    gripper, lights, io = devices.gripper, devices.lights, devices.io
    arm, arm_in_use = counted(devices.arm, clock, devices.wires.line("arm verbs"))
    quick = frozenset(name for name in CAMERAS if getattr(cell.cameras, name).settle_frames == 0)
    cameras: dict[CameraName, Camera] = {
        "overhead": devices.overhead,
        "inspection": devices.inspection,
    }

    nest_counts = {name: len(tray.nests) for name, tray in layout.trays.items() if tray.nests}
    trays = TrayRecord(nest_counts, stored)

    def show() -> None:
        on_progress()
        signals.note()

    record = BatchRecord(journal, progress, show, trays, products)
    outputs = io if isinstance(io, SignalOutputs) else None
    signals = PlcSignals(outputs, cell.outputs.wired, record, clock)
    compute = PartCompute(lambda: record.product.compute)
    gate = Gate(Permits(journal), clock, Approval(operator) if is_stepwise else None)
    retries = Retries(record, lambda: record.product.policy, clock)
    rules = rules_of(cell.interlock_rules)
    interlocks = Interlocks(io, gripper, layout, lambda: record.part.custody, retries, rules)
    motion = Motion(arm, interlocks, clock, gate, layout, record.note, record.note_secured)
    steps = PlanSteps(record, motion, clock, gate)
    grippers = Grippers(
        arm,
        gripper,
        io,
        record,
        lambda: record.product.recipe.grasp,
        gate,
        interlocks,
        retries,
        cell.arm.jaws.setting_per_n,
    )
    standstill = Standstill(gate, motion, grippers, record, layout)
    imaging = Imaging(lights, cameras, quick, folder, record.note_file, retries)
    recoveries = Recoveries(record, lambda: record.product.policy, clock)
    background = Background()
    views = Views(record, compute, background, layout)
    part_file = PartFileWriter(cell, layout, folder, calibration or SetCalibration())
    ahead = JudgingAhead(record, compute, background, part_file)
    held_pose = HeldPose(record, views, motion, imaging, compute, recoveries, layout)
    preparation = Preparation([product.compute for product in products])
    stopping = Stopping(arm, gripper, lights, clock, cell.detection.stop_confirm_s)

    labels = Labels(numbers, operator)
    taking = Taking(record, labels)
    codes = Codes(record, compute, background, labels)
    stored_views = StoredViews(record, compute, background, layout, folder)
    resumption = Resumption(record, motion, stored_views, labels)

    by_effect: dict[Effect, Action] = {
        Effect.HOME: ResetAction(
            HomeAction(
                io, layout, compute, motion, grippers, imaging, preparation, record, journal, gate
            ),
            ReadyAction(io, resumption, motion, imaging, preparation, record, journal, gate),
            resumption,
        ),
        Effect.RECOVER: RecoverAction(
            resumption, motion, grippers, record, gripper, compute, layout
        ),
        Effect.ACQUIRE: AcquireAction(imaging, gate, record, labels),
        Effect.RECOGNISE: RecogniseAction(compute, taking, record, codes),
        Effect.PLAN: PlanAction(compute, preparation, taking, views, held_pose, motion, record),
        Effect.GRASP: GraspAction(steps, motion, grippers, views, record, taking, layout),
        Effect.PRESENT: PresentAction(
            steps,
            motion,
            gate,
            grippers,
            imaging,
            views,
            Disambiguation(compute, record),
            codes,
            record,
        ),
        Effect.INSPECT: InspectAction(
            compute,
            steps,
            views,
            held_pose,
            ahead,
            motion,
            record,
            recoveries,
            part_file,
            codes,
        ),
        Effect.HAND_OFF: HandOffAction(steps, motion, grippers, record, layout),
        Effect.SET_DOWN: SetDownAction(steps, motion, grippers, record),
        Effect.WITHDRAW: WithdrawAction(compute, motion, grippers, recoveries, record),
        Effect.PLACE: PlaceAction(steps, motion, grippers, record),
        Effect.COMPLETE: CompleteAction(record, imaging),
        Effect.HOLD: HoldAction(stopping, views),
        Effect.CONSULT: ConsultAction(operator, record, taking, motion.sweeps_to_home),
        Effect.SUSPEND: SuspendAction(gate, stopping, standstill),
        Effect.UNSUSPEND: UnsuspendAction(gate, io, grippers, record, standstill),
        Effect.STOP_MOTION: StopMotionAction(stopping, views),
        Effect.ABORT_MOTION: AbortMotionAction(stopping, views, journal),
        Effect.CLEAR_FAULT: ClearFaultAction(io),
    }
    actions = Actions(by_effect, recoveries, Leases(record.note, clock))
    watchers = (
        InterlockWatcher(io, interlocks),
        MotorSupplyWatcher(io),
        FixedGripperWatcher(gripper, grippers, recoveries, record, clock),
        DiskWatcher(folder, clock),
        ArmWatcher(arm, arm_in_use, cell.detection.arm_beat_s, clock),
        ModbusWatcher(gripper, lights, retries, cell.detection.device_beat_s, clock),
        LoopWatcher(record, cell.detection.loop_late_s, clock),
    )
    dispatcher = Dispatcher(
        actions,
        record,
        stopping,
        watchers,
        journal,
        gate,
        interlocks,
        standstill,
        resumption.first,
        on_alarm,
        lambda: {name: _is_ok(io.signal(name)) for name in SIGNALS},
    )
    return Batch(record, motion, gate, actions, dispatcher, resumption, taking, ahead, signals)


def _is_ok(signal: Signal) -> bool | None:
    """Return whether an input is OK; None if its state is unknown."""
    return None if signal is Signal.UNKNOWN else signal.is_ok
