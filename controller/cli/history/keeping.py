"""`cellctl backup`: write a backup, or restore one. `cellctl history`: make room."""

import getpass
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from pathlib import Path

from controller.config import ConfigError
from controller.history.keeping import (
    Copied,
    Dropped,
    back_up,
    copy_pictures,
    drop_copied,
    keep_pictures,
    old_pictures,
    restore,
    rules_now,
)
from controller.results.run import RunPictures, load_run
from controller.results.wording import count_of, utc

from ..inputs.checks import check_writable_folder
from ..inputs.history_store import filled_store, instant
from ..terminal.output import emit, print_line, warn


def write_backup(file: Path, runs_dir: Path, *, with_pictures: bool, as_json: bool) -> int:
    """Write a backup and return the exit code.

    Parameters
    ----------
    file : file to write
    runs_dir : folder of all runs
    with_pictures : pictures of the runs, too
    as_json : print a JSON line

    Raises
    ------
    ConfigError : no file can be written there
    HistoryError : there is nothing to back up, or it cannot be read
    """
    if file.is_dir():
        raise ConfigError(f"{file}: is a directory; name a file in it")
    check_writable_folder(file.parent, "backup in")
    done = back_up(runs_dir, file, with_pictures=with_pictures)
    for name in done.left_out:
        warn(f"left out, as it could not be read: {name}")
    if as_json:
        emit({"event": "backup", "file": str(file), "files": done.file_count, "bytes": done.size})
    else:
        print_line(
            f"backup: {file}, {count_of(done.file_count, 'file')}, {done.size / 1e6:.1f} MB, "
            "read again and found as written"
        )
    return 1 if done.left_out else 0


def read_backup(file: Path, runs_dir: Path, *, as_json: bool) -> int:
    """Restore a backup and return the exit code.

    Parameters
    ----------
    file : the backup
    runs_dir : folder to restore to, new or empty
    as_json : print a JSON line

    Raises
    ------
    HistoryError : the folder is not empty, or the file is no backup, damaged or changed
    """
    done = restore(file, runs_dir)
    if as_json:
        at = done.at.isoformat()
        emit({"event": "restored", "files": done.file_count, "at": at, "flaw": done.flaw})
    else:
        print_line(
            f"restored: {count_of(done.file_count, 'file')} in {runs_dir}, as of {utc(done.at)}. "
            "What the cell did since is not in it: look into the grippers before a run"
        )
    if done.flaw:
        warn(f"the journal was not whole when it was backed up: {done.flaw}")
    return 0


def make_room(date: str, runs_dir: Path, url: str | None, *, is_dry: bool, as_json: bool) -> int:
    """List the pictures of old runs, or delete them; return the exit code.

    Parameters
    ----------
    date : runs that ended before it
    runs_dir : folder of all runs
    url : URL of the store; None for the folder's own
    is_dry : delete nothing
    as_json : print JSON lines

    Raises
    ------
    ConfigError : it is no date
    HistoryError : store or journal cannot be read, or the journal not be written
    """
    before = instant(date, "--drop-pictures-before")
    count, size, kept = 0, 0, 0
    with filled_store(runs_dir, url) as store:
        for old in old_pictures(store, runs_dir, before):
            done = Dropped(old.run, old.files, old.size)
            if not is_dry:
                done = drop_copied(runs_dir, old, before, getpass.getuser())
            count, size = count + len(done.files), size + done.size
            kept += len(done.problems)
            _print_dropped(done, is_dry=is_dry, as_json=as_json)
    if not as_json:
        what = "would be deleted; --yes deletes them" if is_dry else "deleted"
        print_line(f"{count} pictures, {size / 1e6:.1f} MB {what}. Verdicts and values stay")
    return 1 if kept else 0


def send_pictures(to: str, runs_dir: Path, *, as_json: bool) -> int:
    """Copy the pictures of all runs that have ended to a store of objects; return the exit code.

    Parameters
    ----------
    to : address of the store
    runs_dir : folder of all runs
    as_json : print JSON lines

    Raises
    ------
    ObjectsError : the store of objects cannot be opened or written
    HistoryError : the journal cannot be read or written
    """
    found = list(_shown(copy_pictures(runs_dir, to, getpass.getuser()), as_json=as_json))
    if not found and not as_json:
        print_line("no picture that was not copied")
    return 1 if any(one.problems for one in found) else 0


def keep_as_asked(runs_dir: Path, url: str | None, *, as_json: bool) -> int:
    """Copy and delete pictures as `connect.pictures` of the cell file asks; return the exit code.

    Parameters
    ----------
    runs_dir : folder of all runs
    url : URL of the store; None for the folder's own
    as_json : print JSON lines

    Raises
    ------
    ConfigError : the cell asks for nothing
    ObjectsError, HistoryError : as in `send_pictures`
    """
    rules = rules_now(runs_dir)
    if not rules.copy_to and rules.keep_local_days is None:
        raise ConfigError(
            "--keep-pictures: the cell file of the newest run has no `connect: pictures:` with "
            "`copy_to` or `keep_local_days`"
        )
    now = datetime.now(UTC).replace(tzinfo=None)
    with filled_store(runs_dir, url) as store:
        done = keep_pictures(store, runs_dir, now, getpass.getuser())
        found = list(_shown(done, as_json=as_json))
    if not found and not as_json:
        print_line("no picture to copy or to delete")
    return 1 if any(one.problems for one in found) else 0


def fetch_pictures(run: str, runs_dir: Path, *, as_json: bool) -> int:
    """Write a run's missing pictures into its folder again, from their copies.

    Parameters
    ----------
    run : id of the run, or an unambiguous beginning of it
    runs_dir : folder of all runs
    as_json : print a JSON line

    Returns
    -------
    exit code: 0 where none of those copied is missing any more

    Raises
    ------
    UnknownRunError : there is no such run
    ResultsError : the journal cannot be read
    ConfigError : a file cannot be written
    """
    record = load_run(runs_dir, run)
    missing = [file for file in record.copies if not (record.folder / file).is_file()]
    problems = RunPictures(record.folder, record.copies).bring_back(missing)
    for problem in problems:
        warn(problem)
    count = len(missing) - len(problems)
    if as_json:
        emit({"event": "pictures", "run": record.run_id, "fetched": count})
    else:
        print_line(f"{record.run_id}: {count_of(count, 'picture')} fetched, as they were written")
    return 1 if problems else 0


def _shown(done: Iterable[Copied | Dropped], *, as_json: bool) -> Iterator[Copied | Dropped]:
    """Print what was done with the pictures of each run, and yield it."""
    for one in done:
        if isinstance(one, Dropped):
            _print_dropped(one, is_dry=False, as_json=as_json)
        else:
            for problem in one.problems:
                warn(problem)
            if as_json:
                body = {"run": one.run, "copied": len(one.files), "to": one.to}
                emit({"event": "pictures", **body})
            else:
                print_line(f"{one.run}: {count_of(len(one.files), 'picture')} copied to {one.to}")
        yield one


def _print_dropped(done: Dropped, *, is_dry: bool, as_json: bool) -> None:
    for problem in done.problems:
        warn(problem)
    if as_json:
        body = {"run": done.run, "pictures": len(done.files), "bytes": done.size}
        emit({"event": "pictures", **body, "deleted": not is_dry})
    else:
        word = "" if is_dry else " deleted"
        print_line(f"{done.run}: {len(done.files)} pictures, {done.size / 1e6:.1f} MB{word}")
