"""Where an emulator writes down that it runs: its clock and its addresses, docs/shared-clock.md 5.

Whoever is given an address by hand finds the clock that goes with it there.
"""

import json
import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any


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
    while not _write(entry, text):
        pass
    try:
        yield
    finally:
        entry.unlink(missing_ok=True)
        with suppress(OSError):  # others are in it
            folder.rmdir()


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
