"""`cellctl run`: check everything, start the emulated cell if any, run, write the report."""

import asyncio
import logging
import os
import secrets
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from controller.arrays import FloatArray
from controller.cad.compiled import CompiledPart
from controller.cell.batch import (
    HOST,
    Dispatcher,
    OrderedRecipe,
    Outfit,
    Papers,
    RecoveryPolicy,
    RunOrder,
    RunProgress,
    RunResult,
    jobs_of,
    new_run_id,
    run_batch,
)
from controller.cell.compute import Job, context
from controller.cell.compute.checks import check_plans, check_sizes
from controller.cell.control import socket_path
from controller.cell.devices.clocks import FoundClock, devices_with_time, find_clock
from controller.cell.devices.emulator import emulated_cell, emulator_args, emulator_command
from controller.cell.lock import hold_cell, require_free_cell
from controller.cell.operator import Operator
from controller.config import Cell, ConfigError, load_cell
from controller.processes import worker_pool
from controller.results.run import ResultsError, load_run
from controller.results.takt import run_takt
from controller.results.writing import write_html
from controller.setup.drivers import require_drivers, require_force

from ..inputs.checks import MIN_FREE_BYTES, check_control, check_writable_folder, parse_place
from ..inputs.part_files import emulated_orientation, for_emulator
from ..inputs.parts_list import load_parts_list
from ..inputs.recipes import cell_of, ordered_recipes, recipes_to_run
from ..inputs.serials import papers_of
from ..planning.recipe_check import warn_of
from ..terminal.output import log_stream, warn
from .arguments import RunOptions
from .door import OperatorDoor
from .emulated_parts import feeding, parts_on_table
from .ends import CommandEnds
from .report_file import note_report, warn_no_report
from .run_output import display, print_result

log = logging.getLogger(__name__)
COMPUTES = "controller.cell.compute"  # answers in a worker process
AHEAD_NICENESS = 5  # work on the next part gives way to work that the arm waits for


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Asked:
    """The request of a command line, read and checked; nothing has started.

    Attributes
    ----------
    ordered : the recipes
    cell_file, cell, clock : the cell, and the clock it will run by
    papers : operator, serials and lots
    on_table : CAD files of the parts on the emulated table, each with its part
    orientation : rotation CAD -> upright (3, 3) of the first of them; None to draw it
    run_id : id of the run
    """

    ordered: tuple[OrderedRecipe, ...]
    cell_file: Path
    cell: Cell
    clock: FoundClock
    papers: Papers
    on_table: Sequence[tuple[Path, CompiledPart]]
    orientation: FloatArray | None
    run_id: str

    @property
    def jobs(self) -> tuple[Job, ...]:
        """The compute service's job for each recipe."""
        return jobs_of(self.ordered, self.cell_file)


def run_recipe(options: RunOptions, in_advance: Operator | None = None) -> int:
    """Run one recipe or several; return the exit code: 0 if all parts passed, else 1.

    Parameters
    ----------
    options : the command line
    in_advance : who decides in advance about a part left in a gripper; None for who is there

    Raises
    ------
    ConfigError : a file or an option is wrong, or the cell cannot run at this speed
    KeyboardInterrupt : the operator pressed Ctrl-C twice; the report is written first
    """
    runs_dir, as_json = options.runs_dir, options.as_json
    asked = _asked(options)
    # whoever looks at the cell meanwhile sees by its lock which run is being prepared
    with hold_cell(runs_dir, asked.cell, asked.run_id, socket_path(runs_dir)) as holder:
        if not _are_ready(asked.jobs, as_json=as_json):
            return 1
        command = _emulator_command(options, asked)
        with CommandEnds().heard() as ends, _workers(options, asked) as (pool, ahead):
            with _cell_beside(options, asked, command) as ready:
                _report_transport(ready)
                order = _order(options, asked, ready, in_advance)
                door = OperatorDoor(
                    runs_dir,
                    holder,
                    in_advance,
                    waits=options.waits,
                    scans=asked.papers.is_read,
                    as_json=as_json,
                )
                with _recorded(options.record, order) as outfit:
                    result = _run(order, pool, ahead, ends, door, outfit, as_json=as_json)
            return _report(result, runs_dir, asked.run_id, as_json=as_json)


