"""Register map of the Robotiq 2F family: modbus_devices.md 2.2 to 2.5. Bytes in, meaning out.

Sections (§) are those of modbus_devices.md.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from ._jaws import (
    MAX_FORCE_N,
    MAX_SPEED_MM_PER_S,
    MIN_FORCE_N,
    MIN_SPEED_MM_PER_S,
    STROKE_MM,
)

OUTPUT_START: Final = 0x03E8  # what the master writes; §2.2
OUTPUT_COUNT: Final = 8
INPUT_START: Final = 0x07D0  # what the gripper reports; §2.3
INPUT_COUNT: Final = 3

ACTIVATE: Final = 1 << 0  # rACT; §2.2
GO_TO: Final = 1 << 3  # rGTO
RELEASE: Final = 1 << 4  # rATR
RELEASE_OPENS: Final = 1 << 5  # rARD

MA_PER_COUNT: Final = 10.0  # §2.3, gCU
FULL_COUNTS: Final = 255


class GripperStatus(IntEnum):
    """GSTA; 2.3."""

    RESET = 0
    ACTIVATING = 1
    ACTIVE = 3


class ObjectStatus(IntEnum):
    """GOBJ; 2.3."""

    MOVING = 0
    TOUCHED_OPENING = 1
    TOUCHED_CLOSING = 2
    AT_POSITION = 3


class Fault(IntEnum):
    """GFLT; 2.4."""

    NONE = 0x00
    ACTION_DELAYED = 0x05
    NOT_ACTIVATED = 0x07
    OVER_TEMPERATURE = 0x08
    NO_COMMUNICATION = 0x09
    UNDER_VOLTAGE = 0x0A
    RELEASING = 0x0B
    INTERNAL = 0x0C
    ACTIVATION_FAILED = 0x0D
    OVER_CURRENT = 0x0E
    RELEASED = 0x0F


MAJOR_FAULTS: Final = frozenset(
    {Fault.UNDER_VOLTAGE, Fault.INTERNAL, Fault.ACTIVATION_FAILED, Fault.OVER_CURRENT}
)


@dataclass(frozen=True, slots=True)
class JawScale:
    """The encoder's readings at the ends of the stroke; §2.5, standard fingertips.

    Attributes
    ----------
    open_counts, closed_counts : gPO with the jaws fully open and fully closed
    wider_mm : by how much thinner fingertips leave the jaws wider open at the same encoder
    stretch : stretch of a true stroke against the design's, which comes on top
    """

    open_counts: int = 3
    closed_counts: int = 230
    wider_mm: float = 0.0
    stretch: float = 1.0

    def counts(self, opening_mm: float) -> int:
        """Return gPO of an opening."""
        span = self.closed_counts - self.open_counts
        by_design_mm = (opening_mm - self.wider_mm) / self.stretch
        counts = self.open_counts + span * (STROKE_MM - by_design_mm) / STROKE_MM
        return min(max(round(counts), 0), FULL_COUNTS)

    def opening_mm(self, counts: int) -> float:
        """Return the opening for a value of rPR; beyond the ends of the stroke it is the end."""
        span = self.closed_counts - self.open_counts
        by_design_mm = STROKE_MM - STROKE_MM * (counts - self.open_counts) / span
        return min(max(self.wider_mm + self.stretch * by_design_mm, 0.0), STROKE_MM)


def speed_mm_per_s(counts: int) -> float:
    """Return the speed of rSP [mm/s]; §2.5, linear between the ends."""
    span = MAX_SPEED_MM_PER_S - MIN_SPEED_MM_PER_S
    return MIN_SPEED_MM_PER_S + span * counts / FULL_COUNTS


def force_n(counts: int) -> float:
    """Return the force of rFR [N]; §2.5, linear between the ends."""
    return MIN_FORCE_N + (MAX_FORCE_N - MIN_FORCE_N) * counts / FULL_COUNTS


def current_counts(current_ma: float) -> int:
    """Return gCU of a current; 2.3."""
    return min(max(round(current_ma / MA_PER_COUNT), 0), FULL_COUNTS)
