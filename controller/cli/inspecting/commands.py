"""Arguments and help of `cellctl inspect`, `replay` and `verify`."""

from pathlib import Path
from typing import Annotated

import typer

from controller.loading import loading

from ..options import JsonOption, RunsOption


def inspect(
    views: Annotated[
        Path,
        typer.Argument(metavar="SET", help="set of views of one part (JSON, cellctl.views/1)"),
    ],
    recipe: Annotated[
        Path | None,
        typer.Option(
            "--recipe",
            metavar="RECIPE",
            help="recipe (YAML, or a name as in `run`) with the limits (default: the defaults of "
            "a recipe)",
        ),
    ] = None,
    report: Annotated[
        Path | None, typer.Option("--report", metavar="FILE", help="report to write (HTML)")
    ] = None,
    learned: Annotated[
        Path | None,
        typer.Option(
            "--learned",
            metavar="FILE",
            help="what good parts look like, as `cellctl learn` writes it (default: the recipe's)",
        ),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Judge stored pictures of one part, without any device.

    Prints each characteristic, each finding and the verdict. Only a pass ends with exit code 0.
    """
    with loading():
        from .stored_views import inspect_set

    raise typer.Exit(inspect_set(views, recipe, report, learned, as_json=json))


RunArg = Annotated[
    str | None,
    typer.Argument(metavar="RUN", help="name of the run, or its folder (default: the newest)"),
]


def replay(
    run_name: RunArg = None,
    recipe: Annotated[
        Path | None,
        typer.Option(
            "--recipe",
            metavar="RECIPE",
            help="recipe to judge by (YAML, or a name as in `run`) (default: the run's)",
        ),
    ] = None,
    wires: Annotated[
        Path | None,
        typer.Option(
            "--wires",
            metavar="FILE",
            help="run the controller on the wires recorded by `cellctl run --record`, instead of "
            "judging pictures",
        ),
    ] = None,
    cell: Annotated[
        Path | None,
        typer.Option(
            "--cell", metavar="FILE", help="with --wires: cell file (YAML) (default: the run's)"
        ),
    ] = None,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Judge a run's stored pictures again and list changes.

    With the run's own recipe every number is the same to the last bit. With --wires the whole
    controller runs on recorded wires, and the first byte that it sends differently is shown.
    """
    if wires is not None:
        if run_name is not None:
            raise typer.BadParameter("RUN and --wires exclude each other")
        with loading():
            from .replayed_wires import replay_wire_file

        raise typer.Exit(replay_wire_file(wires, recipe, cell, as_json=json))
    if cell is not None:
        raise typer.BadParameter("--cell requires --wires")
    with loading():
        from .replayed_run import replay_run

    raise typer.Exit(replay_run(runs, run_name, recipe, as_json=json))


def verify(
    run_name: RunArg = None,
    head: Annotated[
        str | None,
        typer.Option("--head", metavar="HASH", help="hash that was noted at the end of the run"),
    ] = None,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Verify that a run's files are unchanged.

    Names each picture, result and row of the journal that was changed.
    """
    with loading():
        from .verified_run import verify_run

    raise typer.Exit(verify_run(runs, run_name, head, as_json=json))
