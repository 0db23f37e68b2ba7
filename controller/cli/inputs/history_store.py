"""The store of the history for commands: opened, filled, with a report of omissions."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, date, datetime, time, timedelta
from pathlib import Path

from controller.cell.journal import journals_in
from controller.config import ConfigError
from controller.history import HistoryError, Store, fill, open_store, store_url

from ..terminal.output import warn

NAMED_COUNT = 5  # problems printed one by one


@contextmanager
def filled_store(runs_dir: Path, named: str | None, *, anew: bool = False) -> Iterator[Store]:
    """Yield the store of a folder of runs, filled with the present content of its journals.

    Parameters
    ----------
    runs_dir : folder of all runs
    named : URL of the store; None for the one of the environment, else the folder's own
    anew : read the journals from their first row on

    Raises
    ------
    HistoryError : there is neither journal nor store, or the store cannot be opened
    """
    url = store_url(runs_dir, named, os.environ)
    own = url == store_url(runs_dir, None, {})
    if own and not journals_in(runs_dir) and not Path(url.removeprefix("sqlite:///")).is_file():
        raise HistoryError(
            f"no journal at {runs_dir}: nothing ran here yet; name the folder of runs with --runs"
        )
    store = open_store(url)
    try:
        problems = fill(store, runs_dir, anew=anew).problems
        for problem in problems[:NAMED_COUNT]:
            warn(f"history: {problem}")
        if len(problems) > NAMED_COUNT:
            warn(f"history: and {len(problems) - NAMED_COUNT} more")
        yield store
    finally:
        store.close()


def period(since: str | None, until: str | None) -> tuple[datetime | None, datetime | None]:
    """Return first and last instant of the options ``--since`` and ``--until``.

    Raises
    ------
    ConfigError : one is no date
    """
    return (
        None if since is None else instant(since, "--since"),
        None if until is None else instant(until, "--until", is_end=True),
    )


def instant(text: str, option: str, *, is_end: bool = False) -> datetime:
    """Return an instant, UTC without a zone, from a date or a date and time in ISO form.

    Parameters
    ----------
    text : without a zone it is UTC
    option : option by which it was given, for the message
    is_end : a date alone means the end of that day

    Raises
    ------
    ConfigError : it is no date
    """
    try:
        if len(text) == len("2026-03-01"):
            day = datetime.combine(date.fromisoformat(text), time())
            return day + timedelta(days=1) if is_end else day
        found = datetime.fromisoformat(text)
        return found.astimezone(UTC).replace(tzinfo=None) if found.tzinfo else found
    except (ValueError, OverflowError) as error:
        raise ConfigError(
            f"{option} {text}: must be a date such as 2026-03-01 or a time such as "
            "2026-03-01T14:30 (UTC)"
        ) from error
