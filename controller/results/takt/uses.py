"""The uses of the arm's time: its own work, and the things it waits for."""

from enum import StrEnum
from typing import Final


class TimeUse(StrEnum):
    """The use of a span of time; the value is its name in JSON, `words` in a sentence."""

    words: str

    def __new__(cls, value: str, words: str) -> "TimeUse":
        """Make a member of its name and its words."""
        made = str.__new__(cls, value)
        made._value_ = value
        made.words = words
        return made

    MOVING = "moving", "moving"
    JAWS = "jaws", "jaws"
    SHOWING = "showing", "before the camera"
    TABLE_PICTURES = "table_pictures", "pictures of the table"
    RECOGNITION = "recognition", "recognition"
    PLANNING = "planning", "planning"
    EVALUATION = "evaluation", "evaluation"
    PERSON = "person", "a person"
    PAUSE = "pause", "a pause"
    HOMING = "homing", "homing"
    REST = "rest", "the rest"


# Uses in which the arm follows the plan. It is idle in all other spans.
BUSY: Final = frozenset({TimeUse.MOVING, TimeUse.JAWS, TimeUse.SHOWING})
