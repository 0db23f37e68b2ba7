"""The register of running emulators: their clocks and addresses, docs/shared-clock.md 5.

A client that is given an address by hand finds its clock there.
"""

import json
import logging
import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from emulators.clock import CLOCK_PREFIX, clock_folder, is_kept

log = logging.getLogger(__name__)


def register_folder() -> Path:
    """Return the folder of all emulators of this user; it may not be there yet."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    if runtime and os.access(runtime, os.W_OK):
        return Path(runtime) / "cellctl-emulators"
    return Path(tempfile.gettempdir()) / f"cellctl-emulators-{os.getuid()}"


@contextmanager
def registered(announcement: Mapping[str, Any]) -> Iterator[None]:
    """Stand in the register while the block runs."""
    folder = register_folder()
    entry = folder / f"{os.getpid()}.json"
    text = json.dumps(
        {
            "clock": announcement["clock"],
            "addresses": {k: _address(v) for k, v in announcement["devices"].items()},
        }
    )
    if not _is_ours(folder):
        log.warning("%s is somebody else's: addresses given by hand find no clock", folder)
        yield
        return
    sweep(folder)
    while not _write(entry, text):
        pass
    try:
        yield
    finally:
        entry.unlink(missing_ok=True)
        with suppress(OSError):  # others are in it
            folder.rmdir()


def _is_ours(folder: Path) -> bool:
    """Return whether the folder, which is made if missing, belongs to this user."""
    while True:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with suppress(FileNotFoundError):  # the last one to leave took it away meanwhile
            return folder.stat().st_uid == os.getuid()


def sweep(folder: Path) -> None:
    """Remove the entries and the clocks of killed emulators."""
    for entry in folder.glob("*.json"):
        with suppress(OSError, ValueError, KeyError, TypeError):
            clock = Path(json.loads(entry.read_text())["clock"])
            if not is_kept(clock):
                if clock.name.startswith(CLOCK_PREFIX):  # no entry can take another file away
                    clock.unlink(missing_ok=True)
                entry.unlink(missing_ok=True)
    for clock in clock_folder().glob(f"{CLOCK_PREFIX}*"):
        with suppress(OSError, ValueError):
            pid = int(clock.name.removeprefix(CLOCK_PREFIX).partition("-")[0])
            is_ours = clock.lstat().st_uid == os.getuid()
            if is_ours and not Path(f"/proc/{pid}").exists() and not is_kept(clock):
                clock.unlink(missing_ok=True)  # of one that was killed before it was registered


def _write(entry: Path, text: str) -> bool:
    """Write an entry whole; False if the last one to leave took the folder away meanwhile."""
    entry.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    draft = entry.with_suffix(".new")
    try:
        draft.write_text(text)
        draft.replace(entry)
    except FileNotFoundError:
        return False
    return True


def _address(where: str | Mapping[str, Any]) -> str:
    if isinstance(where, str):
        return where
    return str(where.get("path") or f"{where['host']}:{where['port']}")
