"""*Review*: parts that await a person, their findings, and the person's verdict."""

from ..frame.screens import Screen, Setting
from ..frame.words import word
from ..records import Records
from .answers import ReviewAnswers

__all__ = ["screen"]


def screen(setting: Setting) -> Screen:
    """Return the screen."""
    records = Records.of(setting.runs_dir)
    return Screen(
        "review", word("Review"), ReviewAnswers(setting, records).every, beside=records.kept
    )
