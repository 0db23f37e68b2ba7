"""The text of a STEP file (ISO 10303-21), to the extent that tolerances need it.

The kernel gives dimensions without the sign of their lower deviation and, for files in inches,
their nominal value without conversion. The text has both, so the parent reads them from it.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite
from typing import Any, Final

RECORD: Final = re.compile(r"#(\d+)\s*=\s*((?:[^';]++|'[^']*+')*+);")
KEYWORD: Final = re.compile(r"\s*([A-Z][A-Z0-9_]*)\s*(?=\()")
TOKEN: Final = re.compile(r"\s*('(?:[^']|'')*'|[(),]|[^'(),]+)")
PREFIXES: Final = {"MICRO": 1e-6, "MILLI": 1e-3, "CENTI": 1e-2, "DECI": 1e-1, "KILO": 1e3}
MM_PER_M: Final = 1000.0
DEEPEST: Final = 20  # chains of references and brackets in sound files are shorter

Arguments = list[Any]


class Part21Error(ValueError):
    """The text violates the standard at a place that matters here."""


@dataclass(frozen=True, slots=True)
class Written:
    """A dimension as written in the file, in mm or rad.

    Attributes
    ----------
    raw : nominal value, lower and upper limit, lower and upper deviation, as far as given, in the
        file's own units
    nominal, limits, deviations : the same, converted; None where not given
    is_angle : whether in rad
    fit : class of tolerance, as ``H7``
    record : number of the record that gives it its value
    """

    raw: tuple[float, ...]
    nominal: float | None
    limits: tuple[float, float] | None
    deviations: tuple[float, float] | None
    is_angle: bool
    fit: str
    record: int = 0

    def __str__(self) -> str:
        values = (*([] if self.nominal is None else [self.nominal]), *(self.limits or ()))
        unit = "rad" if self.is_angle else "mm"
        allowed = "" if self.deviations is None else " {:+g} {:+g}".format(*self.deviations)
        return f"#{self.record}: {' / '.join(f'{v:g}' for v in values)}{allowed} {unit}"


class Part21:
    """Records of a file by number, parsed on demand."""

    def __init__(self, text: str) -> None:
        self._text = {int(m[1]): m[2] for m in RECORD.finditer(text)}
        self._records: dict[int, dict[str, Arguments]] = {}

    def record(self, number: Any) -> dict[str, Arguments]:  # noqa: ANN401  any argument
        """Return a record's keywords with their arguments; several for a complex instance.

        Raises
        ------
        Part21Error : ``number`` is no reference, or names a record the file does not hold, or an
            empty one
        """
        if not isinstance(number, RecordReference) or number.number not in self._text:
            raise Part21Error(f"{number} names no record")
        if number.number not in self._records:
            parts = _parts(self._text[number.number])
            if not parts:
                raise Part21Error(f"record {number.number} is empty")
            self._records[number.number] = parts
        return self._records[number.number]

    def all_of(self, keyword: str) -> Iterator[tuple["RecordReference", dict[str, Arguments]]]:
        """Yield every record that has a keyword."""
        for number, text in self._text.items():
            if keyword in text:
                reference = RecordReference(number)
                record = self.record(reference)
                if keyword in record:
                    yield reference, record

    def dimensions(self) -> list[Written]:
        """Return the dimensions that have a value, in the file's order."""
        deviations = dict(self._deviations())
        found = []
        for reference, record in self.all_of("DIMENSIONAL_CHARACTERISTIC_REPRESENTATION"):
            of, representation = record["DIMENSIONAL_CHARACTERISTIC_REPRESENTATION"][:2]
            items = next(iter(self.record(representation).values()))[1]
            values = dict(v for item in items if (v := self._named_measure(item)) is not None)
            nominal = values.get("nominal value")
            lower, upper = values.get("lower limit"), values.get("upper limit")
            below, above, fit = deviations.get(of, (None, None, ""))
            measures = [m for m in (nominal, lower, upper, below, above) if m is not None]
            if nominal is None and (lower is None or upper is None):
                continue
            found.append(
                Written(
                    raw=tuple(m.raw for m in measures),
                    nominal=nominal.value if nominal else None,
                    limits=_sorted(lower.value, upper.value) if lower and upper else None,
                    deviations=_in_order(below, above),
                    is_angle=measures[0].is_angle,
                    fit=fit,
                    record=reference.number,
                )
            )
        return found

    def magnitudes_mm(self, keyword: str) -> list[float]:
        """Return the widths of all tolerance zones of a kind, in the file's order."""
        found = []
        for _, record in self.all_of(keyword):
            arguments = record.get("GEOMETRIC_TOLERANCE") or record[keyword]
            found.append(self._measure(arguments[2]).value)
        return found

    def datum_surfaces(self) -> dict[str, set["RecordReference"]]:
        """Return the faces of each datum by its letter."""
        faces: dict[RecordReference, set[RecordReference]] = {}
        for _, record in self.all_of("GEOMETRIC_ITEM_SPECIFIC_USAGE"):
            _, _, aspect, _, items = record["GEOMETRIC_ITEM_SPECIFIC_USAGE"][:5]
            named = items if isinstance(items, list) else [items]
            faces.setdefault(aspect, set()).update(
                i for i in named if isinstance(i, RecordReference)
            )
        below: dict[RecordReference, list[RecordReference]] = {}
        for _, record in self.all_of("SHAPE_ASPECT_RELATIONSHIP"):
            relating, related = record["SHAPE_ASPECT_RELATIONSHIP"][2:4]
            below.setdefault(relating, []).append(related)
        letters = {of: str(r["DATUM"][-1]) for of, r in self.all_of("DATUM") if r["DATUM"]}
        found: dict[str, set[RecordReference]] = {letter: set() for letter in letters.values()}
        for feature, parts in below.items():
            for letter in {letters[part] for part in parts if part in letters}:
                reached, todo = {feature}, [feature]
                while todo:  # a feature of several surfaces is an aspect made of aspects
                    here = todo.pop()
                    found[letter] |= faces.get(here, set())
                    for part in below.get(here, []):
                        if part not in reached and part not in letters:
                            reached.add(part)
                            todo.append(part)
        return found

    def faces_of_solid(self, count: int) -> list["RecordReference"]:
        """Return the faces of the file's solid with the given number of faces, in their order.

        Empty if no solid of the file has that many, or if several have: the text does not identify
        the solid.

        Parameters
        ----------
        count : number of the solid's faces
        """
        shells = [record["CLOSED_SHELL"][1] for _, record in self.all_of("CLOSED_SHELL")]
        every = [face for shell in shells for face in shell]
        if len(every) == count:
            return every
        fitting = [shell for shell in shells if len(shell) == count]
        return list(fitting[0]) if len(fitting) == 1 else []

    def _deviations(
        self,
    ) -> Iterator[
        tuple["RecordReference", tuple["NumberWithUnit | None", "NumberWithUnit | None", str]]
    ]:
        for _, record in self.all_of("PLUS_MINUS_TOLERANCE"):
            how, of = record["PLUS_MINUS_TOLERANCE"][:2]
            limits = self.record(how)
            if "TOLERANCE_VALUE" in limits:
                lower, upper = (self._measure(m) for m in limits["TOLERANCE_VALUE"][:2])
                yield of, (lower, upper, "")
            elif "LIMITS_AND_FITS" in limits:
                form, _, grade = limits["LIMITS_AND_FITS"][:3]
                yield of, (None, None, f"{form}{grade}")

    def _named_measure(self, item: Any) -> tuple[str, "NumberWithUnit"] | None:  # noqa: ANN401
        record = self.record(item)
        simple = record.get("MEASURE_REPRESENTATION_ITEM")
        if simple:
            return str(simple[0]), self._measure_of(simple[1:3])
        if "MEASURE_WITH_UNIT" in record and "REPRESENTATION_ITEM" in record:
            name = record["REPRESENTATION_ITEM"][0]
            return str(name), self._measure_of(record["MEASURE_WITH_UNIT"])
        return None

    def _measure(self, number: Any) -> "NumberWithUnit":  # noqa: ANN401
        record = self.record(number)
        if record.get("MEASURE_WITH_UNIT"):
            return self._measure_of(record["MEASURE_WITH_UNIT"])
        for arguments in record.values():
            if len(arguments) >= 2 and isinstance(arguments[0], dict):
                return self._measure_of(arguments)
        raise Part21Error(f"{number} is no measure with a unit")

    def _measure_of(self, arguments: Arguments) -> "NumberWithUnit":
        typed, unit = arguments[:2]
        raw = _number(typed)
        factor, is_angle = self._unit(unit)
        if not isfinite(raw * factor):
            raise Part21Error("a measure that is no number")
        return NumberWithUnit(raw, raw * factor, is_angle)

    def _unit(self, number: Any, depth: int = 0) -> tuple[float, bool]:  # noqa: ANN401
        """Return the factor of a unit to mm or rad, and True if it is an angle."""
        record = self.record(number)
        if depth > DEEPEST:
            raise Part21Error("units that refer to each other")
        if "SI_UNIT" in record:
            prefix, name = record["SI_UNIT"][-2:]
            scale = PREFIXES.get(str(prefix), 1.0)
            if str(name) == "METRE":
                return scale * MM_PER_M, False
            if str(name) == "RADIAN":
                return scale, True
        if "CONVERSION_BASED_UNIT" in record:
            factor = self.record(record["CONVERSION_BASED_UNIT"][-1])
            arguments = factor.get("MEASURE_WITH_UNIT") or next(iter(factor.values()))
            base, is_angle = self._unit(arguments[1], depth + 1)
            return _number(arguments[0]) * base, is_angle
        raise Part21Error("a unit of neither length nor angle")