def _asked(options: RunOptions) -> _Asked:
    """Return the request of a command line, checked; quick checks come first.

    Raises
    ------
    ConfigError : as in `run_recipe`
    """
    listed = (
        None if options.parts_list is None else load_parts_list(options.parts_list, options.lot)
    )
    recipes = recipes_to_run(options.recipes) if listed is None else listed.recipes
    ordered = ordered_recipes(recipes, options.count)
    cell_file = cell_of(ordered, options.cell_path)
    cell = load_cell(cell_file)
    require_drivers(cell_file, cell)
    clock = _check_options(options, cell, len(ordered))
    for one in ordered:
        check_sizes(one.path, one.recipe, cell)
        require_force(one.path, one.recipe.grasp.force_n, cell)
    papers = papers_of(
        options.serials,
        given_papers(options),
        listed,
        len(ordered),
        sum(one.count for one in ordered),
        options.runs_dir,
    )
    on_table = parts_on_table(ordered, options.lay or (), is_empty=options.empty)
    return _Asked(
        ordered=tuple(ordered),
        cell_file=cell_file,
        cell=cell,
        clock=clock,
        papers=papers,
        on_table=on_table,
        orientation=emulated_orientation([part for _, part in on_table], options.pose),
        run_id=new_run_id(ordered[0].recipe, more=len(ordered) - 1),
    )


def given_papers(options: RunOptions) -> Papers:
    """Return the papers as the command line gives them, without serial numbers."""
    return Papers(
        options.operator,
        options.lot,
        part_temperature_c=options.part_temperature_c,
        order_number=options.order_number.strip(),
    )


def _emulator_command(options: RunOptions, asked: _Asked) -> list[str]:
    """Return the command that emulates some devices, after a warning that names them."""
    emulated = asked.cell.emulated_devices
    seed = secrets.randbelow(1_000_000) if options.seed is None else options.seed
    _warn_of_emulation(emulated, asked.clock, options.speed, seed)
    folder = options.runs_dir / asked.run_id
    parts = tuple(for_emulator(path, part, folder) for path, part in asked.on_table if emulated)
    files = [path for path, _ in asked.on_table]
    fed = feeding(asked.ordered, files, options.on_table) if parts else ()
    placed = emulator_args(
        asked.orientation,
        options.at,
        options.control,
        options.as_built,
        options.surfaces,
        is_on_wall_clock=options.is_on_wall_clock,
        code=_emulated_code(asked.ordered),
    )
    return emulator_command(
        asked.cell_file, parts, speed=options.speed, seed=seed, more=(*placed, *fed)
    )


def _emulated_code(ordered: Sequence[OrderedRecipe]) -> str:
    """Return the first code on emulated parts, as the first recipe with one asks; else empty."""
    for one in ordered:
        asked = one.recipe.serial_code
        if asked is not None and asked.at == "part" and asked.example:
            return f"{asked.code}:{asked.example}"
    return ""


@contextmanager
def _workers(
    options: RunOptions, asked: _Asked
) -> Iterator[tuple[ProcessPoolExecutor, ProcessPoolExecutor | None]]:
    """Yield the worker process, which reads the CAD already, and the one for the next part.

    There is none for the next part where there is no such part, or wires are kept: a recording is
    played back with the answers of one worker, in their order.
    """
    has_next = sum(one.count for one in asked.ordered) > 1 and options.record is None
    next_part = worker_pool(COMPUTES, niceness=AHEAD_NICENESS) if has_next else nullcontext(None)
    with worker_pool(COMPUTES) as pool, next_part as ahead:
        for job in asked.jobs:
            pool.submit(context, job)
        if ahead is not None:
            ahead.submit(os.getpid)  # to start a process would hold the event loop up later
        yield pool, ahead


