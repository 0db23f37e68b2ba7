"""What the commands print: JSON lines for machines on stdout, sentences for people."""

import json
import sys
from collections.abc import Mapping
from typing import Any

from rich.console import Console

stdout = Console(highlight=False, soft_wrap=True)
stderr = Console(stderr=True, highlight=False, soft_wrap=True)


def emit(body: Mapping[str, Any]) -> None:
    """Print one JSON object on a line of its own."""
    sys.stdout.write(json.dumps(body, ensure_ascii=False, separators=(",", ":")) + "\n")
    sys.stdout.flush()


def say(text: str, *, style: str | None = None) -> None:
    """Print a sentence for people on stdout."""
    stdout.print(text, style=style, markup=False)


def warn(text: str) -> None:
    """Print a sentence for people on stderr."""
    stderr.print(text, markup=False)
