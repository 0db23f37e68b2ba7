"""`cellctl stats`: a line for each characteristic, from the journal."""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from rich import box
from rich.table import Table

from controller.results.statistics import (
    Series,
    interval_words,
    series_json,
    series_notes,
    series_of,
    write_series_page,
)

from ..terminal.figures_table import print_table
from ..terminal.output import emit, print_line, warn
from ._output import check_page

TEXT_COLUMNS = 200
COLUMNS = ("characteristic", "n", "missing", "mean", "sigma", "Cp", "Cpk", "Pp", "Ppk", "to note")


def report_series(runs_dir: Path, recipe: str, report: Path | None, *, as_json: bool) -> int:
    """Print the statistics of a recipe's parts; return the exit code.

    Parameters
    ----------
    runs_dir : folder of all runs
    recipe : its name
    report : page with charts to write; None for none
    as_json : print JSON lines instead of a table

    Raises
    ------
    ConfigError : the page cannot have that name, or be written there
    ResultsError : there is no such recipe, or the journal cannot be trusted
    """
    check_page(report)
    found = series_of(runs_dir, recipe)
    if as_json:
        for series in found:
            emit({"event": "characteristic", **series_json(series)})
    else:
        _print(found, recipe)
    if report is not None:
        write_series_page(recipe, found, datetime.now(UTC), report)
        (warn if as_json else print_line)(f"report: {report}")
    return 0


def _print(found: Sequence[Series], recipe: str) -> None:
    if not found:
        print_line(f"no characteristic was measured in the runs of {recipe}")
        return
    print_table(Table(box=box.SIMPLE_HEAD), COLUMNS, map(_row, found), TEXT_COLUMNS)


def _row(series: Series) -> tuple[str, ...]:
    found, chart = series.capability, series.chart
    notes = series_notes(series)
    broken = sorted({signal.rule for signal in chart.signals}) if chart else []
    if broken:
        notes.append(f"Nelson's rule {', '.join(map(str, broken))}")
    return (
        series.label or series.id,
        str(found.n),
        str(series.missing),
        _number(found.mean),
        _number(found.sigma, 4),
        *(interval_words(index) for index in (found.cp, found.cpk, found.pp, found.ppk)),
        "; ".join(notes),
    )


def _number(value: float | None, decimals: int = 3) -> str:
    return "-" if value is None else f"{value:.{decimals}f}"
