"""Kinds of pause, and the safe points that a pause may wait for. Words and data alone."""

from collections.abc import Mapping
from enum import StrEnum
from typing import Final

from messages import key

from .table import Event


class PauseKind(StrEnum):
    """The start of a pause, the least urgent first; the value is what a person types."""

    AFTER_STEP = key("step")
    SAFE_POINT = "safe"
    NOW = "now"

    @property
    def urgency(self) -> int:
        """The urgency: the higher, the sooner the cell stands."""
        return list(PauseKind).index(self)


PAUSE_EVENTS: Final[Mapping[PauseKind, Event]] = {
    PauseKind.AFTER_STEP: Event.PAUSE_AFTER_STEP,
    PauseKind.SAFE_POINT: Event.PAUSE_AT_SAFE_POINT,
    PauseKind.NOW: Event.PAUSE_NOW,
}
PAUSE_WORDS: Final[Mapping[PauseKind, str]] = {
    PauseKind.AFTER_STEP: key("after this step"),
    PauseKind.SAFE_POINT: key("at the next safe point"),
    PauseKind.NOW: "now",
}


class SafePoint(StrEnum):
    """A point at which the cell may stand for any time; the value is for people.

    Nothing is being closed or opened, nothing is near contact, and custody is known.
    """

    PARKED = key("the arm is parked and empty")
    STANDING = key("the arm stands still where it was, before it withdraws")
    ABOVE_TABLE = key("the arm stands above the part, its jaws open")
    LIFTED = key("the arm gripper has the part, clear of the table")
    AT_VIEW = key("the arm gripper has the part, before the inspection camera")
    IN_FIXED = key("the fixed gripper has the part, the arm is clear of it")
    TAKEN_BACK = key("the arm gripper has the part again, clear of the fixed gripper")
    BEFORE_SETTING_DOWN = key("the arm gripper has the part, above the table")
    SET_DOWN = key("the part is on the table, the arm is clear of it")
    BEFORE_PLACING = key("the arm gripper has the part, above its tray")
    PLACED = key("the part is in its tray, the arm is clear of it")
