"""`cellctl stats --takt`: the use of the arm's time, from the journal."""

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC

from rich import box
from rich.table import Table

from controller.config import ConfigError
from controller.history import Filters
from controller.results.takt import (
    BUSY,
    GROUPS,
    PartTakt,
    RunTakt,
    TaktGroup,
    TimeUse,
    grouped,
    takt_json,
    takts_of,
)
from controller.results.wording import num

from ..terminal.figures_table import print_table
from ..terminal.output import emit, print_line
from .arguments import StatsOptions
from .yields import filters_of

TEXT_COLUMNS = 200
COLUMNS = ("parts", "none", "s a part", "of forecast", "busy", "execute")


def report_takt(options: StatsOptions) -> int:
    """Print the use of the arm's time, group by group; return the exit code.

    Raises
    ------
    ConfigError : there is no such group, or a date is none
    ResultsError : no journal, or one that cannot be read
    """
    by = options.by or "recipe"
    if by not in GROUPS:
        raise ConfigError(f"--by {by}: with --takt it must be one of {', '.join(GROUPS)}")
    filters = filters_of(options)
    of_it = (of_recipe(one, filters.recipe) for one in takts_of(options.runs_dir))
    runs = [run for run in of_it if _fits(run, filters)]
    groups = grouped(runs, by)
    if options.as_json:
        for group in groups:
            emit({"event": "takt", "by": by, **takt_json(group)})
    elif not groups:
        print_line("no part fits")
    else:
        used = [use for use in TimeUse if any(shown(group.seconds[use]) for group in groups)]
        columns = (by, *COLUMNS, *(use.value.replace("_", " ") for use in used), "")
        rows = [_row(group, used) for group in groups]
        print_table(Table(box=box.SIMPLE_HEAD), columns, rows, TEXT_COLUMNS)
        print_line(
            f"cell seconds; busy is {', '.join(use.value for use in TimeUse if use in BUSY)}, as a "
            "share of Execute; rest is what no rule names"
        )
    return 0


def _fits(run: RunTakt, filters: Filters) -> bool:
    start = run.start.astimezone(UTC).replace(tzinfo=None)  # as filters have it
    return (
        (bool(run.parts) or filters.recipe in ("", run.recipe))
        and filters.lot in ("", run.lot)
        and filters.order_number in ("", run.order_number)
        and filters.operator in ("", run.operator)
        and (filters.since is None or start >= filters.since)
        and (filters.until is None or start < filters.until)
    )


def of_recipe(run: RunTakt, recipe: str) -> RunTakt:
    """Return a run with the parts of one recipe alone; whole if that is empty.

    Parameters
    ----------
    run : run of one or several recipes
    recipe : its name
    """
    parts = tuple(part for part in run.parts if recipe in ("", part.recipe))
    # what belongs to no part belongs to all of the run
    around = run.around if len(parts) == len(run.parts) else PartTakt(0)
    return replace(run, parts=parts, around=around)


def shown(seconds: float) -> str:
    """Return seconds for a table; empty if they round to none."""
    return num(seconds) if seconds >= 0.05 else ""


def _row(group: TaktGroup, used: Sequence[TimeUse]) -> tuple[str, ...]:
    share = group.busy_share
    is_timed = group.forecast_s > 0 and group.has_cell_clock
    ratio = group.forecast_took_s / group.forecast_s if is_timed else None
    return (
        group.name or "(none)",
        str(group.part_count),
        str(group.unjudged_count),
        num(group.part_s),
        "–" if ratio is None else f"{100 * ratio:.0f} %",
        "–" if share is None else f"{100 * share:.1f} %",
        num(group.execute_s),
        *(shown(group.seconds[use]) for use in used),
        "" if group.has_cell_clock else "by the wall clock",
    )
