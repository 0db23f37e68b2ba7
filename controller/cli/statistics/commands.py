"""Arguments and help of `cellctl stats`."""

from pathlib import Path
from typing import Annotated

import typer

from ..options import JsonOption, RunsOption


def stats(
    recipe: Annotated[str, typer.Argument(metavar="RECIPE", help="name of the recipe")],
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Report how the measured values of a recipe's parts scatter.

    For each characteristic: count, mean, spread, Cp, Cpk, Pp and Ppk with their 95 % intervals,
    and the rules of Nelson that the values break.
    """
    from .series_table import report_series

    raise typer.Exit(report_series(runs, recipe, as_json=json))
