"""The devices' state, read without moving anything: openings, light barrier, arm counters."""

from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from controller.arrays import FloatArray
from drivers.errors import PositionLostError
from drivers.kinds import Signal
from messages import key

from ..custody.release_guard import LOST_MM, NOTHING_MM, least_held_mm
from ..devices import Devices
from .interrupted import Interrupted

# Jaws wider than on the part by this much have let go of it.
LET_GO_MM: Final = 2.5


class Jaws(StrEnum):
    """The state of a gripper's jaws, against the opening at which they hold the part."""

    ON_PART = key("stand where they hold the part")
    WIDER = key("stand wider than the part")
    CLOSED = key("have closed further than the part allows")
    BETWEEN = key("stand a little wider than the part")
    UNKNOWN = key("cannot be read")


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """The devices' state at a start.

    Attributes
    ----------
    q : (6,) joints of the arm, None if its positions are unknown
    positions : reason why they are known, or unknown; an error of the arm names it
    arm_mm : opening of the arm gripper, None if unknown
    is_arm_pressing : its jaws have stalled and press
    fixed_mm : opening of the fixed gripper
    does_fixed_touch : something stopped its jaws
    is_fixed_ready : True if it is active and has no fault
    barrier : the light barrier between its jaws
    q_kept : (6,) if `q` is None, the joints that counters still prove, the others NaN
    is_fixed_active : True if it was activated, and has had power since
    """

    q: FloatArray | None
    positions: str
    arm_mm: float | None
    is_arm_pressing: bool
    fixed_mm: float
    does_fixed_touch: bool
    is_fixed_ready: bool
    barrier: Signal
    q_kept: FloatArray | None = None
    is_fixed_active: bool = True

    def arm_jaws(self, on_part_mm: float | None) -> Jaws:
        """Return the state of the arm gripper's jaws, which stand at that opening on the part."""
        return judge_jaws(self.arm_mm, on_part_mm)

    @property
    def does_fixed_hold(self) -> bool:
        """Whether the fixed gripper itself reports that it holds something."""
        is_between = self.fixed_mm >= NOTHING_MM or self.barrier is Signal.OK
        return self.is_fixed_ready and self.does_fixed_touch and is_between

    def may_fixed_hold(self, on_part_mm: float | None) -> bool:
        """Return whether opening and barrier fit a part in the fixed gripper, unreported by it.

        This is the state after a stop, which ends the order behind its report of contact
        (modbus_devices.md 2.3). Only a press shows whether it still holds the part.

        Parameters
        ----------
        on_part_mm : opening on the part, None if unknown
        """
        stands = judge_jaws(self.fixed_mm, on_part_mm) is Jaws.ON_PART
        sees = self.barrier is Signal.OK
        return self.is_fixed_ready and not self.does_fixed_touch and stands and sees

    @property
    def is_fixed_clear(self) -> bool:
        """Whether nothing is between the jaws of the fixed gripper."""
        can_tell = self.is_fixed_ready or not self.is_fixed_active
        return can_tell and not self.does_fixed_touch and self.barrier is Signal.NOT_OK

    @property
    def is_fixed_asleep(self) -> bool:
        """Whether the fixed gripper lost its power with nothing between its jaws.

        To activate it moves them: they close, and open (modbus_devices.md 2.2).
        """
        return not self.is_fixed_active and self.is_fixed_clear


def judge_jaws(opening_mm: float | None, on_part_mm: float | None) -> Jaws:
    """Return the state of the jaws.

    Parameters
    ----------
    opening_mm : opening as read, None if it is invalid
    on_part_mm : opening on the part, None if unknown
    """
    if opening_mm is None or on_part_mm is None:
        return Jaws.UNKNOWN
    if opening_mm < least_held_mm(on_part_mm):
        return Jaws.CLOSED
    if opening_mm <= on_part_mm + LOST_MM:
        return Jaws.ON_PART
    return Jaws.WIDER if opening_mm >= on_part_mm + LET_GO_MM else Jaws.BETWEEN


async def read_world(devices: Devices, left: Interrupted) -> World:
    """Return the devices' state; takes the arm's positions over if those can be proven.

    Nothing moves.

    Raises
    ------
    DeviceError : a device does not answer
    """
    q, positions = None, key("the interrupted run has not homed the arm")
    q_kept = None
    between = left.trail.between
    if left.is_homed and len(between):
        try:
            await devices.arm.take_over_positions(between)
        except PositionLostError as error:
            positions = str(error)
            with suppress(PositionLostError):
                q_kept = await devices.arm.read_kept_q(between)
        else:
            q = await devices.arm.read_q()
            positions = key("its counters read what it was last sent to, and it has not restarted")
    elif left.is_homed:
        positions = key("the journal does not record where the arm was sent")
    jaws = devices.jaws_found
    assert jaws is not None, "connect first"
    status = await devices.gripper.status()
    return World(
        q=q,
        positions=positions,
        arm_mm=None if q is None else await devices.arm.read_opening_mm(),
        is_arm_pressing=jaws.is_pressing,
        fixed_mm=status.opening_mm,
        does_fixed_touch=status.has_contact,
        is_fixed_ready=status.is_activated and not status.has_fault,
        barrier=devices.io.signal("part_in_gripper"),
        q_kept=q_kept,
        is_fixed_active=status.is_activated,
    )
