"""*Cell*: its devices, calibrations, commissioning and drift, and the pictures it took last.

`cells.py` has the data from files and journal, `pictures.py` measures pictures from their files,
`answers.py` answers. Only `cellctl doctor` connects to devices, in a child process that holds the
cell's lock.
"""

from typing import Final

from ..frame.screens import Screen, Setting
from ..frame.words import word
from ..work import Workshop
from .answers import CellAnswers

__all__ = ["screen"]

PATIENCE_S: Final = 20.0  # the doctor switches lamps off and closes devices before it ends


def screen(setting: Setting) -> Screen:
    """Return the screen."""
    doctors = Workshop(patience_s=PATIENCE_S)
    answers = CellAnswers(setting, doctors)
    return Screen("cell", word("Cell"), answers.every, beside=doctors.open)
