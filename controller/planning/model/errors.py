"""Reasons for no plan, sorted by the caller's possible response."""

from __future__ import annotations


class NoPlanError(Exception):
    """Root: this part, in this stable pose in this cell, cannot be handled."""


class NotGraspableError(NoPlanError):
    """No grasp holds: another gripper or finger is needed, or another start pose."""


class OutOfReachError(NoPlanError):
    """Out of the arm's reach: move the part (or the thing named).

    Parameters
    ----------
    message : for people
    reach_mm : reach required of the wrist
    limit_mm : reach of the arm
    where : place or motion concerned

    Attributes
    ----------
    reach_mm, limit_mm : reach required of the wrist, and that of the arm
    where : place or motion concerned
    """

    def __init__(self, message: str, *, reach_mm: float, limit_mm: float, where: str) -> None:
        super().__init__(message)
        self.reach_mm = reach_mm
        self.limit_mm = limit_mm
        self.where = where

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle hook: an exception is rebuilt from its positional arguments."""
        return _out_of_reach, (str(self), self.reach_mm, self.limit_mm, self.where)


class NoMotionError(NoPlanError):
    """Both ends can be held, but no collision-free path between them was found."""


def _out_of_reach(message: str, reach_mm: float, limit_mm: float, where: str) -> OutOfReachError:
    return OutOfReachError(message, reach_mm=reach_mm, limit_mm=limit_mm, where=where)
