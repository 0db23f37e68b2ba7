"""Limits of sizes that a drawing gives as a tolerance class, such as ``H7`` (references.md S7).

It covers grades IT5 to IT14 and letters D to P, usual for holes and shafts, up to 500 mm.
"""

import re
from typing import Final

# Largest size of each row [mm]; each tuple below has one value per row [um].
RANGES_MM: Final = (3, 6, 10, 18, 30, 50, 80, 120, 180, 250, 315, 400, 500)
GRADES: Final[dict[int, tuple[float, ...]]] = {  # S7, ISO 286-1 table 1
    5: (4, 5, 6, 8, 9, 11, 13, 15, 18, 20, 23, 25, 27),
    6: (6, 8, 9, 11, 13, 16, 19, 22, 25, 29, 32, 36, 40),
    7: (10, 12, 15, 18, 21, 25, 30, 35, 40, 46, 52, 57, 63),
    8: (14, 18, 22, 27, 33, 39, 46, 54, 63, 72, 81, 89, 97),
    9: (25, 30, 36, 43, 52, 62, 74, 87, 100, 115, 130, 140, 155),
    10: (40, 48, 58, 70, 84, 100, 120, 140, 160, 185, 210, 230, 250),
    11: (60, 75, 90, 110, 130, 160, 190, 220, 250, 290, 320, 360, 400),
    12: (100, 120, 150, 180, 210, 250, 300, 350, 400, 460, 520, 570, 630),
    13: (140, 180, 220, 270, 330, 390, 460, 540, 630, 720, 810, 890, 970),
    14: (250, 300, 360, 430, 520, 620, 740, 870, 1000, 1150, 1300, 1400, 1550),
}
BELOW: Final[dict[str, tuple[float, ...]]] = {  # upper deviation of shafts, negative; table 4
    "d": (20, 30, 40, 50, 65, 80, 100, 120, 145, 170, 190, 210, 230),
    "e": (14, 20, 25, 32, 40, 50, 60, 72, 85, 100, 110, 125, 135),
    "f": (6, 10, 13, 16, 20, 25, 30, 36, 43, 50, 56, 62, 68),
    "g": (2, 4, 5, 6, 7, 9, 10, 12, 14, 15, 17, 18, 20),
    "h": (0,) * 13,
}
ABOVE: Final[dict[str, tuple[float, ...]]] = {  # lower deviation of shafts, positive; table 5
    "k": (0, 1, 1, 1, 2, 2, 2, 3, 3, 4, 4, 4, 5),
    "m": (2, 4, 6, 7, 8, 9, 11, 13, 15, 17, 20, 21, 23),
    "n": (4, 8, 10, 12, 15, 17, 20, 23, 27, 31, 34, 37, 40),
    "p": (6, 12, 15, 18, 22, 26, 32, 37, 43, 50, 56, 62, 68),
}
K_GRADES: Final = (5, 6, 7)  # grades in which k does not begin at the nominal size
# Highest grade in which holes K to P are raised.
RAISED_TO: Final = {"k": 8, "m": 8, "n": 8, "p": 7}
M6_UM: Final = -9.0  # exception in ISO 286-1 to the rule: M6 from 250 to 315 mm
M6_RANGE: Final = 10
UM_PER_MM: Final = 1000.0
_FIT = re.compile(r"([A-Za-z]{1,2})(\d{1,2})")


def fit_limits_mm(fit: str, nominal_mm: float) -> tuple[float, float]:
    """Return the lower and the upper deviation of a tolerance class, with sign.

    Parameters
    ----------
    fit : letter and grade, such as ``H7`` or ``g6``; a capital letter for holes
    nominal_mm : nominal size

    Raises
    ------
    ValueError : the class is not in the table, or the size is above 500 mm
    """
    match = _FIT.fullmatch(fit.strip())
    if match is None:
        raise ValueError(f"{fit!r:.20} is no class of tolerance, as H7 or g6 are")
    letter, grade = match[1], int(match[2])
    known = letter.lower() in {*BELOW, *ABOVE, "js"} and (letter.islower() or letter.isupper())
    if not known or grade not in GRADES:
        raise ValueError(
            f"{fit!r:.20}: known are the letters D to P that are usual (D E F G H JS K M N P, and "
            f"the same in small letters), with the grades {min(GRADES)} to {max(GRADES)}"
        )
    row = next((i for i, largest in enumerate(RANGES_MM) if nominal_mm <= largest), None)
    if row is None or nominal_mm <= 0:
        raise ValueError(f"{fit!r:.20}: classes of tolerance are for sizes up to 500 mm")
    width = GRADES[grade][row]
    low, high = _shaft(letter, grade, row) if letter.islower() else _hole(letter, grade, row)
    if low is None:
        low = high - width  # type: ignore[operator]  # one of both is known
    return low / UM_PER_MM, (low + width) / UM_PER_MM


def _shaft(letter: str, grade: int, row: int) -> tuple[float | None, float | None]:
    """Return the lower or the upper deviation [um], as the letter states."""
    if letter == "js":
        return -GRADES[grade][row] / 2, None
    if letter in BELOW:
        return None, -BELOW[letter][row]
    if letter == "k" and grade not in K_GRADES:
        return 0.0, None
    return ABOVE[letter][row], None


def _hole(letter: str, grade: int, row: int) -> tuple[float | None, float | None]:
    """Return the lower or the upper deviation [um], as the letter states."""
    small = letter.lower()
    if small == "js":
        return -GRADES[grade][row] / 2, None
    if small in BELOW:
        return BELOW[small][row], None
    if (letter, grade, row) == ("M", 6, M6_RANGE):
        return None, M6_UM
    if grade > RAISED_TO[small]:
        is_zero = small == "k" or (small == "n" and row > 0)
        return None, 0.0 if is_zero else -ABOVE[small][row]
    if grade - 1 not in GRADES:
        raise ValueError(f"{letter}{grade}: grade {grade} of this letter is not known here")
    raised = GRADES[grade][row] - GRADES[grade - 1][row] if row > 0 else 0.0
    return None, raised - ABOVE[small][row]
