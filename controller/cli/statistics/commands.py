"""Arguments and help of `cellctl stats` and `gauge`."""

from pathlib import Path
from typing import Annotated

import typer

from controller.loading import loading

from ..options import JsonOption, RunsOption, from_fields
from .arguments import PartChoice, StatsOptions


@from_fields
def stats(options: StatsOptions) -> None:
    """Report process capability, yield, takt or reviews.

    Of a recipe, for each characteristic: count, mean, spread, Cp, Cpk, Pp and Ppk with their 95 %
    intervals, and the rules of Nelson that the values break. With --by, or of all recipes: yield,
    time against forecast, findings by kind and face, recoveries and alarms. With --review: how
    often persons agree with findings and verdicts. With --takt: how long the arm moved, and what
    it waited for.
    """
    chosen, by, report = options.chosen, options.by, options.report
    if options.review:
        if options.takt or by or report:
            raise typer.BadParameter("--review cannot be combined with --takt, --by or --report")
        with loading():
            from .agreeing import report_agreement

        raise typer.Exit(report_agreement(options))
    if options.takt:
        with loading():
            from .takt_table import report_takt

        if report or options.store_url or chosen.cell:
            raise typer.BadParameter(
                "--takt reads the journal of one cell: it cannot be combined with --store, "
                "--cell-name or --report"
            )
        raise typer.Exit(report_takt(options))
    if options.recipe is None or by is not None:
        with loading():
            from .yields import report_yields

        raise typer.Exit(report_yields(options))
    with loading():
        from .series_table import report_series

    if chosen != PartChoice() or options.store_url:
        raise typer.BadParameter(
            "--lot, --order, --operator, --cell-name, --since, --until and --store require --by"
        )
    raise typer.Exit(
        report_series(options.runs_dir, options.recipe, report, as_json=options.as_json)
    )


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
