"""`cellctl backup`: write a backup, or restore one. `cellctl history`: make room."""

import getpass
from pathlib import Path

from controller.config import ConfigError
from controller.history.keeping import back_up, drop_pictures, old_pictures, restore
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
    count, size = 0, 0
    with filled_store(runs_dir, url) as store:
        for old in old_pictures(store, runs_dir, before):
            if not is_dry:
                drop_pictures(runs_dir, old, before, getpass.getuser())
            count, size = count + len(old.files), size + old.size
            if as_json:
                body = {"run": old.run, "pictures": len(old.files), "bytes": old.size}
                emit({"event": "pictures", **body, "deleted": not is_dry})
            else:
                print_line(f"{old.run}: {len(old.files)} pictures, {old.size / 1e6:.1f} MB")
    if not as_json:
        what = "would be deleted; --yes deletes them" if is_dry else "deleted"
        print_line(f"{count} pictures, {size / 1e6:.1f} MB {what}. Verdicts and values stay")
    return 0
