"""`cellctl stats --by`: yield, time against forecast, findings and recoveries, from the history."""

from controller.config import ConfigError
from controller.history import GROUPS, Filters, figures

from ..inputs.history_store import filled_store, period
from ..terminal.figures_table import print_figures
from .arguments import StatsOptions


def filters_of(options: StatsOptions) -> Filters:
    """Return the store's filters for options of the command line.

    Raises
    ------
    ConfigError : a date is none
    """
    chosen = options.chosen
    since, until = period(chosen.since, chosen.until)
    return Filters(
        recipe=options.recipe or "",
        lot=chosen.lot,
        order_number=chosen.order_number,
        operator=chosen.operator,
        cell=chosen.cell,
        since=since,
        until=until,
    )


def report_yields(options: StatsOptions) -> int:
    """Print the figures of parts, group by group; return the exit code.

    Raises
    ------
    ConfigError : there is no such group, a date is none, or a page is wanted
    HistoryError : there is nothing to read
    """
    by, report = options.by or "recipe", options.report
    if by not in GROUPS:
        raise ConfigError(f"--by {by}: must be one of {', '.join(GROUPS)}")
    if report is not None:
        raise ConfigError(f"--report {report}: requires RECIPE, and cannot be combined with --by")
    filters = filters_of(options)
    with filled_store(options.runs_dir, options.store_url) as store:
        found = figures(store, filters, by)
    print_figures(found, by, as_json=options.as_json)
    return 0
