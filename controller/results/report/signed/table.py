"""Rows of the table of characteristics: requirement, result and verdict."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from controller.cell.journal.rows import CharacteristicFields
from controller.inspection.characteristics import GENERAL, open_zones

DECIMALS: Final = 3
# Places of the limits in a deviation bar, which is 100 wide.
LOWER_AT, UPPER_AT = 20.0, 80.0
EDGE: Final = 2.0
MAX_ROWS: Final = 30  # largest number of rows on a page
KIND_SIGNS: Final = {"diameter": "⌀ ", "radius": "R ", "position": "pos. ", "angle": "∠ "}
UNITS: Final = {"mm": "mm", "deg": "°"}


@dataclass(frozen=True, slots=True)
class DeviationBar:
    """A deviation bar, 100 wide: limits, zones left open by the decision, value and its U.

    Attributes
    ----------
    zones : x and width of the zones in which neither PASS nor FAIL is proven
    at : place of the value, clipped to the bar; None without a value
    low, high : ends of its uncertainty interval, clipped
    is_off : True if the value is beyond the bar
    nominal : place of the nominal value
    """

    zones: tuple[tuple[float, float], ...]
    at: float | None
    low: float
    high: float
    is_off: bool
    nominal: float


@dataclass(frozen=True, slots=True)
class TableRow:
    """Printed row of a characteristic."""

    c: CharacteristicFields
    requirement: str
    limits: str
    actual: str
    U: str
    deviation: str
    bar: DeviationBar

    @property
    def unit(self) -> str:
        """Symbol of the unit."""
        return UNITS[self.c.unit]

    @property
    def note(self) -> str:
        """Remark beside the verdict."""
        return "" if self.c.verdict == "pass" else self.c.reason


@dataclass(frozen=True, slots=True)
class Brief:
    """Rows of a long table that a reader must see, and a summary of the rest.

    Attributes
    ----------
    rows : rows printed in full
    passed : characteristics with general tolerances that passed
    open_ : reasons for no evaluation, each with its balloons
    """

    rows: tuple[TableRow, ...]
    passed: tuple[TableRow, ...] = ()
    open_: tuple[tuple[str, tuple[int, ...]], ...] = ()


def briefly(rows: Sequence[TableRow]) -> Brief:
    """Return a table that fits a page: a short one in full, a long one partly summarised."""
    if len(rows) <= MAX_ROWS:
        return Brief(tuple(rows))
    passed = tuple(row for row in rows if row.c.verdict == "pass" and not _is_stated(row.c))
    why: dict[str, list[int]] = {}
    for row in rows:
        if row.c.verdict == "not evaluated" and not _is_stated(row.c):
            why.setdefault(row.c.reason or "no reason is given", []).append(row.c.balloon)
    short = {row.c.balloon for row in passed} | {n for numbers in why.values() for n in numbers}
    whole = tuple(row for row in rows if row.c.balloon not in short)
    return Brief(whole, passed, tuple((reason, tuple(n)) for reason, n in why.items()))


def _is_stated(c: CharacteristicFields) -> bool:
    """Return True if a characteristic was requested individually."""
    return c.is_critical or not c.source.startswith(GENERAL)


def rows_of(characteristics: Sequence[CharacteristicFields]) -> tuple[TableRow, ...]:
    """Return the rows in the order of their balloons."""
    return tuple(_row(c) for c in sorted(characteristics, key=lambda c: c.balloon))


def tally(characteristics: Sequence[CharacteristicFields]) -> tuple[tuple[str, int], ...]:
    """Return the number of characteristics with each verdict, worst first."""
    words = [c.verdict for c in characteristics]
    order = ("fail", "indeterminate", "not evaluated", "pass")
    return tuple((word, words.count(word)) for word in order if word in words)


def _row(c: CharacteristicFields) -> TableRow:
    unit = UNITS[c.unit]
    is_one_sided = _is_one_sided(c)
    up, down = c.upper - c.nominal, c.nominal - c.lower
    sign = KIND_SIGNS.get(c.kind, "")
    if is_one_sided:
        requirement = f"{sign}≤ {_fixed(c.upper)} {unit}"
    elif abs(up - down) < 10**-DECIMALS / 2:
        requirement = f"{sign}{_fixed(c.nominal)} ± {_short(up)} {unit}"
    else:
        requirement = f"{sign}{_fixed(c.nominal)} {_signed(up)} / {_signed(-down)} {unit}"
    return TableRow(
        c,
        requirement,
        f"{_fixed(c.lower)} … {_fixed(c.upper)}",
        "–" if c.measured is None else _fixed(c.measured),
        "–" if c.U is None else _fixed(c.U),
        "–" if c.deviation is None or is_one_sided else _signed(c.deviation),
        _bar(c),
    )


def _is_one_sided(c: CharacteristicFields) -> bool:
    """Return True if the ideal value is 0, so that there is no lower limit."""
    return c.nominal == c.lower == 0


def _bar(c: CharacteristicFields) -> DeviationBar:
    width = (c.upper - c.lower) or 1.0

    def at(value: float) -> float:
        return LOWER_AT + (value - c.lower) / width * (UPPER_AT - LOWER_AT)

    def clipped(x: float) -> float:
        return round(min(max(x, EDGE), 100 - EDGE), 2)

    U = c.U or 0.0
    zones = tuple(
        (x := clipped(at(low)), round(clipped(at(high)) - x, 2))
        for low, high in open_zones(U, None if _is_one_sided(c) else c.lower, c.upper)
    )
    if c.measured is None:
        return DeviationBar(zones, None, 0.0, 0.0, False, clipped(at(c.nominal)))
    x = at(c.measured)
    return DeviationBar(
        zones,
        clipped(x),
        clipped(at(c.measured - U)),
        clipped(at(c.measured + U)),
        not EDGE <= x <= 100 - EDGE,
        clipped(at(c.nominal)),
    )


def _fixed(value: float) -> str:
    return f"{value:.{DECIMALS}f}"


def _short(value: float) -> str:
    return f"{value:.{DECIMALS}f}".rstrip("0").rstrip(".")


def _signed(value: float) -> str:
    return f"{value:+.{DECIMALS}f}"
