"""`cellctl stats`: a line for each characteristic, from the journal."""

from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from controller.results.statistics import Interval, Series, series_json, series_of

from ..terminal.output import emit, print_line, printable, stdout

TEXT_COLUMNS = 200
COLUMNS = ("characteristic", "n", "missing", "mean", "sigma", "Cp", "Cpk", "Pp", "Ppk", "to note")


def report_series(runs_dir: Path, recipe: str, *, as_json: bool) -> int:
    """Print the statistics of a recipe's parts; return the exit code.

    Parameters
    ----------
    runs_dir : folder of all runs
    recipe : its name
    as_json : print JSON lines instead of a table
    """
    found = series_of(runs_dir, recipe)
    if as_json:
        for series in found:
            emit({"event": "characteristic", **series_json(series)})
        return 0
    if not found:
        print_line(f"no characteristic was measured in the runs of {recipe}")
        return 0
    table = Table(box=box.SIMPLE_HEAD)
    for i, name in enumerate(COLUMNS):
        is_number = 0 < i < len(COLUMNS) - 1
        table.add_column(Text(name), justify="right" if is_number else "left", no_wrap=is_number)
    for series in found:
        table.add_row(*(Text(printable(text, stdout.encoding)) for text in _row(series)))
    console = stdout
    if not stdout.is_terminal:
        console = Console(file=stdout.file, width=TEXT_COLUMNS, highlight=False)
    console.print(table)
    return 0


def _row(series: Series) -> tuple[str, ...]:
    found, chart = series.capability, series.chart
    notes = [found.note] if found.note else []
    if series.is_changed:
        notes.append("limits changed on the way")
    broken = sorted({signal.rule for signal in chart.signals}) if chart else []
    if broken:
        notes.append(f"Nelson's rule {', '.join(map(str, broken))}")
    return (
        series.label or series.id,
        str(found.n),
        str(series.missing),
        _number(found.mean),
        _number(found.sigma, 4),
        *(_interval(index) for index in (found.cp, found.cpk, found.pp, found.ppk)),
        "; ".join(notes),
    )


def _number(value: float | None, decimals: int = 3) -> str:
    return "-" if value is None else f"{value:.{decimals}f}"


def _interval(index: Interval | None) -> str:
    if index is None:
        return "-"
    return f"{index.value:.2f} ({index.lower:.2f} to {index.upper:.2f})"
