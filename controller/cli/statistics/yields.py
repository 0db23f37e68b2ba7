"""`cellctl stats --by`: yield, time against forecast, findings and recoveries, from the history."""

from dataclasses import dataclass
from pathlib import Path

from controller.config import ConfigError
from controller.history import GROUPS, Filters, figures

from ..inputs.history_store import filled_store, instant
from ..terminal.figures_table import print_figures


@dataclass(frozen=True, slots=True)
class Chosen:
    """The selection of parts, as words of the command line."""

    recipe: str = ""
    lot: str = ""
    order_number: str = ""
    operator: str = ""
    since: str | None = None
    until: str | None = None
    cell: str = ""

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
            cell=self.cell,
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
    print_figures(found, by, as_json=as_json)
    return 0
