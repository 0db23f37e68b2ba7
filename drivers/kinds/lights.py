"""A lamp unit: sets the brightness of lamps, and returns the instant from which it holds."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class Lamp:
    """A lamp, as the cell file wires it.

    Attributes
    ----------
    name : name used in the cell
    analog, relay : its channels, counted from 0
    drive : share of its full dimming that level 1 stands for
    settle_s : until its light is steady after a change [cell s]; None for the driver's own figure
    """

    name: str
    analog: int
    relay: int
    drive: float = 1.0
    settle_s: float | None = None


class LampUnit(Protocol):
    """All lamps of the cell.

    Attributes
    ----------
    model : name used in messages and the journal, once connected
    names : names of all lamps
    """

    @property
    def model(self) -> str: ...  # noqa: D102  (an attribute)

    @property
    def names(self) -> tuple[str, ...]: ...  # noqa: D102  (an attribute)

    async def connect(self) -> object:
        """Check the unit's identity, switch nothing; return it, for the log."""
        ...

    async def set(self, levels: Mapping[str, float], *, settle: bool = False) -> float:
        """Set lamps by name to levels 0 (dark) to 1, not the others; return once they have them.

        Returns the cell instant from which on the light is so [s]. With ``settle`` it waits until
        the light is steady.
        """
        ...

    async def all_off(self) -> float:
        """Switch every lamp off; return what `set` returns."""
        ...
