"""Kinds of pause, and the safe points that a pause may wait for. Words and data alone."""

from collections.abc import Mapping
from enum import StrEnum
from typing import Final

from .table import Event


class PauseKind(StrEnum):
    """The start of a pause, the least urgent first; the value is what a person types."""

    AFTER_STEP = "step"
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
    PauseKind.AFTER_STEP: "after this step",
    PauseKind.SAFE_POINT: "at the next safe point",
    PauseKind.NOW: "now",
}


class SafePoint(StrEnum):
    """A point at which the cell may stand for any time; the value is for people.

    Nothing is being closed or opened, nothing is near contact, and custody is known.
    """

    PARKED = "the arm is parked and empty"
    STANDING = "the arm stands still where it was, before it withdraws"
    ABOVE_TABLE = "the arm stands above the part, its jaws open"
    LIFTED = "the arm gripper has the part, clear of the table"
    AT_VIEW = "the arm gripper has the part, before the inspection camera"
    IN_FIXED = "the fixed gripper has the part, the arm is clear of it"
    TAKEN_BACK = "the arm gripper has the part again, clear of the fixed gripper"
    BEFORE_SETTING_DOWN = "the arm gripper has the part, above the table"
    SET_DOWN = "the part is on the table, the arm is clear of it"
    BEFORE_PLACING = "the arm gripper has the part, above its tray"
    PLACED = "the part is in its tray, the arm is clear of it"
