"""A gripper whose jaws are wider open than they read by a measured distance."""

from dataclasses import replace

from ._reading import Jaws, JawState

__all__ = ["ZeroedJaws"]


class ZeroedJaws:
    """A gripper with a measured zero.

    Parameters
    ----------
    jaws : as its driver reads it
    zero_mm : true opening where that reads 0
    """

    def __init__(self, jaws: Jaws, zero_mm: float) -> None:
        self._jaws, self._zero_mm = jaws, zero_mm

    @property
    def model(self) -> str:
        """Name in messages and the journal."""
        return self._jaws.model

    @property
    def max_opening_mm(self) -> float:
        """Largest opening [mm], as the design has it: what is asked of any such gripper."""
        return self._jaws.max_opening_mm

    @property
    def force_range_n(self) -> tuple[float, float]:
        """Least and largest force of a grasp [N]."""
        return self._jaws.force_range_n

    async def connect(self) -> JawState:
        """Open the line; return the first reading."""
        return self._true(await self._jaws.connect())

    async def read(self) -> JawState:
        """Return a fresh reading."""
        return self._true(await self._jaws.read())

    async def activate(self) -> None:
        """Make them ready to move, which opens and closes them."""
        await self._jaws.activate()

    async def move_to(self, opening_mm: float) -> JawState:
        """Move empty jaws; return the reading where they have come to rest."""
        asked_mm = min(max(opening_mm - self._zero_mm, 0.0), self._jaws.max_opening_mm)
        return self._true(await self._jaws.move_to(asked_mm))

    async def close(self, force_n: float, speed_share: float) -> JawState:
        """Close with a force until they rest; return the reading there.

        Parameters
        ----------
        force_n : force [N]
        speed_share : share of the usual speed
        """
        return self._true(await self._jaws.close(force_n, speed_share))

    async def stop(self) -> None:
        """Stop jaws that are under way; those that hold something go on holding."""
        await self._jaws.stop()

    async def aclose(self) -> None:
        """Release the line; opens no jaw."""
        await self._jaws.aclose()

    def _true(self, state: JawState) -> JawState:
        return replace(state, opening_mm=max(0.0, state.opening_mm + self._zero_mm))
