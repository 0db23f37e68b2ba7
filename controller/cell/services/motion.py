"""Moves the arm along checked paths, and remembers them, so that it can move back.

The journal gets each path before the arm sets out, and where the arm stood free of everything: the
way back is known even to a later run.
"""

from collections.abc import Callable, Iterable

import numpy as np

from controller.arrays import FloatArray
from controller.cell.devices.interlocks import check_interlocks
from controller.cell.journal import Body
from controller.cell.journal.rows import EffectClass, Joints, PathBegun, StoodFree, TouchedDown
from controller.planning import JointPath
from controller.planning.model import CellLayout
from controller.planning.motion import tcp_pose
from drivers.clock import CellClock
from drivers.errors import ArmStalledError
from drivers.kinds import Arm, IoBlock

# How long the arm vibrates after it stops.
RINGING_S = 0.3
# A part that met the tray so far above its place has slipped in the jaws; one that met something
# higher up may stand on anything. To let it fall so far harms nothing.
TOUCH_MM = 10.0
# of joints in the journal: 1e-6 rad, 1e-6 mm
DECIMALS = 6


def rounded(path: Iterable[FloatArray]) -> tuple[Joints, ...]:
    """Return a joint path as the journal has it."""
    return tuple(tuple(round(float(x), DECIMALS) for x in q) for q in path)


class Motion:
    """The arm, as the actions move it.

    Parameters
    ----------
    arm : the device
    io : where the interlocks are read, before each path
    clock : of the cell
    note : takes the rows of the journal
    """

    def __init__(
        self,
        arm: Arm,
        io: IoBlock,
        clock: CellClock,
        note: Callable[[Body], object] = lambda row: None,
    ) -> None:
        self._arm = arm
        self._io = io
        self._clock = clock
        self._note = note
        # waypoints since the arm last stood free of everything: moving back along them is free too
        self._trail: list[FloatArray] = []

    async def start_from(self, q: FloatArray) -> None:
        """Move to a configuration (6,) that is free of everything; moving back ends there."""
        await self._arm.move_joints(q)
        self._trail = [q]
        self._note_free()

    async def follow(self, path: JointPath) -> None:
        """Move along a joint path, each waypoint (6,).

        Raises
        ------
        InterlockError : a safety copy is not healthy
        DeviceError : the arm does not get there
        """
        check_interlocks(self._io)
        self._note(PathBegun(effect_class=EffectClass.ABSOLUTE, waypoints=rounded(path)))
        for q in path:
            self._trail.append(q)
            await self._arm.move_joints(q)

    async def lower(self, path: JointPath, layout: CellLayout) -> None:
        """Lower the part along a joint path, each waypoint (6,); end early where it touches down.

        A part that has slipped in the jaws hangs lower than planned and meets tray or table first.

        Parameters
        ----------
        path : to where the part is to be let go
        layout : gives the height that is left

        Raises
        ------
        InterlockError : a safety copy is not healthy
        ArmStalledError : it met something further above than a part slips
        DeviceError : the arm does not get there
        """
        try:
            await self.follow(path)
        except ArmStalledError as error:
            q = await self._arm.read_q()
            left = tcp_pose(layout, path[-1])[:3, 3] - tcp_pose(layout, q)[:3, 3]
            if np.linalg.norm(left) > TOUCH_MM:
                raise
            self._trail[-1] = q
            left_mm = round(float(np.linalg.norm(left)), 1)
            self._note(TouchedDown(left_mm=left_mm, error=str(error)))

    def mark_free(self) -> None:
        """Mark that the arm stands free of everything: moving back ends here from now on."""
        del self._trail[:-1]
        self._note_free()

    def _note_free(self) -> None:
        if self._trail:
            (q,) = rounded(self._trail[-1:])
            self._note(StoodFree(q=q))

    @property
    def can_go_back(self) -> bool:
        """Whether the arm can be moved back by a waypoint."""
        return len(self._trail) > 1

    async def go_back(self, count: int) -> None:
        """Move back along the last ``count`` waypoints, to where the arm stood before them.

        Raises
        ------
        InterlockError : a safety copy is not healthy
        DeviceError : the arm does not get there
        """
        path = [self._trail[-2 - i] for i in range(count)]
        del self._trail[-count:]
        check_interlocks(self._io)
        self._note(
            PathBegun(effect_class=EffectClass.ABSOLUTE, waypoints=rounded(path), is_back=True)
        )
        for q in path:
            await self._arm.move_joints(q)

    async def ring_down(self) -> None:
        """Wait until the stopped arm stands still enough for a picture."""
        await self._clock.sleep(RINGING_S)

    async def read_q(self) -> FloatArray:
        """Return where the arm stands: its joints (6,)."""
        return await self._arm.read_q()
