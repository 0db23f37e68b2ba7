"""Arguments and help of `cellctl run`, `recover` and `report`."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from controller.loading import loading

from ..options import (
    MAX_PART_COUNT,
    AsBuiltOption,
    CellOption,
    ControlOption,
    CountedRecipesArg,
    EmulatedAtOption,
    EmulatedPoseOption,
    JsonOption,
    RecipeCellOption,
    RunsOption,
    SeedOption,
    SpeedOption,
    SurfacesOption,
    WallClockOption,
)


def run(
    recipes: CountedRecipesArg = None,
    cell: RecipeCellOption = None,
    count: Annotated[
        int | None,
        typer.Option(
            "--count",
            metavar="N",
            min=1,
            max=MAX_PART_COUNT,
            help="number of parts of each recipe that names none (default: the recipe's)",
        ),
    ] = None,
    speed: SpeedOption = 1.0,
    wall_clock: WallClockOption = False,
    seed: SeedOption = None,
    as_built: AsBuiltOption = None,
    surfaces: SurfacesOption = None,
    lay: Annotated[
        list[Path] | None,
        typer.Option(
            "--lay",
            metavar="PART",
            help="CAD file of a part to put on the emulated table; may be repeated "
            "(default: the part of each recipe)",
        ),
    ] = None,
    on_table: Annotated[
        int | None,
        typer.Option(
            "--on-table",
            metavar="N",
            min=1,
            help="parts on the emulated table at a time, drawn by the seed; the next one comes "
            "once one is in its tray (default: all of them)",
        ),
    ] = None,
    empty: Annotated[bool, typer.Option("--empty", help="leave the emulated table empty")] = False,
    pose: EmulatedPoseOption = None,
    at: EmulatedAtOption = None,
    control: ControlOption = None,
    part_removed: Annotated[
        bool,
        typer.Option(
            "--part-removed",
            help="state that you took the part out of the grippers; the journal keeps it",
        ),
    ] = False,
    trays_empty: Annotated[
        bool,
        typer.Option(
            "--trays-empty",
            help="state that nothing stands in the nests of the trays; the journal keeps it",
        ),
    ] = False,
    auto_recover: Annotated[
        bool,
        typer.Option(
            "--auto-recover",
            help="after a crash, go on with the part in a gripper where that is proven safe",
        ),
    ] = False,
    operator: Annotated[
        str, typer.Option("--operator", metavar="NAME", help="your name, for the report")
    ] = "",
    lot: Annotated[
        str, typer.Option("--lot", metavar="LOT", help="lot of the parts, for the report")
    ] = "",
    parts_list: Annotated[
        Path | None,
        typer.Option(
            "--parts-list",
            metavar="FILE",
            help="list of all parts (CSV with the columns recipe, serial, lot) in place of recipes",
        ),
    ] = None,
    serial_from: Annotated[
        str | None,
        typer.Option(
            "--serial-from",
            metavar="NUMBER",
            help="first serial number; the digits at its end count up as parts are begun",
        ),
    ] = None,
    across_runs: Annotated[
        bool,
        typer.Option(
            "--across-runs",
            help="with --serial-from: go on after the last such number of the earlier runs",
        ),
    ] = False,
    scan: Annotated[
        bool,
        typer.Option(
            "--scan",
            help="read the serial number of each part before it is begun: a line from a scanner "
            "that types, or `cellctl answer NUMBER`",
        ),
    ] = False,
    serial: Annotated[
        list[str] | None,
        typer.Option(
            "--serial",
            metavar="NUMBER",
            help="serial number, for the report; once for each part, in their order",
        ),
    ] = None,
    part_temperature: Annotated[
        float | None,
        typer.Option(
            "--part-temperature",
            metavar="CELSIUS",
            min=-50,
            max=150,
            help="temperature of the parts as you measured it, for the report",
        ),
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(
            "--record",
            metavar="FILE",
            help="file to keep all wires of the run in: bytes, frames and their instants "
            "(`cellctl replay --wires`)",
        ),
    ] = None,
    wait: Annotated[
        bool,
        typer.Option(
            "--wait",
            help="wait for an answer where a person has to decide, also without a terminal "
            "(`cellctl answer`)",
        ),
    ] = False,
    step: Annotated[
        bool,
        typer.Option(
            "--step",
            help="show each motion before it begins, and let it begin by Enter, or by "
            "`cellctl answer go` from another terminal",
        ),
    ] = False,
    dry: Annotated[
        bool,
        typer.Option(
            "--dry",
            help="drive all motions without a part: lifted off everything, at a tenth of the "
            "speed, grippers open; with --pose from that stable pose (default: the likeliest)",
        ),
    ] = False,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
    verbose: Annotated[
        bool,
        typer.Option(
            "--verbose", "-v", help="log to stderr, with the details of an unexpected error"
        ),
    ] = False,
) -> None:
    """Inspect and sort parts: the main job. Emulated devices start beside it."""
    with loading():
        from controller.cell.batch import Papers

        from ..inputs.parts_list import load_parts_list
        from ..inputs.recipes import asked_recipes
        from ..inputs.serials import SerialOptions
        from ..terminal.output import warn
        from .recipe_run import RunOptions, quiet_logs, run_recipe

    quiet_logs(verbose=verbose)
    if parts_list is not None and recipes:
        raise typer.BadParameter(f"--parts-list names the recipes; leave out {recipes[0]}")
    listed = None if parts_list is None else load_parts_list(parts_list, lot)
    asked = asked_recipes(recipes or ()) if listed is None else listed.recipes
    if listed is None and not recipes:
        warn(f"recipe: {asked[0].path}")
    options = RunOptions(
        recipes=asked,
        cell_path=cell,
        count=count,
        speed=speed,
        is_on_wall_clock=wall_clock,
        seed=seed,
        as_built=as_built,
        surfaces=surfaces and surfaces.value,
        lay=tuple(lay or ()),
        on_table=on_table,
        empty=empty,
        pose=pose,
        at=at,
        control=control,
        runs_dir=runs,
        is_part_removed=part_removed,
        are_trays_empty=trays_empty,
        is_recovery_automatic=auto_recover,
        papers=Papers(operator, lot, (), part_temperature),
        serials=SerialOptions(
            serials=tuple(serial or ()),
            counted_from=serial_from,
            goes_on=across_runs,
            is_read=scan,
        ),
        listed=listed,
        waits=wait,
        is_stepwise=step,
        is_dry=dry,
        record=record,
        as_json=json,
    )
    if dry:
        with loading():
            from .dry_run import run_dry

        raise typer.Exit(run_dry(options))
    raise typer.Exit(run_recipe(options))


class GripperOption(StrEnum):
    """The gripper to open."""

    ARM = "arm"
    FIXED = "fixed"


def recover(
    cell: CellOption = None,
    open_: Annotated[
        GripperOption | None,
        typer.Option(
            "--open", help="gripper to open while you hold the part; the arm does not move"
        ),
    ] = None,
    accept: Annotated[
        bool,
        typer.Option(
            "--accept",
            help="go on with the part as proposed, with the recipe of the interrupted run, until "
            "it is in its tray",
        ),
    ] = False,
    why: Annotated[
        str, typer.Option("--why", metavar="TEXT", help="why you accept, for the journal")
    ] = "",
    yes: Annotated[
        bool, typer.Option("--yes", help="state that you hold the part; do not ask")
    ] = False,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Report what the grippers may hold after a crash, and what may be done; do it, or open one."""
    with loading():
        from controller.cell.custody import GripperName

        from ..inputs.part_files import cell_of_this_folder
        from .accepting import go_on_with_part
        from .release import recover_cell

    if accept:
        if open_ is not None:
            raise typer.BadParameter("--accept and --open exclude each other")
        raise typer.Exit(go_on_with_part(cell or cell_of_this_folder(), runs, why, as_json=json))
    gripper = None if open_ is None else GripperName[open_.name]
    code = recover_cell(
        cell or cell_of_this_folder(), runs, gripper, is_confirmed=yes, as_json=json
    )
    raise typer.Exit(code)


class Form(StrEnum):
    """Format of a report."""

    HTML = "html"
    PDF = "pdf"
    JSON = "json"
    CSV = "csv"
    QIF = "qif"
    DFQ = "dfq"


def report(
    run_name: Annotated[
        str | None, typer.Argument(metavar="RUN", help="name of the run (default: the newest)")
    ] = None,
    form: Annotated[Form, typer.Option("--format", help="format of the report")] = Form.HTML,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="file to write (default: report.FORMAT in the run's folder; JSON to stdout)",
        ),
    ] = None,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Write the report of a run."""
    with loading():
        from .report_file import write_report

    raise typer.Exit(write_report(runs, run_name, "json" if json else form.value, output))
