"""`cellctl stats --by`: yield, time against forecast, findings and recoveries, from the history."""

from dataclasses import dataclass
from pathlib import Path

from rich import box
from rich.table import Table

from controller.config import ConfigError
from controller.history import (
    GROUPS,
    EventCount,
    Figures,
    Filters,
    Group,
    figures,
    group_json,
    tally_json,
)
from controller.results.wording import num

from ..inputs.history_store import filled_store, instant
from ..terminal.output import emit, print_line
from ._output import print_table

TEXT_COLUMNS = 200
NAMED_COUNT = 20  # findings, recoveries and alarms that are listed, most frequent first
COLUMNS = (
    "parts", "pass", "fail", "indet.", "none", "first pass", "s a part", "of forecast", "findings",
    "recoveries",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Chosen:
    """The selection of parts, as words of the command line."""

    recipe: str = ""
    lot: str = ""
    order_number: str = ""
    operator: str = ""
    since: str | None = None
    until: str | None = None

    def filters(self) -> Filters:
        """Return the store's filters for these options.

        Raises
        ------
        ConfigError : a date is none
        """
        return Filters(
            recipe=self.recipe,
            lot=self.lot,
            order_number=self.order_number,
            operator=self.operator,
            since=None if self.since is None else instant(self.since, "--since"),
            until=None if self.until is None else instant(self.until, "--until", is_end=True),
        )


def report_yields(
    runs_dir: Path, url: str | None, chosen: Chosen, by: str, report: Path | None, *, as_json: bool
) -> int:
    """Print the figures of parts, group by group; return the exit code.

    Parameters
    ----------
    runs_dir : folder of all runs
    url : URL of the store; None for the folder's own
    chosen : parts to count
    by : definition of a group
    report : a page, which only the statistics of a recipe have
    as_json : print JSON lines instead of tables

    Raises
    ------
    ConfigError : there is no such group, a date is none, or a page is wanted
    HistoryError : there is nothing to read
    """
    if by not in GROUPS:
        raise ConfigError(f"--by {by}: must be one of {', '.join(GROUPS)}")
    if report is not None:
        raise ConfigError(f"--report {report}: requires RECIPE, and cannot be combined with --by")
    filters = chosen.filters()
    with filled_store(runs_dir, url) as store:
        found = figures(store, filters, by)
    if as_json:
        _emit(found, by)
    elif not found.groups:
        print_line("no part fits")
    else:
        _print(found, by)
    return 0


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
