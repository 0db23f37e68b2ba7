"""How the part truly sits in the arm gripper, as the inspection camera sees it."""

from dataclasses import dataclass

import numpy as np

from controller import inspection as inspecting
from controller.arrays import FloatArray
from controller.cell.batch.records import BatchRecord, Hold, Shown
from controller.cell.compute import Compute
from controller.cell.errors import PartFaultError
from controller.cell.machine import PartFault, is_held_otherwise
from controller.imaging import inverse_pose, rotation_angle
from controller.planning import shown_pose
from controller.planning.model import CellLayout
from controller.planning.motion import tcp_pose

from ..imaging import Imaging
from ..motion import Motion
from ..recoveries import Recoveries
from .holder import holder_boxes
from .views import Views

BAD_VIEW_COUNT = 2  # in a row, after which a hold that was seen is no longer trusted
SAME_CONFIGURATION = np.array([0.01, 0.01, 0.01, 0.5, 0.01, 0.01])  # [rad, mm] servo and counts


@dataclass(frozen=True, slots=True, eq=False)
class HeldPose:
    """Confirms by sight how the part is held, and measures it.

    Attributes
    ----------
    record : has the hold
    views : which view was shown last
    motion : where the arm stands
    imaging : takes one more picture
    compute : looks for the part in it
    recoveries : whether a hold that differs from the planned one would be planned anew
    layout : where camera, arm and fixed gripper stand
    """

    record: BatchRecord
    views: Views
    motion: Motion
    imaging: Imaging
    compute: Compute
    recoveries: Recoveries
    layout: CellLayout

    async def measure_again(self) -> None:
        """Look how the part is held, if the arm still stands before the camera.

        Raises
        ------
        PartFaultError : it is not seen in the arm gripper
        """
        hold, shown = self.record.part.hold, self.views.last_held
        if hold is None or hold.is_seen or shown is None:
            return
        q = await self.motion.read_q()
        if (np.abs(q - shown.q) > SAME_CONFIGURATION).any():
            return
        await self.motion.ring_down()
        backlit = await self.imaging.shoot("inspection", {"station_backlight": 1.0})
        expected = shown_pose(self.layout, q, hold.T_part_tcp)
        holder = holder_boxes(self.layout, q, hold.width_mm)
        found = await self.compute.find_hold(expected, hold.T_part_tcp, holder, backlit)
        if found is None:
            raise PartFaultError(
                PartFault.HOLD_NOT_SEEN, "the camera does not see the part in the arm gripper"
            )
        hold.T_part_tcp = inverse_pose(found) @ tcp_pose(self.layout, q)
        hold.is_seen = True

    async def learn(self, shown: Shown, hold: Hold, result: inspecting.ViewResult) -> None:
        """Take a view as proof of the hold, and its pose as the true one.

        Parameters
        ----------
        shown : the view
        hold : under which it was taken
        result : what inspection made of it

        Raises
        ------
        PartFaultError : the part is held otherwise than planned with, or not seen in the gripper
        """
        T_world_part, was_seen = result.T_world_part, hold.is_seen
        if not result.evaluated:
            found = await self._search(shown, hold, result.reason)
            if found is None:
                return
            T_world_part = found
        hold.unconfirmed_count = 0
        measured = inverse_pose(T_world_part) @ tcp_pose(self.layout, shown.q)
        shift_mm, turn_rad = _difference(measured, hold.T_part_tcp)
        if was_seen and not is_held_otherwise(shift_mm, turn_rad):
            return
        hold.T_part_tcp, hold.is_seen = measured, True
        # what inspection still takes for the planned grasp can be lived with
        is_bearable = result.evaluated and not self.recoveries.may_recover(PartFault.HELD_OTHERWISE)
        if is_held_otherwise(shift_mm, turn_rad) and not is_bearable:
            raise PartFaultError(
                PartFault.HELD_OTHERWISE,
                f"the part sits {shift_mm:.1f} mm and {np.degrees(turn_rad):.1f} degrees from "
                + ("where it was in the gripper" if was_seen else "where the grasp was planned"),
            )

    async def _search(self, shown: Shown, hold: Hold, reason: str) -> FloatArray | None:
        """Return T_world_part of a part that a view missed; None where one bad view is excused."""
        found = await self.compute.find_hold(
            shown.expected, hold.T_part_tcp, shown.holder, shown.backlit
        )
        hold.unconfirmed_count += 1
        # one bad view is a view less where others have confirmed the hold
        if found is None and not (hold.is_seen and hold.unconfirmed_count < BAD_VIEW_COUNT):
            raise PartFaultError(
                PartFault.HOLD_NOT_SEEN,
                f"the camera does not confirm how the part is held: {reason}",
            )
        return found


def _difference(T_part_tcp: FloatArray, T_other: FloatArray) -> tuple[float, float]:
    """Return how two holds differ: where the gripper is on the part [mm], and its turn [rad]."""
    shift_mm = float(np.linalg.norm(T_part_tcp[:3, 3] - T_other[:3, 3]))
    return shift_mm, rotation_angle(T_part_tcp[:3, :3].T @ T_other[:3, :3])
