"""A list of parts (CSV) as text: its titles, and the values of each line by them."""

import csv
import io
from collections.abc import Iterator
from typing import Final

COLUMNS: Final = ("recipe", "serial", "lot")


class ListReader:
    """Reads a list: titles first, then its lines; those without any value are left out.

    Commas stand between values, or what `table_of` finds. Both methods raise
    `csv.Error` where a line is no CSV.

    Parameters
    ----------
    text : text of the list
    """

    def __init__(self, text: str) -> None:
        text, delimiter, self._skipped = table_of(text)
        self._reader = csv.reader(io.StringIO(text), delimiter=delimiter, strict=True)

    @property
    def line(self) -> int:
        """Number of the line that was read last, from 1."""
        return self._reader.line_num + self._skipped

    def titles(self) -> list[str]:
        """Return the titles, in small letters; to be called first, once."""
        return [title.strip().lower() for title in _cut(next(self._reader, []), 0)]

    def rows(self, titles: list[str]) -> Iterator[dict[str, str] | None]:
        """Yield each line's values by title; None if they are more or fewer than the titles.

        The values have the blanks about them that the list has. Spreadsheets end lines with empty
        columns: these are none.
        """
        for line in self._reader:
            values = _cut(line, len(titles))
            if any(value.strip() for value in values):
                fits = len(values) == len(titles)
                yield dict(zip(titles, values, strict=True)) if fits else None


def _cut(values: list[str], least: int) -> list[str]:
    """Return values without blank ones at the end, but a given number at least."""
    last = next((i for i in range(len(values), 0, -1) if values[i - 1].strip()), 0)
    return values[: max(last, least)]


def table_of(text: str) -> tuple[str, str, int]:
    """Return a table's text, its separator, and the number of lines left out.

    Spreadsheets write semicolons where the comma is a decimal sign, tabs into UTF-16, and a first
    line ``sep=;`` for other spreadsheets. Lines of the text returned end in a line feed.

    Parameters
    ----------
    text : text of the table, with the line ends of any system
    """
    text = io.StringIO(text, newline=None).getvalue()
    first, _, rest = text.partition("\n")
    hint = first.strip().lower()
    if hint.startswith("sep=") and len(hint) == len("sep=") + 1:
        return rest, hint[-1], 1
    return text, next((mark for mark in ";\t" if mark in first), ","), 0
