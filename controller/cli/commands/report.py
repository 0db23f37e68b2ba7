"""`cellctl report`: what it takes."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from .options import JsonOption, RunsOption

EXAMPLE = "cellctl report --format json"


class Form(StrEnum):
    """What a report is written as."""

    HTML = "html"
    JSON = "json"


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
            help="file to write (default: report.html in the run's folder; JSON to stdout)",
        ),
    ] = None,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Write the report of a run."""
    from ..running.report_file import write_report

    raise typer.Exit(write_report(runs, run_name, "json" if json else form.value, output))
