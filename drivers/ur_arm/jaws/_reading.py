"""What the arm needs of a gripper on its flange, whatever wire it has.

Sections (§) are those of ur.md.
"""

from dataclasses import dataclass
from typing import Protocol

__all__ = ["JawScale", "JawState", "Jaws"]


@dataclass(frozen=True, slots=True)
class JawState:
    """One reading of the jaws.

    Attributes
    ----------
    opening_mm : between the fingertips [mm]
    is_activated : they can move without an activation, which would open and close them
    is_moving : they are under way
    is_pressing : they press on something, or shut on each other
    """

    opening_mm: float
    is_activated: bool
    is_moving: bool
    is_pressing: bool


@dataclass(frozen=True, slots=True)
class JawScale:
    """The scales of a Robotiq 2F-85 as delivered (§6.2).

    Attributes
    ----------
    open_mm : opening at ``counts_open`` [mm]
    counts_open, counts_closed : position fully open, and with the fingertips touching
    min_speed_mm_s, max_speed_mm_s : speed at 0 and 255
    min_force_n, max_force_n : force at 0 and 255
    """

    open_mm: float = 85.0
    counts_open: int = 3
    counts_closed: int = 230
    min_speed_mm_s: float = 20.0
    max_speed_mm_s: float = 150.0
    min_force_n: float = 20.0
    max_force_n: float = 235.0

    @property
    def mm_per_count(self) -> float:
        """Travel of the jaws for one count [mm]."""
        return self.open_mm / (self.counts_closed - self.counts_open)

    def opening_mm(self, counts: int) -> float:
        """Return the opening at a position [mm], 0 where the fingertips touch."""
        return max(0.0, (self.counts_closed - counts) * self.mm_per_count)

    def counts(self, opening_mm: float) -> int:
        """Return the position for an opening [mm]; the ends lie beyond the stops."""
        if opening_mm <= 0.0:
            return 255
        if opening_mm >= self.open_mm:
            return 0
        return round(self.counts_closed - opening_mm / self.mm_per_count)

    def speed_byte(self, speed_mm_s: float) -> int:
        """Return the byte of the nearest speed that it has [mm/s]."""
        return _byte(speed_mm_s, self.min_speed_mm_s, self.max_speed_mm_s)

    def force_byte(self, force_n: float) -> int:
        """Return the byte of the nearest force that it has [N]."""
        return _byte(force_n, self.min_force_n, self.max_force_n)


class Jaws(Protocol):
    """A gripper on the flange. Nothing moves but by `activate`, `move_to` and `close`."""

    @property
    def model(self) -> str:
        """Name in messages and the journal."""
        ...

    @property
    def max_opening_mm(self) -> float:
        """Largest opening [mm]."""
        ...

    @property
    def force_range_n(self) -> tuple[float, float]:
        """Least and largest force of a grasp [N]."""
        ...

    async def connect(self) -> JawState:
        """Open the line; return the first reading."""
        ...

    async def read(self) -> JawState:
        """Return a fresh reading."""
        ...

    async def activate(self) -> None:
        """Make them ready to move, which opens and closes them."""
        ...

    async def move_to(self, opening_mm: float) -> JawState:
        """Move empty jaws; return the reading where they have come to rest."""
        ...

    async def close(self, force_n: float, speed_share: float) -> JawState:
        """Close with a force until they rest; return the reading there.

        Parameters
        ----------
        force_n : force [N]
        speed_share : share of the usual speed
        """
        ...

    async def stop(self) -> None:
        """Stop jaws that are under way; those that hold something go on holding."""
        ...

    async def aclose(self) -> None:
        """Release the line; opens no jaw."""
        ...


def _byte(value: float, low: float, high: float) -> int:
    return round(255 * (min(max(value, low), high) - low) / (high - low))
