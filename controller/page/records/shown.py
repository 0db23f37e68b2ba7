"""Parts in words of a page."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

CLASSES: Final[Mapping[str, str]] = {
    "pass": "good",
    "accept": "good",
    "fail": "bad",
    "reject": "bad",
    "indeterminate": "open",
}
REPORTS: Final[Mapping[str, str]] = {
    "report.html": "text/html; charset=utf-8",
    "report.pdf": "application/pdf",
}
REPORT_MAX_BYTES: Final = 60_000_000


def verdict_class(word: str) -> str:
    """Return the class of a verdict's mark; its sign and word say the same without colour."""
    return CLASSES.get(word, "none")


def part_key(part: Mapping[str, Any]) -> str:
    """Return the end of a part's address."""
    return f"{part['run']}/{part['number']}"


def value(number: float | None, digits: int = 3) -> str:
    """Return a number, or a dash for what is not known."""
    return "–" if number is None else f"{number:.{digits}f}"


def report_file(runs_dir: Path, run: str) -> tuple[Path, str] | None:
    """Return a run's report and its type; None where there is none of sound size.

    Parameters
    ----------
    runs_dir : folder of all runs
    run : its id, as the store has it
    """
    folder = (runs_dir / run).resolve()
    if folder.parent != runs_dir.resolve():
        return None
    for name, kind in REPORTS.items():
        path = (folder / name).resolve()
        if path.parent == folder and path.is_file() and path.stat().st_size <= REPORT_MAX_BYTES:
            return path, kind
    return None
