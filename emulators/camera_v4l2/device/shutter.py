"""The exposure times of frames: the sensor's rhythm, as arithmetic on world time."""

import math
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FrameGrid:
    """Frame k is exposed from `started_s + k * period_s` on, for at most one period.

    Attributes
    ----------
    started_s, period_s : [world s]
    exposure_s : frame number -> how long it is exposed [world s]
    """

    started_s: float
    period_s: float
    exposure_s: Callable[[int], float]

    def start_s(self, frame: int) -> float:
        """Return the start of a frame's exposure [world s]."""
        return self.started_s + frame * self.period_s

    def end_s(self, frame: int) -> float:
        """Return the end of a frame's exposure [world s]."""
        return self.start_s(frame) + min(self.period_s, self.exposure_s(frame))

    def first_from(self, instant_s: float) -> int:
        """Return the first frame whose exposure begins at or after an instant [world s]."""
        return max(0, math.ceil((instant_s - self.started_s) / self.period_s))

    def latest_ended(self, now_s: float) -> int:
        """Return the latest frame whose exposure is over, -1 before the first."""
        begun = math.floor((now_s - self.started_s) / self.period_s)
        return begun if begun >= 0 and self.end_s(begun) <= now_s else begun - 1
