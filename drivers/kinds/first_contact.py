"""An arm's options for its first motions ever: registers, one motor at a time, homing in turn.

Not every make has it. Commissioning uses it where it is there, and homes in one go elsewhere.
"""

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

Confirm = Callable[[str], Awaitable[None]]


@dataclass(frozen=True, slots=True)
class MotorTry:
    """The result of one motor's trial.

    Attributes
    ----------
    motor : its name
    ordered_counts, went_counts : distance ordered, and distance gone
    back_counts : distance from its start at which it ended, after the order to go back
    seconds : from the order to its rest, there
    """

    motor: str
    ordered_counts: int
    went_counts: int
    back_counts: int
    seconds: float


@runtime_checkable
class FirstContact(Protocol):
    """An arm whose motors can be inspected and tried one by one.

    Attributes
    ----------
    motors : their names
    """

    @property
    def motors(self) -> tuple[str, ...]: ...  # noqa: D102  (an attribute)

    async def read_registers(self) -> Mapping[str, Mapping[str, int]]:
        """Return the registers of each motor by name; nothing moves."""
        ...

    async def try_motor(self, motor: str) -> MotorTry:
        """Move one motor a little and back, before homing; return the result."""
        ...

    async def home_in_turn(self, confirm: Confirm) -> None:
        """Home as `Arm.home` does; ``confirm`` is awaited with each motion before it begins."""
        ...


@runtime_checkable
class Encoders(Protocol):
    """An arm whose encoders can be read even before it is homed."""

    async def read_encoders(self) -> Mapping[str, int]:
        """Return each motor's encoder count, by name; nothing moves."""
        ...
