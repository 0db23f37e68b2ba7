"""Arguments and help of `cellctl run`, `recover` and `report`."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from controller.loading import loading

from ..options import (
    EMULATED,
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

# Titles of sections of the help of `run`.
REPORTED = "Parts and their report"
AFTER_A_STOP = "After a stop or a crash"


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
            help="parts to inspect of each recipe without a count (default: the recipe's)",
        ),
    ] = None,
    operator: Annotated[
        str,
        typer.Option(
            "--operator", metavar="NAME", rich_help_panel=REPORTED, help="name of the operator"
        ),
    ] = "",
    lot: Annotated[
        str,
        typer.Option("--lot", metavar="LOT", rich_help_panel=REPORTED, help="lot of the parts"),
    ] = "",
    order: Annotated[
        str,
        typer.Option(
            "--order",
            metavar="NUMBER",
            rich_help_panel=REPORTED,
            help="number of the order (default: the recipe's `papers`)",
        ),
    ] = "",
    parts_list: Annotated[
        Path | None,
        typer.Option(
            "--parts-list",
            metavar="FILE",
            rich_help_panel=REPORTED,
            help="list of parts (CSV: recipe, serial, lot) in place of recipes",
        ),
    ] = None,
    serial_from: Annotated[
        str | None,
        typer.Option(
            "--serial-from",
            metavar="NUMBER",
            rich_help_panel=REPORTED,
            help="first serial number; its last digits count up with each part",
        ),
    ] = None,
    across_runs: Annotated[
        bool,
        typer.Option(
            "--across-runs",
            rich_help_panel=REPORTED,
            help="with --serial-from: continue after the last such number of earlier runs",
        ),
    ] = False,
    scan: Annotated[
        bool,
        typer.Option(
            "--scan",
            rich_help_panel=REPORTED,
            help="read each serial number first: from a scanner that types a line, or from "
            "`cellctl answer NUMBER`",
        ),
    ] = False,
    serial: Annotated[
        list[str] | None,
        typer.Option(
            "--serial",
            metavar="NUMBER",
            rich_help_panel=REPORTED,
            help="serial number of a part; once per part, in order",
        ),
    ] = None,
    part_temperature: Annotated[
        float | None,
        typer.Option(
            "--part-temperature",
            metavar="DEG_C",
            min=-50,
            max=150,
            rich_help_panel=REPORTED,
            help="measured temperature of the parts",
        ),
    ] = None,
    part_removed: Annotated[
        bool,
        typer.Option(
            "--part-removed",
            rich_help_panel=AFTER_A_STOP,
            help="state that you took the part out of the grippers; journaled",
        ),
    ] = False,
    trays_empty: Annotated[
        bool,
        typer.Option(
            "--trays-empty",
            rich_help_panel=AFTER_A_STOP,
            help="state that the nests of all trays are empty; journaled",
        ),
    ] = False,
    auto_recover: Annotated[
        bool,
        typer.Option(
            "--auto-recover",
            rich_help_panel=AFTER_A_STOP,
            help="go on with a part in a gripper where that is proven safe",
        ),
    ] = False,
    record: Annotated[
        Path | None,
        typer.Option(
            "--record",
            metavar="FILE",
            help="record every byte and frame on the wires, with its time, for `cellctl replay "
            "--wires`",
        ),
    ] = None,
    wait: Annotated[
        bool,
        typer.Option(
            "--wait",
            help="wait for `cellctl answer` where a person has to decide, also without a terminal",
        ),
    ] = False,
    step: Annotated[
        bool,
        typer.Option(
            "--step",
            help="ask before each motion: Enter, or `cellctl answer go` from another terminal",
        ),
    ] = False,
    dry: Annotated[
        bool,
        typer.Option(
            "--dry",
            help="drive all motions without a part: clear of everything, at a tenth of the speed, "
            "grippers open; for the stable pose of --pose (default: the likeliest)",
        ),
    ] = False,
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
            rich_help_panel=EMULATED,
            help="CAD file of a part to put on the table; may be repeated "
            "(default: the part of each recipe)",
        ),
    ] = None,
    on_table: Annotated[
        int | None,
        typer.Option(
            "--on-table",
            metavar="N",
            min=1,
            rich_help_panel=EMULATED,
            help="parts on the table at a time; the next one comes once one is in its tray "
            "(default: all of them)",
        ),
    ] = None,
    empty: Annotated[
        bool, typer.Option("--empty", rich_help_panel=EMULATED, help="leave the table empty")
    ] = False,
    pose: EmulatedPoseOption = None,
    at: EmulatedAtOption = None,
    control: ControlOption = None,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
    verbose: Annotated[
        bool,
        typer.Option(
            "--verbose", "-v", help="log to stderr; print the details of an unexpected error"
        ),
    ] = False,
) -> None:
    """Inspect and sort parts: the main job.

    Devices that the cell file calls `emulated` start with the run. Ctrl-C stops the arm, releases
    nothing and reports where the part is.
    """
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
        papers=Papers(
            operator, lot, part_temperature_c=part_temperature, order_number=order.strip()
        ),
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
        typer.Option("--open", help="gripper to open while you hold the part; the arm stays still"),
    ] = None,
    accept: Annotated[
        bool,
        typer.Option(
            "--accept",
            help="go on with the part as proposed, by the recipe of the interrupted run, until it "
            "is in its tray",
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
    """After a crash: show where the part is and how to go on.

    Nothing moves before a person accepts the proposal or asks for a gripper to be opened.
    """
    with loading():
        from controller.cell.custody import GripperName

        from ..inputs.cell_files import cell_of_this_folder
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


class ReportFormat(StrEnum):
    """Format of a report."""

    HTML = "html"
    PDF = "pdf"
    JSON = "json"
    CSV = "csv"
    QIF = "qif"
    DFQ = "dfq"


class ReportLayout(StrEnum):
    """Layout of a printed report."""

    STANDARD = "standard"
    AS9102 = "as9102"


def report(
    run_name: Annotated[
        str | None, typer.Argument(metavar="RUN", help="name of the run (default: the newest)")
    ] = None,
    form: Annotated[
        ReportFormat, typer.Option("--format", help="format of the report")
    ] = ReportFormat.HTML,
    layout: Annotated[
        ReportLayout,
        typer.Option(
            "--layout",
            help="layout of HTML or PDF: `standard`, or `as9102`: the characteristics as in Form 3 "
            "of AS9102",
        ),
    ] = ReportLayout.STANDARD,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="file to write (default: report.FORMAT in the run's folder, with another layout "
            "report-LAYOUT.FORMAT; JSON to stdout)",
        ),
    ] = None,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Write the report of a run: HTML, PDF, JSON, CSV, QIF, Q-DAS.

    `dfq` is the Q-DAS format.
    """
    with loading():
        from .report_file import write_report

    raise typer.Exit(
        write_report(runs, run_name, "json" if json else form.value, output, layout.value)
    )
