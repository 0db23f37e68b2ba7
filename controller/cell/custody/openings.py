"""Whether each gripper holds something, by its own readings, before anything moves.

The devices are read as they are, before activation and homing, since both of these move jaws.
`start_check` decides on the next step.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from drivers.kinds import ArmIdentity, GripperReading, JawReading, Signal
from messages import key, say

from ..devices import Devices
from ..devices.interlocks import check_interlocks
from .fold import GripperName
from .release_guard import LOST_MM, NOTHING_MM

# Jaws this close to their widest opening count as wide open.
SLACK_MM: Final = 2.0


class Occupancy(StrEnum):
    """Whether a gripper holds something, judged by its opening."""

    HOLDS = key("holds something")
    MAY_HOLD = key("may hold something")
    EMPTY = key("is empty")
    UNREADABLE = key("cannot be read")


@dataclass(frozen=True, slots=True)
class Opening:
    """Whether one gripper holds something, and the reading that shows it."""

    gripper: GripperName
    occupancy: Occupancy
    reason: str


async def read_openings(devices: Devices) -> tuple[Opening, Opening]:
    """Return the occupancy of the arm gripper and the fixed gripper by their first readings.

    Nothing moves.

    Raises
    ------
    DeviceError : one of them does not answer
    """
    jaws, identity = devices.jaws_found, devices.arm.identity
    assert jaws is not None, "connect first"
    assert identity is not None, "connect first"
    arm = judge_arm(jaws, identity, devices.arm.max_opening_mm)
    status = await devices.gripper.status()
    barrier = devices.io.signal("part_in_gripper")
    return arm, judge_fixed(status, barrier, devices.gripper.max_opening_mm)


async def presses_on_something(devices: Devices) -> bool:
    """Close the arm gripper a little further; return whether something stops it at once.

    Closing drops nothing. Call it only after the operator has stated that the jaws are empty.

    Raises
    ------
    InterlockError : a safety copy is not healthy
    DeviceError : the arm does not answer
    """
    check_interlocks(devices.io)
    await devices.arm.enable_power()
    return await devices.arm.drive_jaws(-NOTHING_MM) < LOST_MM


def judge_arm(jaws: JawReading, identity: ArmIdentity, open_mm: float) -> Opening:
    """Return the arm gripper's occupancy by its reading.

    Jaws that press on nothing prove nothing: a stop may have released the pressure on a part. Jaws
    that stalled on a part stay in place even after it was taken out (umi_rtx.md 7).

    Parameters
    ----------
    jaws : opening of the arm gripper, and whether it presses
    identity : whether the arm has lost its positions
    open_mm : its widest opening, where it stalls on its own end [mm]
    """

    def opening(occupancy: Occupancy, reason: str) -> Opening:
        return Opening(GripperName.ARM, occupancy, reason)

    if identity.was_restarted:
        return opening(Occupancy.UNREADABLE, key("the arm has lost its positions"))
    if not jaws.is_pressing:
        return opening(Occupancy.UNREADABLE, key("its jaws press on nothing"))
    if jaws.opening_mm < NOTHING_MM:
        return opening(Occupancy.EMPTY, key("its jaws press on each other"))
    if jaws.opening_mm > open_mm - SLACK_MM:
        return opening(
            Occupancy.EMPTY,
            say("its jaws stand at {opening_mm:.1f} mm", opening_mm=jaws.opening_mm),
        )
    return opening(
        Occupancy.MAY_HOLD,
        say("its jaws stalled at {opening_mm:.1f} mm", opening_mm=jaws.opening_mm),
    )


def judge_fixed(status: GripperReading, barrier: Signal, open_mm: float) -> Opening:
    """Return the fixed gripper's occupancy by its reading and light barrier.

    Parameters
    ----------
    status : reading of the fixed gripper
    barrier : the light barrier between its pads; OK means that it sees something
    open_mm : its widest opening [mm]
    """

    def opening(occupancy: Occupancy, reason: str) -> Opening:
        return Opening(GripperName.FIXED, occupancy, reason)

    opening_mm = status.opening_mm
    if barrier is Signal.OK:
        return opening(Occupancy.HOLDS, key("its light barrier sees something between the jaws"))
    if not status.is_activated:
        return opening(Occupancy.UNREADABLE, key("it was switched off or never activated"))
    if status.has_contact and opening_mm >= NOTHING_MM:
        return opening(
            Occupancy.HOLDS,
            say("its jaws met something at {opening_mm:.1f} mm", opening_mm=opening_mm),
        )
    if opening_mm < NOTHING_MM or opening_mm > open_mm - SLACK_MM:
        return opening(
            Occupancy.EMPTY, say("its jaws stand at {opening_mm:.1f} mm", opening_mm=opening_mm)
        )
    if status.has_arrived:
        return opening(
            Occupancy.EMPTY,
            say("its jaws went to {opening_mm:.1f} mm and met nothing", opening_mm=opening_mm),
        )
    return opening(
        Occupancy.MAY_HOLD,
        say("its jaws were stopped at {opening_mm:.1f} mm", opening_mm=opening_mm),
    )