@dataclass(frozen=True, slots=True)
class RecordReference:
    """A record's number where another one names it, as ``#12``."""

    number: int


@dataclass(frozen=True, slots=True)
class NumberWithUnit:
    """A number with its unit.

    Attributes
    ----------
    raw : as written
    value : in mm or rad
    """

    raw: float
    value: float
    is_angle: bool


def _sorted(one: float, other: float) -> tuple[float, float]:
    return min(one, other), max(one, other)


def _in_order(
    below: "NumberWithUnit | None", above: "NumberWithUnit | None"
) -> tuple[float, float] | None:
    """Return lower and upper deviation, written in either order.

    The standard has the lower one first, with its sign. Some systems write the upper one first,
    and some the same amount twice where they mean it both ways.
    """
    if below is None or above is None:
        return None
    if below.value == above.value != 0.0:
        return -abs(below.value), abs(below.value)
    return _sorted(below.value, above.value)


def _number(typed: Any) -> float:  # noqa: ANN401  any argument
    """Return the number of a typed value, as LENGTH_MEASURE(0.5)."""
    if not isinstance(typed, dict) or len(typed) != 1:
        raise Part21Error("a measure without its type")
    return float(next(iter(typed.values()))[0])


def _parts(text: str) -> dict[str, Arguments]:
    text = text.strip()
    inside = text[1:-1] if text.startswith("(") else text
    parts: dict[str, Arguments] = {}
    at = 0
    while match := KEYWORD.match(inside, at):
        arguments, at = _arguments(inside, match.end(), 0)
        parts[match[1]] = arguments
    return parts


