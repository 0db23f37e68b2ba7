"""An I/O block's option beside its inputs: a watchdog that takes the motors' supply away.

Not every make has one, and not every cell has it wired. It needs no program of ours to work: a
relay of the block is in the motors' supply, and opens once the block has heard nothing for a while.
"""

from typing import Protocol, runtime_checkable


@runtime_checkable
class SupplySense(Protocol):
    """An arm that reports its motors' supply."""

    async def read_motor_supply(self) -> bool:
        """Return whether the motors have their supply now, with power enabled or without."""
        ...


@runtime_checkable
class MotorWatchdog(Protocol):
    """An I/O block that can take the motors' supply away by itself.

    Attributes
    ----------
    watchdog_s : silence after which it does [cell s]; None if the cell has it not wired
    """

    @property
    def watchdog_s(self) -> float | None: ...  # noqa: D102  (an attribute)

    async def prove_watchdog(self) -> None:
        """Prove that it trips, then give the motors their supply; nothing if there is none.

        To be called while nothing moves, as `fall_silent` is.
        """
        ...

    async def fall_silent(self) -> bool:
        """Send nothing for long enough; return whether the watchdog has tripped.

        To be called while nothing moves: inputs are unknown meanwhile, and no change of them is
        reported. They are read before this returns.
        """
        ...

    async def restore_motor_supply(self) -> None:
        """Make the watchdog watch again and close its relay. Motors stay without power."""
        ...

    async def wait_tripped(self) -> None:
        """Wait until the watchdog has tripped by itself."""
        ...
