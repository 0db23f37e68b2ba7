"""Cameras without pictures: a frame takes its time and holds the part's pose.

Lamps, faults and plugs are the emulated camera's and lamps' own: a camera that is unplugged,
stalled, frozen or without light behaves as its driver would report it.
"""

from dataclasses import replace
from typing import Final

from drivers.clock import CellClock
from drivers.errors import LinkError, ReplyTimeoutError, UnpluggedError
from emulators.in_process import Cell, EmulatedCamera
from emulators.world.ground_truth import custody, part_pose

from .stand_ins import SIZE_PX, TruthFrame, stamped_picture

FRAME_S: Final = 0.26  # a period of 5 Hz, the exposure, and its transfer
DARK_LEVEL: Final = 0.02  # share of the light of all lamps together, 0..1
CAMERA_TIMEOUT_S: Final = 1.6  # time-out of a missing frame: eight periods of 5 Hz


class Plugs:
    """The cameras' cables; the emulated cell's `CameraPlugs`.

    Attributes
    ----------
    cameras : cameras of the emulated cell, by name
    """

    def __init__(self) -> None:
        self.cameras: dict[str, EmulatedCamera] = {}

    def unplug(self, name: str) -> None:
        """Pull a camera's cable."""
        self.cameras[name].unplug()

    def plug(self, name: str) -> str:
        """Put an unplugged camera back; return its address."""
        self.cameras[name].plug()
        return f"simulated-{name}"


class TruthCamera:
    """A camera as the cell uses it (`drivers.kinds.Camera`).

    Parameters
    ----------
    name : name of the camera in the cell file
    cell : the emulated cell that it looks at
    clock : clock of the cell
    """

    def __init__(self, name: str, cell: Cell, clock: CellClock) -> None:
        self._name, self._cell, self._clock = name, cell, clock
        self._device = cell.cameras[name]
        self._is_open = False
        self._last: TruthFrame | None = None
        self.is_paused = False
        self.model = "no camera: truth with noise"
        self.shape = SIZE_PX[::-1]

    async def connect(self) -> None:
        """Open it.

        Raises
        ------
        LinkError : it is not plugged in
        """
        await self._clock.sleep(0.05)
        if not self._device.is_plugged:
            raise LinkError(f"camera {self._name}: no such camera; check its plug")
        self._is_open = True

    async def pause(self) -> None:
        """Stop the frames."""
        self.is_paused = True

    async def resume(self) -> None:
        """Start the frames again."""
        self._require_plug()
        self.is_paused = False

    async def close(self) -> None:
        """Close it."""
        self._is_open = False

    async def frame_after(self, t_s: float, timeout_s: float | None = None) -> TruthFrame:
        """Return a picture that holds the part's true pose, exposed after an instant.

        Raises
        ------
        UnpluggedError : it left
        ReplyTimeoutError : no frame comes
        """
        del timeout_s
        await self._clock.sleep(max(0.0, t_s - self._clock.now_s()) + FRAME_S)
        self._require_plug()
        faults = self._device.faults
        if faults.late_count:
            self._device.faults = replace(faults, late_count=faults.late_count - 1)
            await self._clock.sleep(faults.late_s)
        if faults.is_stalled:
            await self._clock.sleep(CAMERA_TIMEOUT_S)
            raise ReplyTimeoutError(f"camera {self._name}: no frame; check its plug")
        if faults.is_frozen and self._last is not None:
            return self._last
        is_dark = faults.is_dark or sum(self._cell.levels().values()) < DARK_LEVEL
        world = self._cell.world
        first, *further = (
            (part_pose(world, part.index), custody(world, part.index)) for part in world.parts
        )
        self._last = TruthFrame(stamped_picture(*first, *further, is_dark=is_dark))
        return self._last

    def _require_plug(self) -> None:
        if not self._device.is_plugged:
            raise UnpluggedError(f"camera {self._name} is gone; check its plug")
