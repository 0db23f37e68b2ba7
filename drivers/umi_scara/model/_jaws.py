"""The opening of the UMI gripper's jaws for its motor counts (umi_rtx.md 5.5).

Sections (§) are those of umi_rtx.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

from messages import say

from ..protocol import constants as c
from .limits import OutOfRangeError


@dataclass(frozen=True, slots=True)
class GripperLaw:
    """Quadratic law of the pincer linkage: opening = offset + linear n + quadratic n^2 [mm].

    The default is London Hackspace's fit, which §5.5 recommends until three openings have been
    measured on the arm itself.
    """

    offset_mm: float = 0.0
    linear_mm: float = 0.0584
    quadratic_mm: float = 1.07e-5

    def __post_init__(self) -> None:
        for counts in c.GRIPPER_RANGE:
            if self.linear_mm + 2 * self.quadratic_mm * counts <= 0:
                raise ValueError(f"the jaws do not open steadily at {counts} counts: {self}")

    @classmethod
    def through(cls, points: Sequence[tuple[int, float]]) -> "GripperLaw":
        """Return the law through three measured pairs of counts and opening [mm].

        Raises
        ------
        ValueError : not three points, or two of them at the same counts
        """
        if len({counts for counts, _ in points}) != 3 or len(points) != 3:
            raise ValueError("a law needs three points at different counts")
        (n0, w0), (n1, w1), (n2, w2) = points
        slope_01, slope_12 = (w1 - w0) / (n1 - n0), (w2 - w1) / (n2 - n1)
        quadratic = (slope_12 - slope_01) / (n2 - n0)
        linear = slope_01 - quadratic * (n0 + n1)
        return cls(w0 - linear * n0 - quadratic * n0 * n0, linear, quadratic)

    def opening_mm(self, counts: float) -> float:
        """Return the opening [mm]; counts below the closed end read as 0, not as less."""
        return max(
            0.0, self.offset_mm + self.linear_mm * counts + self.quadratic_mm * counts * counts
        )

    @property
    def max_opening_mm(self) -> float:
        """Opening at the last count of the range [mm]."""
        return self.opening_mm(c.GRIPPER_RANGE[1])

    def counts(self, opening_mm: float) -> int:
        """Return the whole counts nearest to an opening [mm].

        Raises
        ------
        OutOfRangeError : the jaws do not open so far
        """
        if not 0 <= opening_mm <= self.max_opening_mm + 1e-9:
            raise OutOfRangeError(
                say(
                    "gripper ({opening_mm:.1f} mm of 0 to {max_opening_mm:.1f} mm)",
                    opening_mm=opening_mm,
                    max_opening_mm=self.max_opening_mm,
                ),
                self._inverse(max(opening_mm, 0.0)),
                c.GRIPPER_RANGE[0 if opening_mm < 0 else 1],
            )
        low, high = c.GRIPPER_RANGE
        return min(max(round(self._inverse(opening_mm)), low), high)

    def _inverse(self, opening_mm: float) -> float:
        rise_mm = opening_mm - self.offset_mm
        if self.quadratic_mm == 0:
            return rise_mm / self.linear_mm
        root = sqrt(max(0.0, self.linear_mm**2 + 4 * self.quadratic_mm * rise_mm))
        return (root - self.linear_mm) / (2 * self.quadratic_mm)
