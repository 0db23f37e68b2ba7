"""*Cell*: its devices, calibrations, commissioning and drift, and the pictures it took last.

`cells.py` has what files and journal say, `pictures.py` measures pictures from their files,
`answers.py` answers. Devices are asked by `cellctl doctor` alone, in a child process that holds the
cell's lock.
"""

from ..frame.screens import Screen, Setting
from ..frame.words import word
from ..work import Workshop
from .answers import CellAnswers

__all__ = ["screen"]


def screen(setting: Setting) -> Screen:
    """Return the screen."""
    answers = CellAnswers(setting, Workshop())
    return Screen("cell", word("Cell"), answers.every, beside=answers.open)
