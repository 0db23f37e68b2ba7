"""Units of length that a caller may declare and that files name; millimetres inside."""

from pathlib import Path
from typing import Final

from ..errors import UnitCadError
from ..solid import MM_PER_INCH, MM_PER_M

MM_PER_UNIT: Final = {"mm": 1.0, "cm": 10.0, "m": MM_PER_M, "inch": MM_PER_INCH}
SPELLINGS: Final = {"in": "inch", "inches": "inch", "millimeter": "mm", "centimeter": "cm"} | {
    "meter": "m",  # 3MF core specification 3.4: these, inch, foot and micron
}
OTHER_MM_PER_UNIT: Final = {"micron": 1e-3, "foot": 304.8}


def read_unit(unit: str, where: Path) -> tuple[str, float]:
    """Return the name of a unit as used here, and its length in millimetres.

    Raises
    ------
    UnitCadError : an unknown unit
    """
    name = SPELLINGS.get(unit, unit)
    length_mm = (MM_PER_UNIT | OTHER_MM_PER_UNIT).get(name)
    if length_mm is None:
        known = ", ".join(MM_PER_UNIT)
        raise UnitCadError(f"{where}: unit {unit!r:.40} is not known; declare one of {known}")
    return name, length_mm


def check_unit(asked: str | None, stated: str, where: Path) -> None:
    """Require that a declared unit is the one that the file names.

    Parameters
    ----------
    asked : unit the caller declares, in any spelling that `read_unit` knows; None for no claim
    stated : the file's own, as `read_unit` names it
    where : the file, for the message

    Raises
    ------
    UnitCadError : the two differ, or the declared one is not known
    """
    if asked is not None and read_unit(asked, where)[0] != stated:
        raise UnitCadError(
            f"{where}: the file is in {stated} by its own statement, not in {asked}; "
            "leave the unit out, or mend the file"
        )
