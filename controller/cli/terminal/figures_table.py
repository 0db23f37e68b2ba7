"""Figures of the history as tables for people, or as JSON lines."""

from collections.abc import Iterable, Sequence

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from controller.history import EventCount, Figures, Group, group_json, tally_json
from controller.results.wording import num

from .output import emit, print_line, printable, stdout

TEXT_COLUMNS = 200
NAMED_COUNT = 20  # findings, recoveries and alarms that are listed, most frequent first
COLUMNS = (
    "parts", "pass", "fail", "indet.", "none", "first pass", "s a part", "of forecast", "findings",
    "recoveries",
)  # fmt: skip


def print_figures(found: Figures, by: str, *, as_json: bool) -> None:
    """Print figures, group by group, and what was counted.

    Parameters
    ----------
    found : figures to print
    by : definition of a group
    as_json : print JSON lines instead of tables
    """
    if as_json:
        _emit(found, by)
    elif not found.groups:
        print_line("no part fits")
    else:
        _print(found, by)


def print_table(
    table: Table, columns: Sequence[str], rows: Iterable[Sequence[str]], text_columns: int
) -> None:
    """Print a table of numbers between a name and a note, wide if there is no terminal.

    Parameters
    ----------
    table : empty, with its style
    columns : headings
    rows : rows of the table
    text_columns : width where there is no terminal
    """
    for i, name in enumerate(columns):
        is_number = 0 < i < len(columns) - 1
        table.add_column(Text(name), justify="right" if is_number else "left", no_wrap=is_number)
    for row in rows:
        # as Text: rich would read brackets as markup
        table.add_row(*(Text(printable(cell, stdout.encoding)) for cell in row))
    console = stdout
    if not stdout.is_terminal:
        console = Console(file=stdout.file, width=text_columns, highlight=False)
    console.print(table)


def _emit(found: Figures, by: str) -> None:
    for group in found.groups:
        emit({"event": "group", "by": by, **group_json(group)})
    for what, tallies in _tallies(found).items():
        for tally in tallies:
            emit({"event": what, **tally_json(what, tally)})


def _tallies(found: Figures) -> dict[str, tuple[EventCount, ...]]:
    return {"finding": found.findings, "recovery": found.recoveries, "alarm": found.alarms}


def _print(found: Figures, by: str) -> None:
    rows = [_row(group) for group in found.groups]
    print_table(Table(box=box.SIMPLE_HEAD), (by, *COLUMNS, ""), rows, TEXT_COLUMNS)
    for what, tallies in _tallies(found).items():
        for tally in tallies[:NAMED_COUNT]:
            names = " · ".join(name for name in tally.names if name)
            print_line(f"{what:9}{tally.count:5}  {names}")
        if len(tallies) > NAMED_COUNT:
            print_line(f"{'':9}{'':5}  and {len(tallies) - NAMED_COUNT} more kinds (--json)")


def _row(group: Group) -> tuple[str, ...]:
    share, ratio = group.first_pass_yield, group.against_forecast
    emulated = group.emulated_count
    note = "" if not emulated else "emulated" if emulated == group.part_count else "partly emulated"
    return (
        group.name or "(none)",
        str(group.part_count),
        str(group.pass_count),
        str(group.fail_count),
        str(group.indeterminate_count),
        str(group.part_count - group.judged_count),
        "–" if share is None else f"{100 * share:.1f} %",
        num(group.part_s),
        "–" if ratio is None else f"{100 * ratio:.0f} %",
        str(group.finding_count),
        str(group.recovery_count),
        note,
    )
