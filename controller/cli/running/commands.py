"""Arguments and help of `cellctl run`, `recover` and `report`."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from controller.loading import loading

from ..options import CellOption, JsonOption, RunsOption, from_fields
from .arguments import RunOptions


@from_fields
def run(options: RunOptions) -> None:
    """Inspect and sort parts: the main job.

    Devices that the cell file calls `emulated` start with the run. Ctrl-C stops the arm, releases
    nothing and reports where the part is.
    """
    with loading():
        from .recipe_run import quiet_logs, run_recipe

    quiet_logs(verbose=options.verbose)
    if options.parts_list is not None and options.recipes:
        raise typer.BadParameter(f"--parts-list names the recipes; leave out {options.recipes[0]}")
    if options.is_dry:
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
