"""Arguments and help of `cellctl stats` and `gauge`."""

from pathlib import Path
from typing import Annotated

import typer

from ..options import JsonOption, RunsOption


def stats(
    recipe: Annotated[str, typer.Argument(metavar="RECIPE", help="name of the recipe")],
    report: Annotated[
        Path | None,
        typer.Option("--report", metavar="FILE", help="page (HTML) with run charts to write"),
    ] = None,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Report how the measured values of a recipe's parts scatter.

    For each characteristic: count, mean, spread, Cp, Cpk, Pp and Ppk with their 95 % intervals,
    and the rules of Nelson that the values break.
    """
    from .series_table import report_series

    raise typer.Exit(report_series(runs, recipe, report, as_json=json))


def gauge(
    sources: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[PART[/START[/GRASP]]=]SOURCE",
            help="sets of views, and runs by name or folder; before the = which part it is, from "
            "which start pose, in which grasp (default: by the run, one part, a grasp each)",
        ),
    ] = None,
    recipe: Annotated[
        Path | None,
        typer.Option("--recipe", metavar="RECIPE", help="recipe to measure sets of views by"),
    ] = None,
    reference: Annotated[
        Path | None,
        typer.Option(
            "--reference",
            metavar="FILE",
            help="true values (CSV: characteristic, value, U, part)",
        ),
    ] = None,
    report: Annotated[
        Path | None, typer.Option("--report", metavar="FILE", help="page (HTML) to write")
    ] = None,
    list_: Annotated[
        bool, typer.Option("--list", help="list the studies that are kept with the runs")
    ] = False,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Report what the measuring itself scatters, from parts measured again.

    For each characteristic: six standard deviations in one grasp, with re-grasps and from other
    start poses, the share of the tolerance, ndc, bias, Cg and Cgk. The study is kept with the runs.
    """
    from .gauge_study import list_studies, report_gauge

    if list_:
        raise typer.Exit(list_studies(runs, as_json=json))
    raise typer.Exit(report_gauge(sources or [], recipe, reference, report, runs, as_json=json))
