"""Copies pictures of runs to a store of objects, and keeps the local ones as long as a cell asks.

A picture counts as copied once it was read back and found as the journal has it; a row says so. Of
a cell that copies its pictures, none is deleted before: its copy is read once more, just then.
Killed at any point, nothing is lost: an object without a row is found and noted the next time.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

from pydantic import BaseModel, Field, ValidationError

from controller.cell.journal import (
    JOURNAL_NAME,
    JournalError,
    Row,
    append_beside,
    first_broken_row,
    is_of,
    read_rows,
    rows,
)
from controller.results.run import (
    PICTURES,
    ChangedFileError,
    ObjectsError,
    ObjectStore,
    WrongObjectError,
    copies_in,
    list_runs,
    stored_files,
)

from ..errors import HistoryError
from ..store import Store
from .pictures import OldPictures, drop_pictures, old_pictures


class PictureRules(BaseModel, frozen=True, extra="ignore"):
    """What a cell asks for its pictures: `connect.pictures` of its file, as a run read it.

    Keys of later versions do not keep it from being read: what it asks must not be lost.

    Attributes
    ----------
    copy_to : address of a store of objects; empty for none
    keep_local_days : age from which pictures are deleted here [days]; None for never
    """

    copy_to: str = ""
    keep_local_days: float | None = Field(None, ge=0)


@dataclass(frozen=True, slots=True)
class Copied:
    """Pictures of a run that are in a store of objects.

    Attributes
    ----------
    files : their SHA-256 by name, relative to the run's folder
    problems : why others are not, in sentences
    """

    run: str
    to: str
    files: Mapping[str, str]
    problems: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Dropped:
    """Pictures of a run that were deleted here.

    Attributes
    ----------
    problems : why others were kept, in sentences
    """

    run: str
    files: tuple[str, ...]
    size: int
    problems: tuple[str, ...] = ()


def rules_now(runs_dir: Path) -> PictureRules:
    """Return what the cell asks for its pictures, as its newest run read it.

    Raises
    ------
    HistoryError : the journal cannot be read
    ResultsError : there is no journal
    """
    for one in list_runs(runs_dir):
        for row in _rows(runs_dir, one.run_id):
            if is_of(row, rows.RunBegan):
                return _rules(row)
    return PictureRules()


def copy_pictures(runs_dir: Path, to: str, who: str) -> Iterator[Copied]:
    """Copy the pictures of all runs that have ended; yield each run with pictures to copy.

    Parameters
    ----------
    runs_dir : folder of all runs
    to : address of the store of objects
    who : decided it

    Raises
    ------
    ObjectsError : the store of objects cannot be opened or written; what was copied is noted
    HistoryError : the journal cannot be read or written, or is broken
    ResultsError : there is no journal
    """
    store = ObjectStore(to)
    _require_whole(runs_dir)
    runs = [one.run_id for one in list_runs(runs_dir)]
    for run in reversed(runs):
        found = _rows(runs_dir, run)
        ends = [row for row in found if is_of(row, rows.RunEnded) or is_of(row, rows.RunBrokeOff)]
        if not ends and run == runs[0]:
            continue  # it may be running: its pictures are copied after it
        copied = copies_in(found)
        known = {
            file: digest
            for file, (digest, _) in stored_files(found).items()
            if _is_picture(file) and (file not in copied or copied[file].to != store.url)
        }
        there = {f: digest for f, digest in known.items() if (runs_dir / run / f).is_file()}
        if there:
            yield _copy(store, runs_dir, run, there, who)


def keep_pictures(
    store: Store, runs_dir: Path, now: datetime, who: str
) -> Iterator[Copied | Dropped]:
    """Copy new pictures, then delete old ones here, as the cell asks; yield what was done.

    Parameters
    ----------
    store : filled
    runs_dir : folder of all runs
    now : UTC, without a zone
    who : decided it

    Raises
    ------
    ObjectsError : the store of objects cannot be opened or written; what was copied is noted
    HistoryError : the journal cannot be read or written, or is broken
    ResultsError : there is no journal
    OSError : a file cannot be deleted
    """
    rules = rules_now(runs_dir)
    if rules.copy_to:
        yield from copy_pictures(runs_dir, rules.copy_to, who)
    if rules.keep_local_days is not None:
        before = now - timedelta(days=rules.keep_local_days)
        for old in old_pictures(store, runs_dir, before):
            yield drop_copied(runs_dir, old, before, who)


def drop_copied(runs_dir: Path, old: OldPictures, before: datetime, who: str) -> Dropped:
    """Delete pictures of a run, and return those deleted and why others stay.

    Of a cell that copies its pictures, one goes if its copy is found whole.

    Parameters
    ----------
    runs_dir : folder of all runs
    old : pictures to delete
    before : the time that was named
    who : decided it

    Raises
    ------
    HistoryError : the journal cannot be read or written, or is broken
    OSError : a file cannot be deleted
    """
    found = _rows(runs_dir, old.run)
    began = next((_rules(row) for row in found if is_of(row, rows.RunBegan)), PictureRules())
    if not (began.copy_to or rules_now(runs_dir).copy_to):
        drop_pictures(runs_dir, old, before, who)
        return Dropped(old.run, old.files, old.size)
    copies, problems, files = copies_in(found), [], []
    by_store: dict[str, list[str]] = {}
    for file in old.files:
        by_store.setdefault(copies[file].to if file in copies else "", []).append(file)
    if missing := by_store.pop("", []):
        problems.append(f"{old.run}: {len(missing)} pictures are not copied yet; they stay here")
    for to, wanted in by_store.items():
        try:
            store = ObjectStore(to)
            for file in wanted:
                try:
                    store.put(runs_dir / old.run / file, copies[file].sha256, file)
                except (ChangedFileError, WrongObjectError, OSError) as error:
                    problems.append(f"{error}; the picture stays here")
                else:
                    files.append(file)
        except ObjectsError as error:  # no use to ask it for the rest
            problems.append(f"{error}; pictures of {old.run} that it was not asked for stay here")
    size = sum((runs_dir / old.run / file).stat().st_size for file in files)
    if files:
        drop_pictures(runs_dir, OldPictures(old.run, tuple(files), size), before, who)
    return Dropped(old.run, tuple(files), size, tuple(problems))


def _copy(
    store: ObjectStore, runs_dir: Path, run: str, files: Mapping[str, str], who: str
) -> Copied:
    """Copy pictures of a run and note those that are there, also if it breaks off."""
    done: dict[str, str] = {}
    problems = []
    try:
        for file, digest in files.items():
            try:
                store.put(runs_dir / run / file, digest, file)
            except (ChangedFileError, OSError) as error:
                problems.append(str(error))
            else:
                done[file] = digest
    finally:
        if done:
            row = rows.PicturesCopied(to=store.url, files=done, who=who)
            try:
                append_beside(runs_dir / JOURNAL_NAME, run, row)
            except JournalError as error:
                raise HistoryError(str(error)) from error
    return Copied(run, store.url, done, tuple(problems))


def _is_picture(file: str) -> bool:
    return file.split("/", 1)[0] == PICTURES


def _rules(row: Row) -> PictureRules:
    """Return what the cell asked for when a run began; nothing in journals of older versions.

    Raises
    ------
    HistoryError : it cannot be told
    """
    cell = row.body.get("cell")
    connect = cell.get("connect") if isinstance(cell, Mapping) else None
    asked = connect.get("pictures") if isinstance(connect, Mapping) else None
    try:
        return PictureRules.model_validate(asked or {})
    except ValidationError as error:
        raise HistoryError(
            f"journal row {row.seq}: `connect.pictures` of the cell cannot be read, so no picture "
            "is copied or deleted"
        ) from error


def _rows(runs_dir: Path, run: str) -> list[Row]:
    try:
        return list(read_rows(runs_dir / JOURNAL_NAME, run))
    except JournalError as error:
        raise HistoryError(str(error)) from error


def _require_whole(runs_dir: Path) -> None:
    path = runs_dir / JOURNAL_NAME
    try:
        broken = first_broken_row(path)
    except JournalError as error:
        raise HistoryError(str(error)) from error
    if broken is not None:
        raise HistoryError(f"journal {path}: row {broken} is broken, so nothing is added to it")
