"""A list of parts (CSV): the recipe of each, its serial number and its lot."""

import csv
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from controller.cell.services.table import Label, why_no_serial
from controller.config import ConfigError, find_recipe
from controller.config.files import read_text
from controller.config.parts_list import COLUMNS, ListReader

from ..options import MAX_PART_COUNT
from .recipes import AskedRecipe

MAX_BYTES: Final = 20_000_000
MAX_NAMED: Final = 10  # problems that a message lists


@dataclass(frozen=True, slots=True)
class PartsList:
    """The parts of a list.

    Attributes
    ----------
    recipes : in the order in which the list first names them, each with its number of parts
    labels : labels of each part, with the number of its recipe in that order
    """

    recipes: tuple[AskedRecipe, ...]
    labels: tuple[tuple[int, Label], ...]


@dataclass(slots=True)
class _Reading:
    folder: Path
    lot: str
    problems: list[str] = field(default_factory=list)
    numbers: dict[Path, int] = field(default_factory=dict)
    lines: dict[str, int] = field(default_factory=dict)
    labels: list[tuple[int, Label]] = field(default_factory=list)
    firsts: dict[int, tuple[int, Label]] = field(default_factory=dict)

    def take(self, line: int, row: dict[str, str]) -> None:
        try:
            path = _recipe_file(self.folder, row["recipe"])
        except ConfigError as error:
            self.problems.append(f"line {line}: {error}")
            return
        serial, lot = row.get("serial", ""), row.get("lot", "") or self.lot
        if serial and (why := why_no_serial(serial)):
            self.problems.append(f"line {line}: {why}")
        elif serial and serial in self.lines:
            self.problems.append(
                f"line {line}: serial number {serial} is in line {self.lines[serial]} already"
            )
        else:
            self.lines.setdefault(serial, line)
        number = self.numbers.setdefault(path, len(self.numbers))
        label = Label(serial, lot)
        first_line, first = self.firsts.setdefault(number, (line, label))
        if bool(first.serial) != bool(serial):
            self.problems.append(
                f"line {line}: some parts of {row['recipe']} have a serial number and some have "
                f"none (line {first_line}): nobody can tell which is which"
            )
        elif not serial and first.lot != lot:
            self.problems.append(
                f"line {line}: parts of {row['recipe']} without serial numbers are of several "
                f"lots (line {first_line}): nobody can tell which is which"
            )
        self.labels.append((number, label))


def load_parts_list(path: Path, lot: str = "") -> PartsList:
    """Return the parts of a list, after checking all of it.

    Parameters
    ----------
    path : CSV with a line of titles: recipe, serial, lot
    lot : lot of parts for which the list has none

    Raises
    ------
    ConfigError : it cannot be read, or some lines are wrong; the message names them
    """
    reading = _Reading(path.parent, lot)
    for line, row in _rows(path):
        if row is None:
            reading.problems.append(f"line {line}: more or fewer values than there are titles")
        else:
            reading.take(line, row)
    if not reading.labels and not reading.problems:
        raise ConfigError(f"{path}: the list has no parts")
    if reading.problems:
        more = len(reading.problems) - MAX_NAMED
        shown = [*reading.problems[:MAX_NAMED], *([f"and {more} more"] if more > 0 else [])]
        raise ConfigError(f"{path}: " + "; ".join(shown))
    counts = Counter(number for number, _ in reading.labels)
    recipes = (AskedRecipe(file, counts[number]) for file, number in reading.numbers.items())
    return PartsList(tuple(recipes), tuple(reading.labels))


def _rows(path: Path) -> Iterator[tuple[int, dict[str, str] | None]]:
    """Yield each part's line number and its values by title; None if they do not fit."""
    reader = ListReader(read_text(path, "a list of parts", MAX_BYTES))
    try:
        titles = reader.titles()
        _check_titles(path, titles)
        for row in reader.rows(titles):
            yield reader.line, row and {title: value.strip() for title, value in row.items()}
            if reader.line > MAX_PART_COUNT + 1:
                raise ConfigError(f"{path}: more than {MAX_PART_COUNT} parts")
    except csv.Error as error:
        raise ConfigError(f"{path}: line {reader.line}: {error}") from error


def _check_titles(path: Path, titles: Sequence[str]) -> None:
    if "recipe" not in titles:
        raise ConfigError(
            f"{path}: line 1: expected the column titles recipe, serial and lot, at least the "
            f"first; found: {', '.join(titles) or 'nothing'}"
        )
    for title in titles:
        if title not in COLUMNS or titles.count(title) > 1:
            raise ConfigError(
                f"{path}: line 1: unknown or repeated title `{title}`; known are recipe, serial "
                "and lot"
            )


def _recipe_file(folder: Path, name: str) -> Path:
    if not name:
        raise ConfigError("no recipe")
    beside = folder / name
    try:
        return beside if beside.is_file() else find_recipe(Path(name))
    except (OSError, ValueError) as error:
        raise ConfigError(f"{name[:80]!r} is no recipe") from error
