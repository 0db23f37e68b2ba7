"""What the arm needs of a gripper on its flange, whatever wire it has."""

from dataclasses import dataclass
from typing import Protocol

__all__ = ["JawState", "Jaws"]


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
