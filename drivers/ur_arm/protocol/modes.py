"""Modes of the robot, of its safety system and of a program, and the way out of each.

Sections (§) are those of ur.md.
"""

from enum import IntEnum
from typing import Final

from messages import key, say


class RobotMode(IntEnum):
    """Mode of the robot (§5.1)."""

    NO_CONTROLLER = -1
    DISCONNECTED = 0
    CONFIRM_SAFETY = 1
    BOOTING = 2
    POWER_OFF = 3
    POWER_ON = 4
    IDLE = 5
    BACKDRIVE = 6
    RUNNING = 7
    UPDATING_FIRMWARE = 8


class SafetyMode(IntEnum):
    """Mode of the safety system (§5.2)."""

    NORMAL = 1
    REDUCED = 2
    PROTECTIVE_STOP = 3
    RECOVERY = 4
    SAFEGUARD_STOP = 5
    SYSTEM_EMERGENCY_STOP = 6
    ROBOT_EMERGENCY_STOP = 7
    VIOLATION = 8
    FAULT = 9
    VALIDATE_JOINT_ID = 10
    UNDEFINED = 11
    AUTOMATIC_SAFEGUARD_STOP = 12
    THREE_POSITION_STOP = 13


PLAYING: Final = 2  # runtime_state (§5.3)
PAUSED: Final = frozenset({3, 4, 5})  # pausing, paused, resuming
OPERATES: Final = frozenset({SafetyMode.NORMAL, SafetyMode.REDUCED})
# a motion waits in these, and goes on by itself once a door is shut or a switch is held
PAUSES: Final = frozenset(
    {
        SafetyMode.SAFEGUARD_STOP,
        SafetyMode.AUTOMATIC_SAFEGUARD_STOP,
        SafetyMode.THREE_POSITION_STOP,
    }
)
AT_ONCE: Final = frozenset(SafetyMode) - OPERATES - PAUSES  # a person has to come

_WORDS: Final = {
    SafetyMode.PROTECTIVE_STOP: key("protective stop"),
    SafetyMode.RECOVERY: key("recovery mode: a joint is outside its safety limits"),
    SafetyMode.SAFEGUARD_STOP: key("safeguard stop"),
    SafetyMode.SYSTEM_EMERGENCY_STOP: key("emergency stop of the system"),
    SafetyMode.ROBOT_EMERGENCY_STOP: key("emergency stop of the robot"),
    SafetyMode.VIOLATION: key("violation of the safety configuration"),
    SafetyMode.FAULT: key("fault of the safety system"),
    SafetyMode.VALIDATE_JOINT_ID: key("a joint was exchanged"),
    SafetyMode.UNDEFINED: key("safety mode undefined"),
    SafetyMode.AUTOMATIC_SAFEGUARD_STOP: key("safeguard stop of the automatic mode"),
    SafetyMode.THREE_POSITION_STOP: key("the enabling switch is not held"),
}
_ADVICE: Final = {
    SafetyMode.PROTECTIVE_STOP: (
        key(
            "see what it met or how it is loaded, clear it, then press `Enable Robot` on the "
            "pendant"
        )
    ),
    SafetyMode.RECOVERY: key("move it back within its safety limits by hand, at the pendant"),
    SafetyMode.SAFEGUARD_STOP: key("close its safeguard, and reset it if it has a reset button"),
    SafetyMode.SYSTEM_EMERGENCY_STOP: key(
        "release the emergency stop, then enable it on the pendant"
    ),
    SafetyMode.ROBOT_EMERGENCY_STOP: key(
        "release the emergency stop, then enable it on the pendant"
    ),
    SafetyMode.VIOLATION: key(
        "read the log on the pendant, clear the cause, restart the safety system"
    ),
    SafetyMode.FAULT: key("read the log on the pendant; restart the controller"),
    SafetyMode.VALIDATE_JOINT_ID: key("have the joints validated by service"),
    SafetyMode.UNDEFINED: key("read the log on the pendant"),
    SafetyMode.AUTOMATIC_SAFEGUARD_STOP: key(
        "close its safeguard, and reset it if it has a button"
    ),
    SafetyMode.THREE_POSITION_STOP: key("hold the enabling switch, or choose the automatic mode"),
}
_MODES: Final = {
    RobotMode.NO_CONTROLLER: key("its controller does not run"),
    RobotMode.DISCONNECTED: key("the arm is not connected to its controller"),
    RobotMode.CONFIRM_SAFETY: key("its safety configuration waits to be confirmed on the pendant"),
    RobotMode.BOOTING: key("it boots"),
    RobotMode.POWER_OFF: key("its power is off"),
    RobotMode.POWER_ON: key("its joints start"),
    RobotMode.IDLE: key("its brakes are on"),
    RobotMode.BACKDRIVE: key("it is in backdrive"),
    RobotMode.RUNNING: key("it runs"),
    RobotMode.UPDATING_FIRMWARE: key("its firmware is being updated"),
}


def safety_words(mode: int) -> str:
    """Return a safety mode in words."""
    return (
        _WORDS.get(SafetyMode(mode), "normal")
        if _is_known(mode)
        else say("safety mode {mode}", mode=mode)
    )


def advice(mode: int) -> str:
    """Return the way out of a safety mode, for a person."""
    return (
        _ADVICE.get(SafetyMode(mode), "") if _is_known(mode) else key("read the log on the pendant")
    )


def mode_words(mode: int) -> str:
    """Return a mode of the robot in words."""
    known = mode in RobotMode.__members__.values()
    return _MODES[RobotMode(mode)] if known else say("robot mode {mode}", mode=mode)


def _is_known(mode: int) -> bool:
    return mode in SafetyMode.__members__.values()
