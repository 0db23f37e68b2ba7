"""Arguments and help of `cellctl connect`, `deliveries` and `orders`."""

from pathlib import Path
from typing import Annotated

import typer

from controller.loading import loading

from ..options import EMULATED, CellOption, JsonOption, RunsOption, SeedOption

RUNS = Path("runs")


def connect(
    runs: RunsOption = RUNS,
    cell: CellOption = None,
    recipes: Annotated[
        Path | None,
        typer.Option(
            "--recipes",
            metavar="FOLDER",
            help="folder of the recipes that an order may name (default: this folder)",
        ),
    ] = None,
    from_start: Annotated[
        bool,
        typer.Option(
            "--from-start",
            help="a receiver that is new gets all results of the journal, not only those to come",
        ),
    ] = False,
    speed: Annotated[
        float,
        typer.Option(
            "--speed", metavar="X", min=0.1, max=100, rich_help_panel=EMULATED,
            help="times real time, of the runs that orders start",
        ),
    ] = 1.0,
    seed: SeedOption = None,
    json: JsonOption = False,
) -> None:  # fmt: skip
    """Connect the cell to a plant system: results out, orders in.

    Serves the wires that the cell file names under `connect` (docs/plant.md). May be ended at any
    time: the cell does not notice, and nothing is lost.
    """
    with loading():
        from .connecting import connect_cell

    raise typer.Exit(
        connect_cell(
            runs, cell, recipes or Path.cwd(), speed, seed, from_start=from_start, as_json=json
        )
    )


def deliveries(
    runs: RunsOption = RUNS,
    resume: Annotated[
        str,
        typer.Option(
            "--resume",
            metavar="RECEIVER",
            help="have a receiver go on from the journal's end as it is now",
        ),
    ] = "",
    drop: Annotated[
        str,
        typer.Option("--drop", metavar="KEY", help="forget a result that a receiver refused"),
    ] = "",
    json: JsonOption = False,
) -> None:
    """Show which results each plant system has, or has refused."""
    with loading():
        from .connecting import show_deliveries

    raise typer.Exit(show_deliveries(runs, resume, drop, as_json=json))


def orders(
    runs: RunsOption = RUNS,
    release: Annotated[
        list[str] | None,
        typer.Option(
            "--release",
            metavar="NUMBER",
            help="let an order start that asks for a person; may be repeated",
        ),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Show the orders of a plant system, or release some."""
    with loading():
        from .connecting import show_orders

    raise typer.Exit(show_orders(runs, tuple(release or ()), as_json=json))
