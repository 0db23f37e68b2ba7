"""`cellctl run --dry`: plan from a stable pose, lift all motions, drive them, write the report."""

import asyncio
import sys
from collections.abc import Sequence
from pathlib import Path

from controller.bring_up.dry import DryOrder, DryPlan, DrySession, dry_plan
from controller.bring_up.procedure import StepEnd, StepRecord
from controller.cad import StablePose
from controller.cad.reading import files_of
from controller.cell.batch import new_run_id
from controller.cell.compute import Job, context
from controller.cell.compute.checks import check_sizes
from controller.cell.plans import PlanCache
from controller.config import Cell, ConfigError, Recipe, load_cell, load_recipe
from controller.config.files import file_sha256
from controller.results.run import load_run
from controller.results.writing import write_html
from controller.setup.drivers import require_drivers

from ..inputs.recipes import recipes_to_run
from ..options import EmulatedOptions
from ..terminal.output import emit, print_line, warn
from .arguments import RunOptions
from .door import OperatorDoor
from .entering import Entered, check_entering, entered, user_name
from .report_file import note_report, warn_no_report


def run_dry(options: RunOptions) -> int:
    """Drive all motions of a recipe without its part; return 0 if all were driven to their end.

    Raises
    ------
    ConfigError : a file or an option is wrong, or there is no plan from the stable pose
    """
    _check_options(options)
    recipe_path = _recipe_path(options)
    recipe = load_recipe(recipe_path)
    cell_path = options.cell_path or recipe.cell
    cell = load_cell(cell_path)
    require_drivers(cell_path, cell)
    emulated = EmulatedOptions(
        as_built=options.as_built,
        seed=options.seed,
        speed=options.speed,
        control=options.control,
    )
    check_entering(emulated, cell, options.runs_dir, "--runs", answers=False)
    check_sizes(recipe_path, recipe, cell)
    if not options.as_json:
        print_line("planning; nothing moves yet")
    plan = _plan(Job(recipe_path, cell_path), cell, options.pose)
    for why in plan.left_out:
        warn(f"left out: {why}")
    run_id = f"{new_run_id(recipe)}-dry"
    files = (recipe_path, cell_path, *files_of(recipe.part))
    with entered(emulated, cell_path, cell, options.runs_dir, run_id) as inside:
        record = asyncio.run(_drive(options, files, recipe, cell, plan, run_id, inside))
    _report(options, record, plan, run_id)
    return 0 if record.outcome is StepEnd.PASSED and not plan.left_out else 1


def _recipe_path(options: RunOptions) -> Path:
    """Return the one recipe of a dry run.

    Raises
    ------
    ConfigError : there are several, or it has a count
    """
    asked, *more = recipes_to_run(options.recipes)
    if more:
        raise ConfigError(f"{more[0].path}: --dry takes one recipe")
    if asked.count is not None:
        raise ConfigError(f"={asked.count}: --dry takes no part; leave it out")
    return asked.path


def _check_options(options: RunOptions) -> None:
    """Refuse options without meaning for a run without a part."""
    given = {
        "--count": options.count is not None,
        "--lay": bool(options.lay),
        "--empty": options.empty,
        "--on-table": options.on_table is not None,
        "--at": options.at is not None,
        "--surfaces": options.surfaces is not None,
        "--record": options.record is not None,
        "--part-removed": options.is_part_removed,
        "--trays-empty": options.are_trays_empty,
        "--auto-recover": options.is_recovery_automatic,
        "--lot": bool(options.lot),
        "--order": bool(options.order_number.strip()),
        "--serial": bool(options.serials.serials),
        "--serial-from": options.serials.counted_from is not None,
        "--parts-list": options.parts_list is not None,
        "--scan": options.serials.is_read,
        "--part-temperature": options.part_temperature_c is not None,
    }
    for option, is_given in given.items():
        if is_given:
            raise ConfigError(f"{option}: --dry takes no part; leave it out")
    has_terminal = sys.stdin.isatty() and sys.stderr.isatty() and not options.as_json
    if options.is_stepwise and not options.waits and not has_terminal:
        raise ConfigError(
            "--step asks before each motion, and there is no terminal to ask at: add --wait, and "
            "give `cellctl answer go` in another terminal"
        )


