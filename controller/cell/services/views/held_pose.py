"""Measures the part's pose in the arm gripper, by the inspection camera."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.cell.compute import Compute, Located
from controller.cell.devices.lamps import STATION_PANEL
from controller.cell.errors import PartFaultError
from controller.cell.machine import GRASP, PartFault, is_held_otherwise
from controller.cell.services.records import BatchRecord, PartInGripper, Shown
from controller.imaging import inverse_pose, rotation_angle
from controller.planning import shown_pose
from controller.planning.model import CellLayout
from controller.planning.motion import tcp_pose
from controller.setup.holder import holder_boxes
from messages import key, say

from ..faults import Recoveries
from ..imaging import Imaging
from ..motion import Motion
from .views import Views

# After this many views in a row without confirmation, a hold is no longer trusted.
BAD_VIEW_COUNT = 2
HAS_SLIPPED: Final = key(
    "the part sits {shift_mm:.1f} mm and {turn_deg:.1f} degrees from where it was in the gripper"
)
IS_TURNED: Final = key(
    "the view shows the turn of the part about its axis: {turn_deg:.0f} degrees from the guess"
)
IS_NOT_AS_PLANNED: Final = key(
    "the part sits {shift_mm:.1f} mm and {turn_deg:.1f} degrees from where the grasp was planned"
)
# Tolerance of joints on a configuration: servo error and counts [rad, mm].
SAME_CONFIGURATION = np.array([0.01, 0.01, 0.01, 0.5, 0.01, 0.01])


@dataclass(frozen=True, slots=True, eq=False)
class HeldPose:
    """Confirms the hold of the part, and measures it.

    Attributes
    ----------
    record : has the hold
    views : views with the one shown last
    motion : present joints of the arm
    imaging : service that takes one more picture
    compute : service that finds the part in it
    recoveries : whether the cell would still make a new plan for another hold
    layout : layout with camera, arm and fixed gripper
    """

    record: BatchRecord
    views: Views
    motion: Motion
    imaging: Imaging
    compute: Compute
    recoveries: Recoveries
    layout: CellLayout

    async def measure_again(self) -> None:
        """Measure the hold of the part, if the arm still stands before the camera.

        Raises
        ------
        PartFaultError : it is not seen in the arm gripper
        """
        hold, shown = self.record.part.hold, self.views.last_held
        if hold is None or hold.is_measured or shown is None:
            return
        q = await self.motion.read_q()
        if (np.abs(q - shown.q) > SAME_CONFIGURATION).any():
            return
        await self.motion.ring_down()
        backlit = await self.imaging.shoot("inspection", {STATION_PANEL: 1.0})
        expected = shown_pose(self.layout, q, hold.T_part_tcp)
        holder = holder_boxes(self.layout, q, hold.opening_mm)
        found = await self.compute.find_hold(expected, hold.T_part_tcp, holder, backlit)
        if found is None:
            raise PartFaultError(
                PartFault.HOLD_NOT_SEEN, key("the camera does not see the part in the arm gripper")
            )
        hold.T_part_tcp = inverse_pose(found) @ tcp_pose(self.layout, q)
        hold.is_measured = True
        self.record.note_hold()

    async def learn(self, shown: Shown, hold: PartInGripper, found: Located) -> None:
        """Take a view as proof of the hold, and its pose as the measured one.

        Parameters
        ----------
        shown : the view
        hold : grasp in which it was taken
        found : pose of the part in it

        Raises
        ------
        PartFaultError : the part is held otherwise than planned, or not seen in the gripper
        """
        part = self.record.part
        free = part.free_turn if found.evaluated and found.is_turn_known else None
        is_turn_new = free is not None and not free.is_shown
        T_world_part, was_known = found.T_world_part, hold.is_measured and not is_turn_new
        if not found.evaluated:
            T_searched = await self._search(shown, hold, found.reason)
            if T_searched is None:
                return
            T_world_part = T_searched
        hold.unconfirmed_count = 0
        measured = inverse_pose(T_world_part) @ tcp_pose(self.layout, shown.q)
        shift_mm, turn_rad = _difference(measured, hold.T_part_tcp)
        if free is not None:
            part.free_turn = free.shown(turn_rad)
        if was_known and not is_held_otherwise(shift_mm, turn_rad):
            return
        hold.T_part_tcp, hold.is_measured = measured, True
        self.record.note_hold()
        # inspection accepted the view, and no further plan is allowed: go on as it is
        is_bearable = found.evaluated and not self.recoveries.may_recover(PartFault.HELD_OTHERWISE)
        if is_held_otherwise(shift_mm, turn_rad) and not is_bearable:
            raise PartFaultError(
                PartFault.HELD_OTHERWISE,
                say(
                    HAS_SLIPPED if was_known else IS_TURNED if is_turn_new else IS_NOT_AS_PLANNED,
                    shift_mm=shift_mm,
                    turn_deg=np.degrees(turn_rad),
                ),
                # at first it is where the table's picture was wrong; later on it has slipped
                source=GRASP + hold.grasp.id if was_known else "",
            )

    async def _search(self, shown: Shown, hold: PartInGripper, reason: str) -> FloatArray | None:
        """Search for the part that a view missed; return T_world_part, or None for one bad view."""
        found = await self.compute.find_hold(
            shown.expected, hold.T_part_tcp, shown.holder, shown.backlit
        )
        hold.unconfirmed_count += 1
        # where other views have confirmed the hold, a single bad one is only left out
        if found is None and not (hold.is_measured and hold.unconfirmed_count < BAD_VIEW_COUNT):
            raise PartFaultError(
                PartFault.HOLD_NOT_SEEN,
                say("the camera does not confirm how the part is held: {reason}", reason=reason),
            )
        return found


def _difference(T_part_tcp: FloatArray, T_other: FloatArray) -> tuple[float, float]:
    """Return the distance of two T_part_tcp [mm, rad]."""
    shift_mm = float(np.linalg.norm(T_part_tcp[:3, 3] - T_other[:3, 3]))
    return shift_mm, rotation_angle(T_part_tcp[:3, :3].T @ T_other[:3, :3])
