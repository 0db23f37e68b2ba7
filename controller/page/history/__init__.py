"""*History*: the parts of all runs, run charts, one part's record, two parts compared."""

from ..frame.screens import Screen, Setting
from ..frame.words import word
from ..records import Records
from .answers import HistoryAnswers

__all__ = ["screen"]


def screen(setting: Setting) -> Screen:
    """Return the screen."""
    records = Records.of(setting.runs_dir)
    return Screen("history", word("History"), HistoryAnswers(records).every, beside=records.kept)
