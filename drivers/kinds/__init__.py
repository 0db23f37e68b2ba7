"""The cell's requirements on each kind of device, and the offer of a driver.

A driver of the group ``cellctl.drivers`` (docs/drivers.md) returns an object that has one of these
protocols. They name what the cell calls and no more; a driver may do more. The errors it raises are
those of `drivers.errors`, its instants and durations are seconds of `drivers.clock.CellClock`.
"""

from .arm import Arm, ArmIdentity, JawReading, Stop
from .camera import Camera, Capture, Frame, TimedFrame
from .driver import GROUP, ArmDescription, ArmDriver, Driver, NoSettings, Site
from .first_contact import Confirm, Encoders, FirstContact, MotorTry
from .gripper import FixedGripper, GraspReading, GripperReading, Hold
from .io_block import Change, Changes, IoBlock, Polling, Signal
from .lights import Lamp, LampUnit
from .motor_watchdog import MotorWatchdog, SupplySense
from .signal_outputs import SignalOutputs

__all__ = [
    "GROUP",
    "Arm",
    "ArmDescription",
    "ArmDriver",
    "ArmIdentity",
    "Camera",
    "Capture",
    "Change",
    "Changes",
    "Confirm",
    "Driver",
    "Encoders",
    "FirstContact",
    "FixedGripper",
    "Frame",
    "GraspReading",
    "GripperReading",
    "Hold",
    "IoBlock",
    "JawReading",
    "Lamp",
    "LampUnit",
    "MotorTry",
    "MotorWatchdog",
    "NoSettings",
    "Polling",
    "Signal",
    "SignalOutputs",
    "Site",
    "Stop",
    "SupplySense",
    "TimedFrame",
]
