"""*Now*: the cell's present activity, and orders to the cell.

`live.py` polls, `fold.py` folds the journal, `scene.py` draws, `starting.py` starts runs,
`answers.py` answers.
"""

from ..frame.screens import Screen, Setting
from ..frame.words import word
from .answers import NowAnswers
from .live import Live
from .starting import Launcher

__all__ = ["screen"]


def screen(setting: Setting) -> Screen:
    """Return the screen."""
    launcher = Launcher(setting)
    live = Live(setting.runs_dir, launcher.facts)
    answers = NowAnswers(setting, live, launcher)
    return Screen("now", word("Now"), answers.every, beside=answers.polling, hang_up=live.hang_up)
