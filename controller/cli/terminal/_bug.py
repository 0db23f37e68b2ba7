"""The last resort: an unexpected error becomes a sentence, and a file for the developer."""

import platform
import sys
import tempfile
import traceback
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from controller.cache import cache_dir
from controller.setup.software import commit, installed_version

from .output import warn


def report_bug(error: BaseException, argv: Sequence[str], *, verbose: bool) -> None:
    """Print one sentence about an error, and write the rest to a file.

    Parameters
    ----------
    error : with its traceback, which goes into the file
    argv : words of the command line
    verbose : print the details to stderr, too
    """
    details = "".join(traceback.format_exception(error))
    about = (
        f"cellctl {installed_version()}, commit {commit()}\n"
        f"Python {sys.version}, {platform.platform()}\n"
        f"command line: {' '.join(argv)}\n\n{details}"
    )
    file = _write(about.encode(errors="backslashreplace"))
    where = f"details in {file}" if file is not None else "no file could be written for the details"
    message = " ".join(str(error).split())
    what = f"{type(error).__name__}: {message:.200}" if message else type(error).__name__
    warn(f"cellctl: {what}; this is a bug of cellctl; {where}")
    if verbose:
        warn(details)


def _write(data: bytes) -> Path | None:
    name = f"bug-{datetime.now(UTC):%Y%m%d-%H%M%S-%f}.txt"
    for folder in (cache_dir(), Path(tempfile.gettempdir())):
        try:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(data)
        except OSError:
            continue
        return folder / name
    return None
