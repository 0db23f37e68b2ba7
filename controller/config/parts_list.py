"""A list of parts (CSV) as text: its titles, and the values of each line by them."""

import csv
import io
from collections.abc import Iterator
from typing import Final

COLUMNS: Final = ("recipe", "serial", "lot")


class ListReader:
    """Reads a list: titles first, then its lines; those without any value are left out.

    Commas stand between values, or semicolons, where spreadsheets write these. Both methods raise
    `csv.Error` where a line is no CSV.

    Parameters
    ----------
    text : of the list, lines ending in a line feed
    """

    def __init__(self, text: str) -> None:
        delimiter = ";" if ";" in text.partition("\n")[0] else ","
        self._reader = csv.reader(io.StringIO(text), delimiter=delimiter, strict=True)

    @property
    def line(self) -> int:
        """Number of the line that was read last, from 1."""
        return self._reader.line_num

    def titles(self) -> list[str]:
        """Return the titles, in small letters; to be called first, once."""
        return [title.strip().lower() for title in next(self._reader, [])]

    def rows(self, titles: list[str]) -> Iterator[dict[str, str] | None]:
        """Yield each line's values by title; None where they are more or fewer than the titles.

        The values have the blanks about them that the list has.
        """
        for values in self._reader:
            if any(value.strip() for value in values):
                fits = len(values) == len(titles)
                yield dict(zip(titles, values, strict=True)) if fits else None
