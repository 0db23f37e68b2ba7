"""The paused cell's position, and the proof that it is unchanged once a door was open.

While the door is open a person may push the arm, spread a jaw or move the part. Before the cell
continues, the counters of the arm and both openings must be unchanged; the cell looks again for a
part that no gripper has.
"""

import numpy as np

from controller.arrays import FloatArray
from controller.cell.custody import Custody
from controller.cell.custody.release_guard import LOST_MM
from controller.cell.errors import NotProvenError
from controller.cell.journal.rows import FirstMotion, StoodStill
from controller.cell.machine import is_held_otherwise
from controller.imaging import rotation_angle
from controller.planning.model import CellLayout
from controller.planning.motion import tcp_pose
from drivers.errors import PositionLostError
from messages import joined, key, say

from ..gate import Gate
from ..grippers import Grippers
from ..motion import Motion, rounded
from ..records import BatchRecord

_LOOK = FirstMotion(
    words=key(
        "the arm goes back along its own path and parks, unless it is parked already; then the "
        "cell takes pictures"
    )
)


class Standstill:
    """Remembers the cell's position in a pause, and proves that it is unchanged.

    Parameters
    ----------
    gate : gate with the first motion
    motion, grippers : are read
    record : record for the readings, with the custody of the part
    layout : layout with the arm's kinematics
    """

    def __init__(
        self,
        gate: Gate,
        motion: Motion,
        grippers: Grippers,
        record: BatchRecord,
        layout: CellLayout,
    ) -> None:
        self._gate = gate
        self._motion = motion
        self._grippers = grippers
        self._record = record
        self._layout = layout
        self._left: tuple[FloatArray, tuple[float, float]] | None = None
        self._was_open = self._has_looked = False

    def note_open(self, *, has_looked: bool) -> None:
        """Note that a door is open: from now on the cell may be changed by hand.

        Parameters
        ----------
        has_looked : pictures of the table were taken, or are being taken
        """
        self._was_open = True
        self._has_looked = self._has_looked or has_looked

    def forget(self) -> None:
        """Forget the cell's position, since it moves on."""
        self._left, self._was_open, self._has_looked = None, False, False

    async def note(self) -> None:
        """Note the cell's position, now that nothing moves; nothing before the arm is homed.

        Raises
        ------
        DeviceError : arm or fixed gripper cannot be read
        """
        try:
            q = await self._motion.read_q()
            openings_mm = await self._grippers.openings_mm()
        except PositionLostError:
            self._left = None
            return
        self._left = (q, openings_mm)
        (joints,) = rounded([q])
        arm_mm, fixed_mm = (round(one, 3) for one in openings_mm)
        self._record.note(StoodStill(q=joints, arm_mm=arm_mm, fixed_mm=fixed_mm))

    @property
    def looks_again(self) -> bool:
        """Whether the part is looked for again: the door was open, and no gripper has it."""
        is_free = self._record.part.custody in (Custody.NONE, Custody.ON_TABLE, Custody.LOST)
        return self._has_looked and is_free and not self._record.is_once_open

    async def next_motion(self) -> FirstMotion | None:
        """Return the first motion after the pause; None while it is still being computed."""
        return _LOOK if self.looks_again else await self._gate.next_motion()

    async def prove(self) -> None:
        """Prove that the cell still stands as it was left; skipped if no door was open.

        Raises
        ------
        NotProvenError : arm or jaws stand elsewhere
        DeviceError : arm or fixed gripper cannot be read
        """
        if not self._was_open or self._left is None:
            return
        q, openings_mm = self._left
        now_q, now_mm = await self._motion.read_q(), await self._grippers.openings_mm()
        T_left, T_now = tcp_pose(self._layout, q), tcp_pose(self._layout, now_q)
        shift_mm = float(np.linalg.norm(T_now[:3, 3] - T_left[:3, 3]))
        turn_rad = rotation_angle(T_left[:3, :3].T @ T_now[:3, :3])
        found = []
        if is_held_otherwise(shift_mm, turn_rad):
            found.append(
                say(
                    "the arm stands {shift_mm:.1f} mm and {degrees:.1f} degrees from "
                    "where it was left",
                    shift_mm=shift_mm,
                    degrees=np.degrees(turn_rad),
                )
            )
        for name, was_mm, is_mm in zip(("arm", "fixed"), openings_mm, now_mm, strict=True):
            if abs(is_mm - was_mm) > LOST_MM:
                found.append(
                    say(
                        "the jaws of the {name} gripper stand at {is_mm:.1f} mm, "
                        "{was_mm:.1f} mm as they were left",
                        name=name,
                        is_mm=is_mm,
                        was_mm=was_mm,
                    )
                )
        if found:
            raise NotProvenError(
                say(
                    "{found}; put that back and resume, or stop the run and start again",
                    found=joined(" and ", found),
                )
            )
