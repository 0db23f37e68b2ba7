"""`cellctl backup`: write a backup, or restore one."""

from pathlib import Path

from controller.config import ConfigError
from controller.history.keeping import back_up, restore
from controller.results.wording import count_of, utc

from ..inputs.checks import check_writable_folder
from ..terminal.output import emit, print_line, warn


def write_backup(file: Path, runs_dir: Path, *, with_pictures: bool, as_json: bool) -> int:
    """Write a backup and return the exit code.

    Parameters
    ----------
    file : to write
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
