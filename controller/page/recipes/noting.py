"""Log of changes of project files at the page: one JSON object a line, never rewritten.

The journal is the running cell's alone; a recipe is changed without one.
"""

import json
import os
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

NAME: Final = "page-changes.jsonl"


def note(runs_dir: Path, who: str, what: str, file: str, **more: object) -> None:
    """Add a line to the file of changes, on the disk before this returns.

    Parameters
    ----------
    runs_dir : folder of all runs, where it is kept
    who : name of the person
    what : was done
    file : file that was changed
    more : further facts

    Raises
    ------
    OSError : it cannot be written
    """
    runs_dir.mkdir(parents=True, exist_ok=True)
    at = datetime.now(UTC).isoformat(timespec="milliseconds")
    line = json.dumps({"at": at, "who": who, "what": what, "file": file, **more})
    handle = os.open(runs_dir / NAME, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
    try:
        os.write(handle, f"{line}\n".encode())
        os.fsync(handle)
    finally:
        os.close(handle)
