"""Writes docs/adr/index.md: ``python docs/adr_index.py > docs/adr/index.md``.

A test fails when the page is out of date, or when a record has no status.
"""

import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

FOLDER = Path(__file__).parent / "adr"
STATUS = re.compile(
    r"^Status: (accepted|proposed|replaced), (\d{4}-\d\d-\d\d)\.(.*)$", re.MULTILINE
)
HEAD = """# Decisions

<!-- made by `python docs/adr_index.py > docs/adr/index.md`; do not edit -->

One page for each decision that somebody might question: what was needed, what was weighed and with
which figures, what was decided, and what follows. `own-code.md` has the libraries that were weighed
against code of our own.

A record states what holds today, with the options that lost and their figures. Where several were
about one thing, one took in the others: their numbers stand in its status, and git has their texts.
No record had the numbers {gaps}: they were set aside while several records were in work at the
same time, and not used.

| ADR | decision | since | status |
|---|---|---|---|
"""
TAKEN_IN = re.compile(r"\bTakes in ([\d, and]+)\.")
TOCTREE = """
```{toctree}
:hidden:
:glob:

0*
own-code
```
"""


@dataclass(frozen=True, slots=True)
class Record:
    """A decision: its number, file, title, status, date, and a note on what it replaced."""

    number: int
    file: str
    title: str
    status: str
    date: str
    note: str

    @property
    def taken_in(self) -> list[int]:
        """Numbers of the records that this one replaces whole."""
        found = TAKEN_IN.search(self.note)
        return [int(number) for number in re.findall(r"\d+", found[1])] if found else []


def records() -> Iterator[Record]:
    """Yield the records by number.

    Raises
    ------
    ValueError : one has no title with its number, or no status with a date below it
    """
    for path in sorted(FOLDER.glob("0*.md")):
        number = int(path.name[:4])
        text = path.read_text(encoding="utf-8")
        title = re.match(rf"# {number}\. (.+)\n\n", text)
        status = title and STATUS.match(text, title.end())
        if not title or not status:
            raise ValueError(
                f"{path.name}: write `# {number}. The decision` and, two lines below it, "
                "`Status: accepted, 2026-01-31.`"
            )
        yield Record(number, path.name, title[1], status[1], status[2], status[3].strip())


def page() -> str:
    """Return docs/adr/index.md.

    Raises
    ------
    ValueError : a record has another's number, or two took in the same one
    """
    found = list(records())
    known = [number for one in found for number in (one.number, *one.taken_in)]
    if twice := sorted({number for number in known if known.count(number) > 1}):
        raise ValueError(f"each number stands for one record: {twice} for several")
    missing = sorted(set(range(1, found[-1].number)) - set(known))
    gaps = f"{', '.join(map(str, missing[:-1]))} and {missing[-1]}"
    rows = "".join(
        f"| {one.number} | [{one.title}]({one.file}) | {one.date} | "
        f"{one.status}{'. ' + one.note if one.note else ''} |\n"
        for one in found
    )
    return f"{HEAD.format(gaps=gaps)}{rows}{TOCTREE}"


if __name__ == "__main__":
    sys.stdout.write(page())
