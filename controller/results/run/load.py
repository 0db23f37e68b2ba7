"""Finds runs in a folder of runs and reads them; never writes."""

import sqlite3
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from controller.cell.journal import JOURNAL_NAME, JournalError, first_broken_row, read_rows
from messages import say

from ._fold import fold
from .model import ResultsError, RunRecord, UnknownRunError

# How many runs an error names, newest first.
NAMED_COUNT = 12


@dataclass(frozen=True, slots=True)
class RunSummary:
    """A run in the journal, and its number of rows."""

    run_id: str
    start: datetime
    rows: int


def whole_journal(runs_dir: Path) -> Path:
    """Return the journal of a folder of runs, for statistics over all runs.

    Raises
    ------
    ResultsError : no journal there, one that cannot be read, or one that was changed
    """
    path = runs_dir / JOURNAL_NAME
    if not path.is_file():
        raise ResultsError(f"no journal at {path}: name the folder of runs with --runs")
    try:
        broken = first_broken_row(path)
    except (JournalError, sqlite3.Error, ValueError) as error:
        raise ResultsError(say("journal {path}: {error}", path=path, error=error)) from error
    if broken is not None:
        raise ResultsError(
            f"journal {path}: the chain of hashes breaks at row {broken}; numbers that may "
            "have been changed make no statistics"
        )
    return path


def list_runs(runs_dir: Path) -> tuple[RunSummary, ...]:
    """Return the runs of a folder, newest first.

    Raises
    ------
    ResultsError : no journal there, or it cannot be read
    """
    path = runs_dir / JOURNAL_NAME
    if not path.is_file():
        raise ResultsError(
            f"no journal at {path}: nothing ran here yet; name the folder of runs with --runs"
        )
    try:
        # without the bodies of the rows, which a list of runs does not need
        db = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)
        try:
            rows = db.execute(
                "SELECT run, MIN(seq), MIN(t_utc), COUNT(*) FROM journal GROUP BY run "
                "ORDER BY MIN(seq) DESC"
            ).fetchall()
        finally:
            db.close()
    except sqlite3.Error as error:
        raise ResultsError(say("journal {path}: {error}", path=path, error=error)) from error
    return tuple(RunSummary(run, datetime.fromisoformat(t), count) for run, _, t, count in rows)


def load_run(runs_dir: Path, run: str | None = None) -> RunRecord:
    """Return the record of a run.

    Parameters
    ----------
    runs_dir : folder with the journal and the runs' own folders
    run : a run's id, an unambiguous beginning of it, or the path of its folder; None for the newest

    Raises
    ------
    UnknownRunError : no such run; the message names the runs there are
    ResultsError : none is named and there is none, or several begin so, or an unreadable journal
    """
    runs_dir, run_id = find_run(runs_dir, run)
    path = runs_dir / JOURNAL_NAME
    try:
        rows = tuple(read_rows(path, run_id))
        broken = first_broken_row(path)
    except (JournalError, sqlite3.Error) as error:
        raise ResultsError(say("journal {path}: {error}", path=path, error=error)) from error
    except ValueError as error:
        raise ResultsError(f"journal {path}: a row of {run_id} is no JSON: {error}") from error
    return fold(run_id, runs_dir / run_id, rows, broken)


def find_run(runs_dir: Path, run: str | None = None) -> tuple[Path, str]:
    """Return the folder of all runs that a run is in, and the run's id.

    Parameters
    ----------
    runs_dir, run : as `load_run` takes them

    Raises
    ------
    UnknownRunError, ResultsError : as in `load_run`
    """
    if run is not None and (Path(run).parent / JOURNAL_NAME).is_file() and Path(run).is_dir():
        runs_dir, run = Path(run).parent, Path(run).resolve().name
    return runs_dir, _choose(runs_dir, run)


def _choose(runs_dir: Path, run: str | None) -> str:
    if run is not None and not (runs_dir / JOURNAL_NAME).is_file():
        raise UnknownRunError(
            f"no run `{run}` in {runs_dir}: there is no journal; name the folder with --runs"
        )
    runs = [summary.run_id for summary in list_runs(runs_dir)]
    if run is None:
        if not runs:
            raise ResultsError(f"the journal in {runs_dir} is empty: nothing ran here yet")
        return runs[0]
    if run in runs:
        return run
    fitting = [name for name in runs if run and name.startswith(run)]
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        raise ResultsError(
            f"{len(fitting)} runs begin with `{run}` in {runs_dir}; name one: {_listed(fitting)}"
        )
    known = f"name one of {_listed(runs)}" if runs else "it has none yet"
    raise UnknownRunError(
        f"no run `{run}` in {runs_dir}: {known}, or name another folder with --runs"
    )


def _listed(runs: list[str]) -> str:
    more = f" and {len(runs) - NAMED_COUNT} more" if len(runs) > NAMED_COUNT else ""
    return f"{', '.join(runs[:NAMED_COUNT])}{more}"
