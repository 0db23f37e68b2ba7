"""The command line of `cellctl stats`."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import typer

from ..options import JsonOption, RunsOption, StoreOption


@dataclass(frozen=True, slots=True, kw_only=True)
class PartChoice:
    """The options that select parts, beside their recipe."""

    lot: Annotated[
        str,
        typer.Option(
            "--lot", metavar="LOT", help="with --by, --takt or --review: parts of this lot"
        ),
    ] = ""
    order_number: Annotated[
        str,
        typer.Option(
            "--order", metavar="NUMBER", help="with --by, --takt or --review: parts of this order"
        ),
    ] = ""
    operator: Annotated[
        str,
        typer.Option(
            "--operator",
            metavar="NAME",
            help="with --by, --takt or --review: parts of this operator",
        ),
    ] = ""
    cell: Annotated[
        str,
        typer.Option(
            "--cell-name", metavar="NAME", help="with --by or --review: parts of this cell"
        ),
    ] = ""
    since: Annotated[
        str | None,
        typer.Option(
            "--since",
            metavar="DATE",
            help="with --by, --takt or --review: parts begun then or later (UTC)",
        ),
    ] = None
    until: Annotated[
        str | None,
        typer.Option(
            "--until",
            metavar="DATE",
            help="with --by, --takt or --review: parts begun then or before (UTC)",
        ),
    ] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class StatsOptions:
    """The command line of `cellctl stats`; what each option is stands in its help."""

    recipe: Annotated[
        str | None, typer.Argument(metavar="RECIPE", help="name of the recipe (default: all)")
    ] = None
    by: Annotated[
        str | None,
        typer.Option(
            "--by",
            metavar="GROUP",
            help="group by day, run, recipe, lot, order, operator or cell, with --takt also by "
            "part (default without RECIPE: recipe)",
        ),
    ] = None
    takt: Annotated[
        bool,
        typer.Option("--takt", help="how long the arm moved, and what it waited for"),
    ] = False
    review: Annotated[
        bool,
        typer.Option(
            "--review",
            help="how often persons agree with the machine, and likely false alarms",
        ),
    ] = False
    chosen: PartChoice = field(default_factory=PartChoice)
    store_url: StoreOption = None
    report: Annotated[
        Path | None,
        typer.Option("--report", metavar="FILE", help="page to write (HTML), with run charts"),
    ] = None
    runs_dir: RunsOption = Path("runs")
    as_json: JsonOption = False
