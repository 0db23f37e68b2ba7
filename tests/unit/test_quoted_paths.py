"""Every file and folder that ARCHITECTURE.md names is there: a stranger can follow it."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PLACES = (
    "controller",
    "drivers",
    "emulators",
    "simulation",
    "tests",
    "benchmarks",
    "recipes",
    "docs",
)
PATH = re.compile(rf"[\w./-]+(?:\.py|/)|(?:{'|'.join(PLACES)})/[\w./-]+")


def paths() -> set[str]:
    """Return files and folders of the checkout, as seen from its root."""
    found = (path for place in PLACES for path in (ROOT / place, *(ROOT / place).rglob("*")))
    return {path.relative_to(ROOT).as_posix() for path in found if "__pycache__" not in path.parts}


def missing(text: str, known: set[str]) -> list[str]:
    """Return the code spans that look like a path and end none of the known ones."""
    spans = re.findall(r"`([^`\n]+)`", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S))
    named = (span.rstrip("/") for span in spans if PATH.fullmatch(span))
    ends = {"/" + path for path in known}
    return [name for name in named if not any(end.endswith("/" + name) for end in ends)]


def test_architecture_names_what_is_there() -> None:
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    assert len(re.findall(r"\.py`", text)) > 20  # a page without paths would pass
    assert missing(text, paths()) == []


def test_a_path_that_has_gone_is_noticed() -> None:
    text = "`arm/move.py`, `move.py`, `arm/`, `gone.py`, `a/b`, `run --all`\n```\nother.py\n```\n"
    assert missing(text, {"drivers/arm", "drivers/arm/move.py"}) == ["gone.py"]
