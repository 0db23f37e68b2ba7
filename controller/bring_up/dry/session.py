"""A dry run: all motions of a recipe's plan, lifted, slow, grippers open, no part (ADR 45).

It is a visit, as a step of commissioning is one, and so it has journal, locks, interlocks,
watchers, gate, permit and stops; it has no cycle, no cameras and no verdict.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from controller.arrays import FloatArray
from controller.cell.devices import Devices
from controller.cell.devices.clocks import FoundClock
from controller.cell.devices.interlocks import check_interlocks
from controller.cell.devices.supervision import CallerPrograms
from controller.cell.journal import rows
from controller.cell.operator import Operator
from controller.config import Cell, Recipe
from controller.config.calibration_reference import CalibrationName
from controller.config.calibrations import Calibration
from controller.planning import Plan
from controller.setup.layout import build_layout
from messages import key

from ..bench import Bench
from ..evidence import StepEvidence
from ..jogging import inside_limits
from ..procedure import StepRecord, cell_digest
from ..visit import Build, StepVisit, VisitOrder
from .lifting import LiftedStep, dry_scene, lift_plan

SPEED: Final = 0.1  # share of the usual speed
START: Final = "start"


@dataclass(frozen=True, slots=True, eq=False)
class DryPlan:
    """The lifted motions from one stable pose.

    Attributes
    ----------
    pose_index : index of the stable pose that the plan begins with
    steps : in order; the first one begins at the park
    """

    pose_index: int
    steps: tuple[LiftedStep, ...]

    @property
    def left_out(self) -> tuple[str, ...]:
        """Why waypoints are not driven to."""
        return tuple(why for step in self.steps for why in step.left_out)


def dry_plan(cell: Cell, pose_index: int, plan: Plan) -> DryPlan:
    """Return the motions of a plan as a dry run drives them.

    Parameters
    ----------
    cell : cell, as far as it is known
    pose_index : index of the stable pose that the plan begins with
    plan : plan without a part on the table
    """
    return DryPlan(pose_index, tuple(lift_plan(build_layout(cell), plan)))


class DryStep:
    """Drives lifted motions.

    Parameters
    ----------
    plans : one for each stable pose
    """

    name = "dry"
    title = "all motions, lifted and slow"
    needs: tuple[str, ...] = ()
    uses: tuple[CalibrationName, ...] = ()
    makes: tuple[CalibrationName, ...] = ()
    valid_days: int | None = None

    def __init__(self, plans: Sequence[DryPlan]) -> None:
        self._plans = plans

    async def run(self, bench: Bench) -> Mapping[CalibrationName, Calibration]:
        """Home, open both grippers, drive all motions; return no calibration.

        Raises
        ------
        InterlockError : an interlock rule does not hold
        StepFailedError : the arm does not get to its park on a path that is proven free
        DeviceError : a device does not answer or does not get there
        """
        # who starts a dry run lets it move, as who starts a run does
        check_interlocks(bench.devices.io)
        bench.gate.permits.issue(START)
        bench.evidence.show(f"{bench.motion.homing_words}, at its usual speed")
        await bench.motion.home()
        await _open_grippers(bench)
        await _go_to_park(bench)
        for plan in self._plans:
            bench.evidence.show(f"stable pose {plan.pose_index}:")
            for step in plan.steps:
                await _drive(bench, plan.pose_index, step)
        return {}


async def _open_grippers(bench: Bench) -> None:
    widest_mm, gripper = bench.arm.max_opening_mm, bench.devices.gripper
    await bench.move_jaws("the arm gripper opens", lambda: bench.arm.move_gripper_mm(widest_mm))
    await bench.move_jaws(key("the fixed gripper activates: its jaws may move"), gripper.activate)
    await bench.move_jaws(
        "the fixed gripper opens", lambda: gripper.open_to(gripper.max_opening_mm)
    )


async def _go_to_park(bench: Bench) -> None:
    """Go to the park, from where homing leaves the arm."""
    park_q = np.asarray(bench.layout.park_q, dtype=float)
    begin: FloatArray = inside_limits(bench.layout.arm, await bench.arm.read_q(), park_q)
    await bench.motion.follow((begin,), first_speed=SPEED)
    for q in await bench.path_to(park_q, dry_scene(bench.layout), "to the park"):
        await bench.motion.follow((q,), first_speed=SPEED)


async def _drive(bench: Bench, pose_index: int, step: LiftedStep) -> None:
    began_s = bench.clock.now_s()
    for q in step.path:
        await bench.motion.follow((q,), first_speed=SPEED)
    row = rows.DryStepDone(
        label=step.label,
        pose_index=pose_index,
        waypoints=len(step.path),
        lifted_mm=step.lifted_mm,
        left_out=step.left_out,
        seconds=round(bench.clock.now_s() - began_s, 2),
    )
    bench.note(row)
    least, most = step.lifted_mm
    lifted = f"{least:.0f} mm" if least == most else f"{least:.0f} to {most:.0f} mm"
    more = f"; {len(step.left_out)} left out" if step.left_out else ""
    bench.evidence.show(
        f"{step.label}: {len(step.path)} motions, lifted by {lifted}, {row.seconds:.0f} s{more}"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class DryOrder:
    """The order of a dry run.

    Attributes
    ----------
    recipe, cell : inputs of the plan
    files : SHA-256 of what was read, by path
    plans : plans to drive
    emulated : report of the emulator about itself; empty without one
    clock : clock of the cell
    runs_dir, run_id : folder of runs, and id of the run
    by : name of the operator
    is_stepwise : a person lets each motion begin
    """

    recipe: Recipe
    cell: Cell
    files: Mapping[str, str]
    plans: Sequence[DryPlan]
    emulated: Mapping[str, Any]
    clock: FoundClock
    runs_dir: Path
    run_id: str
    by: str
    is_stepwise: bool


class DrySession:
    """A dry run under way; anything that would end it stops it instead.

    Parameters
    ----------
    order : order to drive
    operator : answers for a person
    show : printer of a line for the spectators
    build : function that builds the drivers from cell, addresses and clock
    callers : callers whose stop orders the supervisor takes while the event loop is late
    """

    def __init__(
        self,
        order: DryOrder,
        operator: Operator,
        show: Callable[[str], None],
        build: Build = Devices.build,
        callers: CallerPrograms | None = None,
    ) -> None:
        folder = order.runs_dir / order.run_id
        folder.mkdir(parents=True, exist_ok=True)
        self._visit = StepVisit(
            VisitOrder(
                step=DryStep(order.plans),
                recipe=order.recipe.model_dump(mode="json", by_alias=True),
                cell=order.cell,
                digest=cell_digest(order.cell),
                emulated=order.emulated,
                clock=order.clock,
                folder=order.runs_dir,
                run_id=order.run_id,
                by=order.by,
                based_on={},
                files=order.files,
                is_dry=True,
                is_stepwise=order.is_stepwise,
            ),
            operator,
            None,
            StepEvidence(folder, show),
            build,
            callers,
        )

    def request_stop(self, message: str, code: str) -> None:
        """Halt metal, then end."""
        self._visit.stop(message, code)

    def request_abort(self, message: str, code: str) -> None:
        """Do the same; nothing is held that could be lost."""
        self._visit.stop(message, code)

    async def run(self) -> StepRecord:
        """Connect, drive, come to rest; return the outcome.

        Raises
        ------
        BaseException : a bug; the cell was halted
        """
        return await self._visit.run()