def _cell_beside(
    options: RunOptions, asked: _Asked, command: Sequence[str]
) -> AbstractContextManager[Any]:
    """Return the emulated cell if any device is emulated; yields the cell's announcement."""
    if not asked.cell.emulated_devices:
        return nullcontext({})
    return emulated_cell(command, options.runs_dir / asked.run_id / "emulator.log")


def _order(
    options: RunOptions, asked: _Asked, ready: dict[str, Any], in_advance: Operator | None
) -> RunOrder:
    """Return the order to run; `ready` is the emulated cell's announcement."""
    first, *beside = asked.ordered
    return RunOrder(
        recipe_path=first.path,
        cell_path=asked.cell_file,
        recipe=first.recipe,
        cell=asked.cell,
        count=first.count,
        speed=asked.clock.speed,
        emulated=ready,
        clock=find_clock(asked.cell, ready),
        runs_dir=options.runs_dir,
        run_id=asked.run_id,
        is_part_removed=options.is_part_removed,
        are_trays_empty=options.are_trays_empty,
        papers=asked.papers,
        recovery=_recovery_policy(options, in_advance),
        is_stepwise=options.is_stepwise,
        beside=tuple(beside),
    )


def _are_ready(jobs: Sequence[Job], *, as_json: bool) -> bool:
    """Return whether each recipe can be run, after printing the reasons against it."""
    are_ready = True
    for job in jobs:
        checked = check_plans(job, None if as_json else warn)
        if checked.problems:
            warn_of(job.recipe_path, checked.problems)
            are_ready = False
    return are_ready


def _recovery_policy(options: RunOptions, in_advance: Operator | None) -> RecoveryPolicy:
    """Return the policy for a part in a gripper at the start: without a terminal nobody answers."""
    if options.is_recovery_automatic:
        return "auto"
    if in_advance is not None or options.waits:
        return "ask"
    return "ask" if sys.stdin.isatty() else "refuse"


def _check_options(options: RunOptions, cell: Cell, recipe_count: int) -> FoundClock:
    """Check everything that can be checked without the part; return the run's clock."""
    check_writable_folder(options.runs_dir, "--runs", MIN_FREE_BYTES)
    require_free_cell(options.runs_dir, cell)
    check_control(options.control)
    has_terminal = sys.stdin.isatty() and sys.stderr.isatty() and not options.as_json
    if options.is_stepwise and not options.waits and not has_terminal:
        raise ConfigError(
            "--step asks before each motion, and there is no terminal to ask at: add --wait, and "
            "give `cellctl answer go` in another terminal"
        )
    if options.record is not None:
        _check_recording(options.record, cell, recipe_count)
    if options.at is not None:
        parse_place(options.at, cell)
    clock = find_clock(cell, {})
    if cell.emulated_devices and not clock.is_mixed:
        clock = replace(clock, speed=options.speed)
    if options.speed not in (1, clock.speed):
        raise ConfigError(_why_not_so_fast(options.speed, cell, clock))
    return clock


def _warn_of_emulation(emulated: Sequence[str], clock: FoundClock, speed: float, seed: int) -> None:
    if emulated:
        warn(f"EMULATED: {', '.join(emulated)} ({speed:g} x real time, --seed {seed} repeats it)")
    elif clock.path is not None:
        warn(f"EMULATED: the devices share an emulator's clock ({clock.speed:g} x real time)")
    if clock.is_mixed:
        warn("MIXED: emulated devices beside real ones keep real time, however busy the machine is")


def _run(
    order: RunOrder,
    pool: ProcessPoolExecutor,
    ahead: ProcessPoolExecutor | None,
    ends: CommandEnds,
    door: OperatorDoor,
    outfit: Outfit,
    *,
    as_json: bool,
) -> RunResult:
    """Run to the end, with a live display; a run that breaks off leaves a report all the same."""
    with display(as_json=as_json) as on_progress:
        try:
            return asyncio.run(_drive(order, pool, ahead, ends, door, outfit, on_progress))
        except BaseException as error:
            _report_if_any(order.runs_dir, order.run_id)
            if isinstance(error, asyncio.CancelledError):  # a second Ctrl-C
                raise KeyboardInterrupt from error
            raise


