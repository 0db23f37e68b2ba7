"""The fixed gripper with its opening as measured: its zero, and its scale.

All code above the driver uses true openings; the driver knows its own readings.
"""

from dataclasses import dataclass
from typing import cast

from drivers.kinds import FixedGripper, GraspReading, GripperReading, Hold
from drivers.supervisor import BlindStop, StopsBlindly


@dataclass(frozen=True, slots=True)
class OpeningScale:
    """A true opening as a function of its reading: ``zero_mm + scale * reading``."""

    zero_mm: float = 0.0
    scale: float = 1.0

    def true_mm(self, reading_mm: float) -> float:
        """Return the true opening at a reading."""
        return max(0.0, self.zero_mm + self.scale * reading_mm)

    def reading_mm(self, true_mm: float, widest_mm: float) -> float:
        """Return the reading at an opening, within the gripper's travel."""
        return min(max((true_mm - self.zero_mm) / self.scale, 0.0), widest_mm)


class _Reading:
    """A gripper's reading, with its opening as measured."""

    def __init__(self, reading: object, opening_mm: float) -> None:
        self._reading = reading
        self.opening_mm = opening_mm

    def __getattr__(self, name: str) -> object:
        return getattr(self._reading, name)


class MeasuredGripper:
    """A fixed gripper whose openings are true.

    Parameters
    ----------
    device : the driver
    openings : conversion of readings to true openings
    """

    def __init__(self, device: FixedGripper, openings: OpeningScale) -> None:
        self._device = device
        self._openings = openings

    def blind_stop(self) -> BlindStop | None:
        """Return the device's own stop, if it has one."""
        return self._device.blind_stop() if isinstance(self._device, StopsBlindly) else None

    @property
    def model(self) -> str:
        """The device's name in messages and the journal."""
        return self._device.model

    @property
    def max_opening_mm(self) -> float:
        """The largest opening [mm]."""
        return self._openings.true_mm(self._device.max_opening_mm)

    async def connect(self) -> GripperReading:
        """Open the line and return the first reading."""
        return self._measured(await self._device.connect())

    async def status(self) -> GripperReading:
        """Return a fresh reading."""
        return self._measured(await self._device.status())

    async def hold(self) -> Hold:
        """Return the state of the last grasp's hold."""
        return await self._device.hold()

    async def wait_lost(self) -> None:
        """Wait until the gripped part is known to be gone."""
        await self._device.wait_lost()

    async def activate(self) -> object:
        """Make it ready to move, which may move the jaws; return the driver's answer."""
        return await self._device.activate()

    async def open_to(self, opening_mm: float) -> object:
        """Move the jaws to an opening; return the driver's answer.

        Raises
        ------
        ValueError : the jaws do not open so far
        """
        if not 0.0 <= opening_mm <= max(self.max_opening_mm, self._device.max_opening_mm):
            raise ValueError(
                f"the jaws open 0..{self.max_opening_mm:.1f} mm, not {opening_mm:g} mm"
            )
        return await self._device.open_to(self._reading_mm(opening_mm))

    async def close_on(self, opening_mm: float, *, force_n: float) -> GraspReading:
        """Close on a part to about this opening with this force; return the reading."""
        found = await self._device.close_on(self._reading_mm(opening_mm), force_n=force_n)
        return cast(GraspReading, _Reading(found, self._openings.true_mm(found.opening_mm)))

    async def stop(self) -> object:
        """Stop the jaws where they are; return the driver's answer."""
        return await self._device.stop()

    async def aclose(self) -> None:
        """Leave the device unchanged."""
        await self._device.aclose()

    def _reading_mm(self, opening_mm: float) -> float:
        return self._openings.reading_mm(opening_mm, self._device.max_opening_mm)

    def _measured(self, reading: GripperReading) -> GripperReading:
        return cast(GripperReading, _Reading(reading, self._openings.true_mm(reading.opening_mm)))
