"""Arguments and help of `cellctl stats` and `gauge`."""

from pathlib import Path
from typing import Annotated

import typer

from controller.loading import loading

from ..options import JsonOption, RunsOption, StoreOption


def stats(
    recipe: Annotated[
        str | None, typer.Argument(metavar="RECIPE", help="name of the recipe (default: all)")
    ] = None,
    by: Annotated[
        str | None,
        typer.Option(
            "--by",
            metavar="GROUP",
            help="group by day, run, recipe, lot, order, operator or cell, with --takt also by "
            "part (default without RECIPE: recipe)",
        ),
    ] = None,
    takt: Annotated[
        bool,
        typer.Option("--takt", help="how long the arm moved, and what it waited for"),
    ] = False,
    review: Annotated[
        bool,
        typer.Option(
            "--review",
            help="how often persons agree with the machine, and likely false alarms",
        ),
    ] = False,
    lot: Annotated[
        str, typer.Option(metavar="LOT", help="with --by, --takt or --review: parts of this lot")
    ] = "",
    order: Annotated[
        str,
        typer.Option(metavar="NUMBER", help="with --by, --takt or --review: parts of this order"),
    ] = "",
    operator: Annotated[
        str,
        typer.Option(metavar="NAME", help="with --by, --takt or --review: parts of this operator"),
    ] = "",
    cell_name: Annotated[
        str, typer.Option(metavar="NAME", help="with --by or --review: parts of this cell")
    ] = "",
    since: Annotated[
        str | None,
        typer.Option(
            metavar="DATE", help="with --by, --takt or --review: parts begun then or later (UTC)"
        ),
    ] = None,
    until: Annotated[
        str | None,
        typer.Option(
            metavar="DATE", help="with --by, --takt or --review: parts begun then or before (UTC)"
        ),
    ] = None,
    store: StoreOption = None,
    report: Annotated[
        Path | None,
        typer.Option("--report", metavar="FILE", help="page to write (HTML), with run charts"),
    ] = None,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Report process capability, yield, takt or reviews.

    Of a recipe, for each characteristic: count, mean, spread, Cp, Cpk, Pp and Ppk with their 95 %
    intervals, and the rules of Nelson that the values break. With --by, or of all recipes: yield,
    time against forecast, findings by kind and face, recoveries and alarms. With --review: how
    often persons agree with findings and verdicts. With --takt: how long the arm moved, and what
    it waited for.
    """
    if review:
        if takt or by or report:
            raise typer.BadParameter("--review cannot be combined with --takt, --by or --report")
        with loading():
            from .agreeing import report_agreement
            from .yields import Chosen

        chosen = Chosen(recipe or "", lot, order, operator, since, until, cell_name)
        raise typer.Exit(report_agreement(runs, store, chosen, as_json=json))
    if takt:
        with loading():
            from .takt_table import report_takt
            from .yields import Chosen

        if report or store or cell_name:
            raise typer.BadParameter(
                "--takt reads the journal of one cell: it cannot be combined with --store, "
                "--cell-name or --report"
            )
        chosen = Chosen(recipe or "", lot, order, operator, since, until)
        raise typer.Exit(report_takt(runs, chosen, by or "recipe", as_json=json))
    if recipe is None or by is not None:
        with loading():
            from .yields import Chosen, report_yields

        chosen = Chosen(recipe or "", lot, order, operator, since, until, cell_name)
        raise typer.Exit(report_yields(runs, store, chosen, by or "recipe", report, as_json=json))
    with loading():
        from .series_table import report_series

    if lot or order or operator or cell_name or since or until or store:
        raise typer.BadParameter(
            "--lot, --order, --operator, --cell-name, --since, --until and --store require --by"
        )
    raise typer.Exit(report_series(runs, recipe, report, as_json=json))


def gauge(
    sources: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[PART[/START[/GRASP]]=]SOURCE",
            help="set of views, or run by name or folder; before the = its part, start pose and "
            "grasp (default: by the run, one part, one grasp each)",
        ),
    ] = None,
    recipe: Annotated[
        Path | None,
        typer.Option("--recipe", metavar="RECIPE", help="recipe by which to measure sets of views"),
    ] = None,
    reference: Annotated[
        Path | None,
        typer.Option(
            "--reference",
            metavar="FILE",
            help="reference values (CSV: characteristic, value, U, part)",
        ),
    ] = None,
    report: Annotated[
        Path | None, typer.Option("--report", metavar="FILE", help="page to write (HTML)")
    ] = None,
    list_: Annotated[
        bool, typer.Option("--list", help="list the studies kept with the runs")
    ] = False,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Report the spread of the measurement itself (gauge study).

    From parts measured repeatedly, for each characteristic: six standard deviations in one grasp,
    with re-grasps and from other start poses, the share of the tolerance, ndc, bias, Cg and Cgk.
    The study is kept with the runs.
    """
    with loading():
        from .gauge_study import list_studies, report_gauge

    if list_:
        raise typer.Exit(list_studies(runs, as_json=json))
    raise typer.Exit(report_gauge(sources or [], recipe, reference, report, runs, as_json=json))