def _check_recording(path: Path, cell: Cell, recipe_count: int) -> None:
    from controller.recorded_wires import require_recorded

    if recipe_count > 1:
        raise ConfigError(
            "--record takes a run of one recipe; leave out --record or the other recipes"
        )
    if path.exists():
        raise ConfigError(f"--record {path}: exists already; name another file")
    require_recorded(cell)


@contextmanager
def _recorded(path: Path | None, order: RunOrder) -> Iterator[Outfit]:
    """Yield the run's devices and services; with a path, all its wires are recorded there.

    Raises
    ------
    ConfigError : the file exists already, or cannot be made
    """
    if path is None:
        yield HOST
        return
    from controller.recorded_wires import Recorder, WireFileError, WireWriter

    try:
        recorder = Recorder(WireWriter(path))
    except WireFileError as error:
        raise ConfigError(f"--record: {error}") from error
    try:
        recorder.begin(order)
        yield recorder.outfit()
    finally:
        recorder.close()
        if recorder.writer.problem:
            warn(f"{path}: the recording ends early: {recorder.writer.problem}")


def _report(result: RunResult, runs_dir: Path, run_id: str, *, as_json: bool) -> int:
    """Write the report and print the result; return the exit code."""
    path = runs_dir / run_id / "report.html"
    record = load_run(runs_dir, run_id)
    takt = run_takt(record)
    try:
        report = write_html(record, path)
    except OSError as error:
        print_result(result, run_id, None, takt, as_json=as_json)
        warn_no_report(error, path, run_id, runs_dir)
        return 1
    note_report(runs_dir, run_id, report)
    return print_result(result, run_id, report, takt, as_json=as_json)


def _report_if_any(runs_dir: Path, run_id: str) -> None:
    """Write the report of a run that broke off; there is none if it had not begun."""
    try:
        report = write_html(load_run(runs_dir, run_id), runs_dir / run_id / "report.html")
    except (ResultsError, OSError) as error:
        log.warning("no report: %s", error)
    else:
        note_report(runs_dir, run_id, report)
        warn(f"report: {report}")


def _why_not_so_fast(speed: float, cell: Cell, clock: FoundClock) -> str:
    if clock.path is not None:
        return (
            f"--speed {speed:g}: the emulator at these addresses runs at {clock.speed:g} x; "
            "leave --speed out here, and give it to `cellctl emulate`"
        )
    real = sorted(set(devices_with_time(cell)) - set(cell.emulated_devices))
    return f"--speed {speed:g}: time cannot run faster on real devices: {real}"


def _report_transport(ready: dict[str, Any]) -> None:
    if ready.get("camera_transport") == "socket":
        warn(
            "cameras: the emulated cameras speak V4L2 over unix sockets, since FUSE cannot be "
            f"mounted here ({ready.get('why_not_fuse')})"
        )


async def _drive(
    order: RunOrder,
    pool: ProcessPoolExecutor,
    ahead: ProcessPoolExecutor | None,
    ends: CommandEnds,
    door: OperatorDoor,
    outfit: Outfit,
    on_progress: Callable[[RunProgress], None],
) -> RunResult:
    with ExitStack() as stack:

        def on_dispatcher(dispatcher: Dispatcher) -> None:
            stack.enter_context(ends.stopping(dispatcher, order.emulated.get("pid")))
            door.attach(dispatcher)

        async with door.open():
            return await run_batch(
                order,
                pool,
                on_progress,
                on_dispatcher,
                warn,
                outfit,
                operator=door,
                ahead=ahead,
                callers=door.callers,
            )


def quiet_logs(*, verbose: bool) -> None:
    """Send logs to stderr: errors alone, or with ``verbose`` all but debugging."""
    logging.basicConfig(
        level=logging.INFO if verbose else logging.ERROR,
        stream=log_stream,
        format="%(asctime)s %(name)s %(levelname)s %(message)s",
    )
