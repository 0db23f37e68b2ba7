"""Judged parts as a file for Q-DAS (references.md S21).

Head first: the product as K1 fields, each characteristic as K2 fields with its number behind a
slash. Then a line of values per part: characteristics apart by 0x0F, within each the value, its
attribute and the time, apart by 0x14. A part that lacks a value has the attribute of an invalid
one, so that no program takes it for a measurement. Parts of one file share their characteristics.
Times are those of this computer's zone (``TZ``, else the system's): the format has no place for it.
"""

from collections.abc import Sequence
from typing import Final

from controller.cell.journal.rows import CharacteristicFields

from ..judged import JudgedPart, shared_characteristics

BETWEEN_CHARACTERISTICS: Final = "\x0f"
WITHIN_VALUE: Final = "\x14"
VALID, INVALID = 0, 256
DECIMALS: Final = 4
LIMIT, NATURAL_LIMIT = 1, 2  # K2120 and K2121: a limit of the drawing; one that nature sets
SIGNIFICANT: Final = 3  # K2005: class of a characteristic
NATURALLY_ABOVE_ZERO: Final = frozenset({"position", "straightness", "roundness"})
LINE_END: Final = "\r\n"


def dfq_bytes(parts: Sequence[JudgedPart]) -> bytes:
    """Return the file's content: ASCII, or UTF-8 with its mark if a name needs more.

    Raises
    ------
    ValueError : no part, or parts of different products
    """
    if not parts:
        raise ValueError("a dfq file needs a part")
    asked = shared_characteristics(parts)
    header = parts[0].header
    lines = [f"K0100 {len(asked)}"]
    lines += _fields(
        "1",
        (
            ("K1001", header.papers.get("part_number", "") or header.part),
            ("K1002", header.cad),
            ("K1041", header.papers.get("drawing_number", "")),
            ("K1053", header.run_id),
            ("K1900", "emulated cell, no production result" if header.emulated_devices else ""),
        ),
    )
    for index, characteristic in enumerate(asked, start=1):
        lines += _fields(str(index), _characteristic(characteristic))
    for judged in parts:
        # K0004 has no zone: the plant's time, so that values of other gauges sort beside it
        at = f"{judged.header.end.astimezone():%d.%m.%Y/%H:%M:%S}"
        if not judged.part.characteristics:
            continue  # the part was not measured
        lines.append(
            BETWEEN_CHARACTERISTICS.join(_value(c, at) for c in judged.part.characteristics)
        )
        # fields with index 0 belong to all characteristics of the line of values before them
        lines += _fields(
            "0",
            (
                ("K0006", judged.header.lot),
                ("K0009", f"operator {judged.header.operator}" if judged.header.operator else ""),
                ("K0014", judged.header.serial),
                ("K0053", judged.header.papers.get("order_number", "")),
            ),
        )
    text = LINE_END.join(lines) + LINE_END
    return text.encode("ascii" if text.isascii() else "utf-8-sig")


def _characteristic(c: CharacteristicFields) -> tuple[tuple[str, str], ...]:
    lower = NATURAL_LIMIT if c.kind in NATURALLY_ABOVE_ZERO else LIMIT
    return (
        ("K2001", str(c.balloon)),
        ("K2002", c.label or c.id),
        ("K2005", str(SIGNIFICANT) if c.is_critical else ""),
        ("K2022", str(DECIMALS)),
        ("K2101", _number(c.nominal)),
        ("K2110", _number(c.lower)),
        ("K2111", _number(c.upper)),
        ("K2120", str(lower)),
        ("K2121", str(LIMIT)),
        ("K2142", c.unit),
        ("K2900", c.source),
    )


def _fields(index: str, fields: Sequence[tuple[str, str]]) -> list[str]:
    return [f"{key}/{index} {text}" for key, value in fields if (text := _plain(value))]


def _value(c: CharacteristicFields, at: str) -> str:
    is_measured = c.measured is not None and c.verdict != "not evaluated"
    value = _number(c.measured if is_measured and c.measured is not None else 0.0)
    return WITHIN_VALUE.join((value, str(VALID if is_measured else INVALID), at))


def _number(value: float) -> str:
    return f"{value:.{DECIMALS}f}"


def _plain(text: str) -> str:
    """Return a text on one line: a line or field separator would begin another field."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())
