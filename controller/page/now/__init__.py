"""*Now*: what the cell does, and what a person orders it to do.

`live.py` polls, `fold.py` folds the journal, `scene.py` draws, `answers.py` answers.
"""

from ..frame.screens import Screen, Setting
from ..frame.words import word
from .answers import NowAnswers
from .live import Live

__all__ = ["screen"]


def screen(setting: Setting) -> Screen:
    """Return the screen."""
    answers = NowAnswers(setting, Live(setting.runs_dir))
    return Screen("now", word("Now"), answers.every, beside=answers.polling)
