"""Checks before any work: folders, places on the table, sockets."""

import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from math import isfinite
from pathlib import Path

from controller.config import Cell, ConfigError, split_cad

MIN_FREE_BYTES = 200_000_000  # pictures of a part with many views take 60 MB, and the journal grows
MAX_NAMED = 12  # missing files that a message lists
MAX_SOCKET_NAME_BYTES = 100  # longest path of a unix socket; the system allows 107
Place = tuple[float, float, float]  # x [mm], y [mm], theta [deg]


@contextmanager
def writing(option: str, path: Path) -> Iterator[None]:
    """Turn write errors of the block into a message that names the option.

    Raises
    ------
    ConfigError : instead of OSError
    """
    try:
        yield
    except OSError as error:
        raise ConfigError(f"{option} {path}: {error.strerror or error}") from error


def require_files(files: Iterable[Path]) -> None:
    """Require that all files are there, before the first of them is worked on.

    Parameters
    ----------
    files : CAD files, maybe with the name of a body, pictures, folders

    Raises
    ------
    ConfigError : some are not; a line for each
    """
    missing = [path for path in files if not os.path.lexists(split_cad(path).file)]
    if missing:
        lines = [f"{path}: No such file or directory; check the path" for path in missing]
        more = [f"and {len(lines) - MAX_NAMED} more"] if len(lines) > MAX_NAMED else []
        raise ConfigError("\n".join([*lines[:MAX_NAMED], *more]))


def check_drawings(folder: Path | None, part_count: int) -> None:
    """Check that drawings can be written, and are of one part; make their folder.

    Raises
    ------
    ConfigError : there are several parts, or the folder cannot be made
    """
    if folder is None:
        return
    if part_count != 1:
        raise ConfigError(f"--drawings {folder}: takes one part")
    make_folder(folder, "--drawings")


def make_folder(folder: Path, option: str) -> None:
    """Make a folder that can be written to, unless it exists.

    Parameters
    ----------
    folder : the folder
    option : names it in the message

    Raises
    ------
    ConfigError : not writable, or it cannot be made
    """
    check_writable_folder(folder, option)
    with writing(option, folder):
        folder.mkdir(parents=True, exist_ok=True)


def check_empty_folder(folder: Path) -> None:
    """Check that a folder is new or empty, and writable; create nothing.

    Raises
    ------
    ConfigError : the folder is not empty, is no folder, or cannot be written to
    """
    if folder.is_dir():
        if any(folder.iterdir()):
            raise ConfigError(f"{folder}: has files in it; name a new or an empty folder")
    elif folder.exists():
        raise ConfigError(f"{folder}: is a file; name a folder")
    check_writable_folder(folder, "init")


def check_writable_folder(folder: Path, option: str, min_free_bytes: int = 0) -> None:
    """Check that a folder is writable, or can be made, and has free space; create nothing.

    Parameters
    ----------
    folder : may not exist yet; then its nearest parent is checked
    option : the option that names it, for the message
    min_free_bytes : free space that is required

    Raises
    ------
    ConfigError : one of these does not hold; the message says which
    """
    try:
        there = _nearest(folder.absolute())
        if not there.is_dir():
            raise ConfigError(f"{option} {folder}: {there} is a file; name a folder")
        with tempfile.TemporaryFile(dir=there, buffering=0) as probe:
            probe.write(b"\0" * 4096)
            os.fsync(probe.fileno())
        free_bytes = shutil.disk_usage(there).free
        if free_bytes < min_free_bytes:
            raise ConfigError(
                f"{option} {folder}: {free_bytes / 1e6:.0f} MB are free there, "
                f"{min_free_bytes / 1e6:.0f} MB are required; make room or name another folder"
            )
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else None
        raise ConfigError(
            f"{option} {folder}: cannot be written to ({reason or error}); name another folder"
        ) from error


def _nearest(folder: Path) -> Path:
    """Return the folder, or its nearest parent that exists."""
    for there in (folder, *folder.parents):
        if os.path.lexists(there):
            return there
    return Path("/")


def parse_place(at: str | None, cell: Cell, *, is_on_table: bool = True) -> Place:
    """Return x, y [mm] and theta [deg] of ``X,Y,THETA``; the middle of the drop area otherwise.

    Parameters
    ----------
    at : "X,Y,THETA_DEG", None for the middle of the drop area
    cell : gives the drop area and the backlit area
    is_on_table : require a position on the table, since a part is put there

    Raises
    ------
    ConfigError : not three numbers, or not on the table
    """
    if at is None:
        x, y = cell.table.drop_area.x, cell.table.drop_area.y
        return sum(x) / 2, sum(y) / 2, 0.0
    try:
        numbers = [float(word) for word in at.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 3 or not all(isfinite(number) for number in numbers):
        raise ConfigError(f"--at {at:.80}: must be three numbers, X,Y,THETA_DEG, such as 350,20,45")
    (x0, x1), (y0, y1) = cell.table.glowing_area.x, cell.table.glowing_area.y
    x_mm, y_mm, theta_deg = numbers
    if is_on_table and not (x0 <= x_mm <= x1 and y0 <= y_mm <= y1):
        raise ConfigError(
            f"--at {at}: off the table, which is x {x0:g} to {x1:g} mm, y {y0:g} to {y1:g} mm"
        )
    return x_mm, y_mm, theta_deg % 360 if abs(theta_deg) > 360 else theta_deg


def check_control(control: Path | None) -> None:
    """Check that a control socket can be made.

    Raises
    ------
    ConfigError : the name is too long for a socket or names a folder, or its folder is missing
    """
    if control is None:
        return
    if len(os.fsencode(control.absolute())) > MAX_SOCKET_NAME_BYTES:
        raise ConfigError(f"--control {control}: the name is too long for a socket")
    if not control.absolute().parent.is_dir():
        raise ConfigError(f"--control {control}: there is no folder {control.parent}")
    if control.is_dir():
        raise ConfigError(f"--control {control}: is a directory; name a file in it")