def _arguments(text: str, at: int, depth: int) -> tuple[Arguments, int]:
    """Return the arguments between the bracket at ``at`` and its partner, and the end position."""
    if depth > DEEPEST:
        raise Part21Error("brackets in brackets without end")
    found: Arguments = []
    at = text.index("(", at) + 1
    while match := TOKEN.match(text, at):
        token = match[1].strip()
        if token == ")":
            return found, match.end()
        if token == "(":
            inner, at = _arguments(text, match.start(1), depth + 1)
            found.append(inner)
            continue
        at = match.end()
        if token == ",":
            continue
        if token[0].isalpha():  # a typed value, as LENGTH_MEASURE(0.5)
            inner, at = _arguments(text, at, depth + 1)
            found.append({token: inner})
        else:
            found.append(_value(token))
    raise Part21Error("a bracket that is never closed")


def _value(token: str) -> Any:  # noqa: ANN401  a number, a text, a reference or nothing
    if token[0] == "#":
        return RecordReference(int(token[1:]))
    if token[0] == "'":
        return token[1:-1].replace("''", "'")
    if token[0] == ".":
        return token.strip(".")
    if token in {"$", "*"}:
        return None
    try:
        return float(token)
    except ValueError:
        raise Part21Error(f"{token!r:.40} is no value") from None
