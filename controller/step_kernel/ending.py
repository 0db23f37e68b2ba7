"""Limits of a process of the kernel, and the reason it leaves in place of a result."""

import json
import resource
from pathlib import Path
from typing import Final

REFUSED: Final = 3  # exit code


class RefusalError(Exception):
    """The file is read, but holds no single solid."""

    def __init__(self, error: str, reason: str) -> None:
        super().__init__(reason)
        self.error = error


def limit_resources(memory_bytes: int, cpu_s: int) -> None:
    """Limit this process's use of the machine."""
    resource.setrlimit(resource.RLIMIT_DATA, (memory_bytes, memory_bytes))
    resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s + 1))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def refuse(out: str, error: str, reason: str) -> int:
    """Leave the reason where the parent looks for it; return the exit code.

    Parameters
    ----------
    out : file to write
    error : name of the class of `CadError` the parent is to raise
    reason : reason, as it follows the file's name in a message
    """
    Path(out).write_text(json.dumps({"error": error, "reason": reason}))
    return REFUSED
