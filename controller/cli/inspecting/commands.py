"""Arguments and help of `cellctl inspect`."""

from pathlib import Path
from typing import Annotated

import typer

from ..options import JsonOption


def inspect(
    views: Annotated[
        Path,
        typer.Argument(metavar="SET", help="set of views (JSON, cellctl.views/1) of one part"),
    ],
    recipe: Annotated[
        Path | None,
        typer.Option(
            "--recipe",
            metavar="RECIPE",
            help="recipe (YAML, or a name as in `run`) with the limits to judge by "
            "(default: a recipe's defaults)",
        ),
    ] = None,
    report: Annotated[
        Path | None, typer.Option("--report", metavar="FILE", help="report to write")
    ] = None,
    json: JsonOption = False,
) -> None:
    """Judge stored pictures of one part, without any device.

    Prints each characteristic, each finding and the verdict; ends with exit code 0 for a pass only.
    """
    from .stored_views import inspect_set

    raise typer.Exit(inspect_set(views, recipe, report, as_json=json))
