"""Makes room: deletes pictures of old runs, and notes it in the journal before it does.

Verdicts, values, findings and the pictures' hashes stay in the journal, which loses nothing.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from sqlalchemy import func, select

from controller.cell.journal import (
    JOURNAL_NAME,
    JournalError,
    append_beside,
    first_broken_row,
    read_rows,
    rows,
)
from controller.results.run import stored_files

from ..errors import HistoryError
from ..filling import journals_by_key
from ..store import Store
from ..tables import JOURNALS, RUNS
from .backup import PICTURES


@dataclass(frozen=True, slots=True)
class OldPictures:
    """Pictures of a run that may be deleted: those that its journal knows.

    Attributes
    ----------
    files : relative to the run's folder
    size : size of all of them [bytes]
    """

    run: str
    files: tuple[str, ...]
    size: int


def old_pictures(store: Store, runs_dir: Path, before: datetime) -> Iterator[OldPictures]:
    """Yield the pictures of runs that ended before a time; never those of the newest run.

    Parameters
    ----------
    store : filled
    runs_dir : folder of all runs
    before : UTC, without a zone

    Raises
    ------
    HistoryError : the store or the journal cannot be read
    """
    # other cells may fill the same store
    journals = journals_by_key(runs_dir)
    is_here = JOURNALS.c.key.in_([key for key, one in journals.items() if one.name == JOURNAL_NAME])
    newest = select(func.max(RUNS.c.start)).join(JOURNALS).where(is_here).scalar_subquery()
    query = (
        select(RUNS.c.run_id)
        .join(JOURNALS)
        .where(RUNS.c.end < before, RUNS.c.start < newest, is_here)
        .order_by(RUNS.c.start)
    )
    with store.reading() as db:
        runs = [str(run) for run in db.execute(query).scalars()]
    for run in runs:
        folder = runs_dir / run
        if not (folder / PICTURES).is_dir() or (folder / PICTURES).is_symlink():
            continue
        try:
            known = stored_files(list(read_rows(runs_dir / JOURNAL_NAME, run)))
        except JournalError as error:
            raise HistoryError(str(error)) from error
        there = [one for one in sorted((folder / PICTURES).rglob("*")) if one.is_file()]
        files = {one.relative_to(folder).as_posix(): one.stat().st_size for one in there}
        kept = {name: size for name, size in files.items() if name in known}
        if kept:
            yield OldPictures(run, tuple(kept), sum(kept.values()))


def drop_pictures(runs_dir: Path, old: OldPictures, before: datetime, who: str) -> None:
    """Delete pictures of a run, once the journal has them noted as deleted on the disk.

    Parameters
    ----------
    runs_dir : folder of all runs
    old : rows to delete
    before : the time that was named
    who : decided it

    Raises
    ------
    HistoryError : the journal cannot be written, or is broken and so must not be
    OSError : a file cannot be deleted
    """
    path = runs_dir / JOURNAL_NAME
    try:
        broken = first_broken_row(path)
        if broken is not None:
            raise HistoryError(f"journal {path}: row {broken} is broken, so nothing is deleted")
        row = rows.PicturesDropped(before=before.isoformat(), files=old.files, who=who)
        append_beside(path, old.run, row)
    except JournalError as error:
        raise HistoryError(str(error)) from error
    for name in old.files:
        (runs_dir / old.run / name).unlink(missing_ok=True)
