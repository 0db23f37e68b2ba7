"""*Now*: the cell's present activity, and orders to the cell.

`live.py` polls, `fold.py` folds the journal, `scene.py` draws, `answers.py` answers; runs are
started by `controller.launching`.
"""

from controller.launching import Launcher

from ..frame.screens import Screen, Setting
from ..frame.words import word
from .answers import NowAnswers
from .live import Live

__all__ = ["screen"]


def screen(setting: Setting) -> Screen:
    """Return the screen."""
    launcher = Launcher(setting.runs_dir, setting.project_dir)
    live = Live(setting.runs_dir, launcher.facts)
    answers = NowAnswers(setting, live, launcher)
    return Screen("now", word("Now"), answers.every, beside=answers.polling, hang_up=live.hang_up)
