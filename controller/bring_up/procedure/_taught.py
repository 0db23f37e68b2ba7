"""Results of teaching by jog: the new text of the cell file, and the calibration of trays."""

import re
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Final, Literal

from controller.config import ConfigError
from controller.config.calibration_reference import CalibrationReference
from controller.config.calibrations import TraysCalibration

TrayName = Literal["accept", "reject", "quarantine"]
TRAYS: Final[tuple[TrayName, ...]] = ("accept", "reject", "quarantine")
# A person brings the TCP over the middle of a tray by eye, along a straightedge.
AIM_MM: Final = 1.5
VALID_DAYS: Final = 180
Values = Mapping[str, str]


def with_values(text: str, section: str, values: Values) -> str:
    """Return a cell file's text with other values of some keys; all else stays to the letter.

    A key that is not there yet comes behind the first one of these that is.

    Parameters
    ----------
    text : text of the cell file
    section : key at the top level
    values : by key of that section, as YAML on one line

    Raises
    ------
    ConfigError : the section is not there, or a value is not on one line
    """
    lines = text.splitlines(keepends=True)
    first, last = _section(lines, section)
    missing = dict(values)
    behind, indent = None, "  "
    for at in range(first, last):
        found = re.match(
            r"^(\s+)([\w]+):\s*(\{.*?\}|\[.*?\]|[^\s#{\[][^#\n]*?)?(\s*(#.*)?)$", lines[at]
        )
        if found is None or found[2] not in missing:
            continue
        if not found[3]:
            raise ConfigError(
                f"`{section}.{found[2]}` is spread over several lines: write it on one line, as in "
                f"{found[2]}: {values[found[2]]}"
            )
        indent, behind = found[1], behind or at
        lines[at] = f"{indent}{found[2]}: {missing.pop(found[2])}{found[4].rstrip()}\n"
    if behind is None:
        raise ConfigError(f"`{section}` has none of {', '.join(values)} on a line of its own")
    added = [f"{indent}{key}: {value}\n" for key, value in missing.items()]
    return "".join([*lines[: behind + 1], *added, *lines[behind + 1 :]])


def _section(lines: Sequence[str], name: str) -> tuple[int, int]:
    """Return the lines of a section at the top level, from behind its key to its end."""
    for at, line in enumerate(lines):
        if re.match(rf"^{re.escape(name)}\s*:\s*(#.*)?$", line):
            end = at + 1
            while end < len(lines) and not re.match(r"^[^\s#]", lines[end]):
                end += 1
            return at + 1, end
    raise ConfigError(f"`{name}:` is not a section with lines of its own; write it by hand")


def taught_trays(
    before: TraysCalibration | None,
    name: TrayName,
    centre_mm: tuple[float, float],
    *,
    u_mm: float,
    arm: CalibrationReference | None,
    now: datetime,
    by: str,
    software: str,
    cell: str,
) -> TraysCalibration:
    """Return the calibration of the trays with one of them taught anew.

    The others keep their age: the whole is as old as its oldest, and as uncertain as its worst.

    Parameters
    ----------
    before : results so far; None for none
    name, centre_mm : name and centre of the tray
    u_mm : standard uncertainty of this centre
    arm : the arm's calibration that it was taught with; None without one
    now, by, software, cell : for its header

    Raises
    ------
    ConfigError : the others were found with another calibration of the arm
    """
    based_on = {} if arm is None else {"arm": arm.sha256}
    centres = {} if before is None else dict(before.centres)
    others = set(centres) - {name}
    if before is not None and others:
        if before.based_on.get("arm") != based_on.get("arm"):
            raise ConfigError(
                f"the trays {', '.join(sorted(others))} were found with another calibration of the "
                "arm: repeat `cellctl commission --step trays`, or take `trays` out of "
                "`calibration` and teach all of them"
            )
        now, u_mm = min(now, before.measured), max(u_mm, before.u_mm)
    return TraysCalibration(
        measured=now,
        by=by,
        software=software,
        cell=cell,
        valid_days=VALID_DAYS,
        based_on=based_on,
        centres={**centres, name: (round(centre_mm[0], 2), round(centre_mm[1], 2))},
        u_mm=round(u_mm, 3),
    )
