"""Reference values of a gauge study, from a table: characteristic, value, U, part."""

import csv
import io
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Final

from controller.config import ConfigError
from controller.config.files import is_sensible, read_text
from controller.config.parts_list import table_of
from controller.yaml_text import DECIMAL_COMMA

MAX_BYTES: Final = 2**20
COLUMNS: Final = ("characteristic", "value", "U", "part")
NUMBERS: Final = COLUMNS[1:3]


@dataclass(frozen=True, slots=True)
class Reference:
    """A value known from elsewhere, with its expanded uncertainty (k = 2).

    Attributes
    ----------
    id : id of the characteristic
    part : part; empty for every part
    """

    id: str
    value: float
    U: float
    part: str = ""


def read_references(path: Path, known: Collection[str], parts: Collection[str]) -> list[Reference]:
    """Return the reference values in a file (CSV, with comma or semicolon).

    Parameters
    ----------
    path : the file
    known : characteristics that were measured
    parts : names of the parts measured

    Raises
    ------
    ConfigError : not such a table, no number, or something that was not measured
    """
    text, mark, skipped = table_of(read_text(path, "a table of reference values", MAX_BYTES))
    table = csv.DictReader(io.StringIO(text), delimiter=mark, skipinitialspace=True)
    names = [name.strip() for name in table.fieldnames or ()]
    table.fieldnames = names
    missing = [name for name in COLUMNS[:2] if name not in names]
    unknown = [name for name in names if name not in COLUMNS]
    if missing or unknown:
        what = f"no column `{missing[0]}`" if missing else f"unknown column `{unknown[0]}`"
        raise ConfigError(
            f"{path}:{1 + skipped}: {what}; the first line names the columns: characteristic, "
            "value, and as you have them U (k = 2) and part"
        )
    found = []
    for row in table:
        where = f"{path}:{table.line_num + skipped}"
        one = {key: (value or "").strip() for key, value in row.items() if isinstance(key, str)}
        if any(value.strip() for value in row.get(table.restkey, ())):
            raise ConfigError(
                f"{where}: more values than columns; where numbers have decimal commas, semicolons "
                "or tabs stand between the values"
            )
        if mark != ",":  # then a comma in a number is a decimal sign
            for key in NUMBERS:
                one[key] = DECIMAL_COMMA.sub(r"\1.\2", one.get(key, ""))
        name, part = one["characteristic"], one.get("part", "")
        if name not in known:
            near = get_close_matches(name, known, 2, 0.5) or sorted(known)[:2]
            raise ConfigError(
                f"{where}: no characteristic {name!r:.80} was measured; nearest: {', '.join(near)}"
            )
        if part and part not in parts:
            raise ConfigError(
                f"{where}: no part {part!r:.80} was measured; there are "
                f"{', '.join(sorted(p for p in parts if p)) or 'parts without a name only'}"
            )
        U = _number(one, "U", where) if one.get("U") else 0.0
        if U < 0:
            raise ConfigError(f"{where}: U is {U:g}; an uncertainty is not below 0")
        found.append(Reference(name, _number(one, "value", where), U, part))
    if not found:
        raise ConfigError(f"{path}: has no reference value; one line for each is expected")
    return found


def _number(row: Mapping[str, str], key: str, where: str) -> float:
    try:
        value = float(row[key])
    except ValueError:
        value = math.nan
    if not is_sensible(value):
        raise ConfigError(f"{where}: {key} is {row[key]!r:.40}; a number is expected")
    return value