def _plan(job: Job, cell: Cell, pose_index: int | None) -> DryPlan:
    """Return the lifted motions from a stable pose in the middle of the drop area.

    Raises
    ------
    ConfigError : there is no such stable pose, or no plan from it
    """
    c = context(job)
    pose = _pose(c.poses, pose_index)
    certificate = PlanCache(c.part, c.layout, c.setup.options).certified(pose).certificate
    if certificate.plan is None:
        raise ConfigError(
            f"{job.recipe_path}: stable pose {pose.index} has no plan to drive: "
            f"{certificate.reason}; choose another with --pose"
        )
    return dry_plan(cell, pose.index, certificate.plan)


def _pose(poses: tuple[StablePose, ...], index: int | None) -> StablePose:
    steady = [pose for pose in poses if not (pose.rolling or pose.marginal)]
    if index is None:
        if not steady:
            raise ConfigError("the part has no stable pose to plan from")
        return max(steady, key=lambda pose: pose.probability)
    found = next((pose for pose in poses if pose.index == index), None)
    if found is None:
        listed = ", ".join(str(pose.index) for pose in poses)
        raise ConfigError(f"--pose {index}: the part has the stable poses {listed}")
    return found


async def _drive(
    options: RunOptions,
    files: Sequence[Path],
    recipe: Recipe,
    cell: Cell,
    plan: DryPlan,
    run_id: str,
    inside: Entered,
) -> StepRecord:
    door = OperatorDoor(
        options.runs_dir, inside.holder, waits=options.waits, as_json=options.as_json
    )

    def show(text: str) -> None:
        if options.as_json:
            emit({"event": "note", "text": text})
        else:
            print_line(f"  {text}")

    async with door.open():
        session = DrySession(
            DryOrder(
                recipe=recipe,
                cell=cell,
                files={str(path): file_sha256(path) for path in files},
                plans=(plan,),
                emulated=inside.ready,
                clock=inside.clock,
                runs_dir=options.runs_dir,
                run_id=run_id,
                by=options.operator or user_name(),
                is_stepwise=options.is_stepwise,
            ),
            door,
            show,
            callers=door.callers,
        )
        door.attach_stop(session.request_stop)
        with inside.ends.stopping(session, inside.ready.get("pid")):
            return await session.run()


def _report(options: RunOptions, record: StepRecord, plan: DryPlan, run_id: str) -> None:
    """Write the report, then print the outcome."""
    path = options.runs_dir / run_id / "report.html"
    run = load_run(options.runs_dir, run_id)
    report: Path | None = None
    try:
        report = write_html(run, path)
        note_report(options.runs_dir, run_id, report)
    except OSError as error:
        warn_no_report(error, path, run_id, options.runs_dir)
    steps = run.dry or ()
    motions, seconds = sum(one.motions for one in steps), sum(one.seconds for one in steps)
    if options.as_json:
        emit(
            {
                "event": "dry",
                "run": run_id,
                "outcome": record.outcome.value,
                "message": record.message,
                "pose_index": plan.pose_index,
                "motions": motions,
                "seconds": round(seconds, 1),
                "left_out": list(plan.left_out),
                "report": None if report is None else str(report),
            }
        )
        return
    if record.message:
        warn(f"cellctl: {record.message}")
    how = "ended" if record.outcome is StepEnd.PASSED else "was stopped"
    left = f", {len(plan.left_out)} waypoints left out" if plan.left_out else ""
    print_line(
        f"dry run {how}: {motions} motions in {seconds:.0f} s of the cell's time{left}; no part, "
        "no verdict"
    )
    if report is not None:
        print_line(f"report: {report}")
