"""Alarms 200 to 399: of interlocks and devices. Data only."""

from typing import Final

from .alarm import Alarm, Severity

_ABORT, _HOLD = Severity.ABORT, Severity.HOLD
_WARNING, _REFUSED = Severity.WARNING, Severity.REFUSED
_IO, _ARM, _FIXED = "I/O block", "arm", "fixed gripper"
_WHERE_ARM_IS = "where the arm is until it answers; it may finish the motion it was sent"

DEVICES: Final = (
    Alarm(
        201, "estop", _ABORT, _IO,
        "the emergency stop is pressed, or its chain is open",
        "where the arm is: it is homed again",
        "make the cell safe, release, reset, start again",
    ),
    Alarm(
        202, "guard_closed", _HOLD, _IO,
        "the door is open",
        "whether somebody has moved the part: the cell looks",
        "close it, look at the cell, acknowledge, resume",
    ),
    Alarm(
        203, "supply", _ABORT, _IO,
        "the 24 V supply is missing",
        "where the arm is, and whether the fixed gripper still holds",
        "check the fuse, start again",
    ),
    Alarm(
        204, "interlock", _ABORT, _IO,
        "an interlock is not healthy, or its reading is too old",
        "whether the interlock named is healthy",
        "do what the message names; check cable and power of the I/O block",
    ),
    Alarm(
        206, "not_proven", _HOLD, "cell",
        "after an open door the arm or a jaw stands elsewhere",
        "whether somebody has moved the part",
        "put it back and resume, or stop and start again",
    ),
    Alarm(
        205, "hand_off_blocked", _ABORT, _FIXED,
        "the arm was to come near the fixed gripper, which holds something that is not the part",
        "what the fixed gripper holds",
        "look what it holds; take it out with `cellctl recover --open fixed`",
    ),
    Alarm(
        207, "motor_watchdog", _ABORT, _IO,
        "the I/O block heard nothing for too long; its watchdog took the motors' supply away",
        "where the arm is: it is homed again",
        "see what kept the computer, start again; a part in a gripper is reported first",
    ),
    Alarm(
        208, "watchdog_off", _REFUSED, _IO,
        "the watchdog that is to take the motors' supply away did not trip",
        "nothing",
        "set it in the block's web console (commissioning.md, the watchdog)",
    ),
    Alarm(
        209, "inputs_stale", _ABORT, _IO,
        "the I/O block was not read in time; nobody needs to have pressed anything",
        "emergency stop, door and supply, until it answers; where the arm is: it is homed again",
        "check cable and power of the I/O block and its gateway, start again",
    ),
    Alarm(
        210, "release_refused", _ABORT, "both grippers",
        "a gripper was to open that alone is known to hold the part",
        "whether the other gripper has the part",
        "look at both grippers; take the part out with `cellctl recover`; report it as a bug",
    ),
    Alarm(
        300, "device", _ABORT, "device",
        "a device failed as no other alarm describes",
        "what the device did last",
        "read the message; run `cellctl doctor`",
    ),
    Alarm(
        301, "link", _ABORT, "device",
        "no connection to the device",
        "whether the last command was done",
        "check its cable and power; run `cellctl doctor`",
    ),
    Alarm(
        302, "unplugged", _ABORT, "device",
        "the device left while it was open: its node or connection is gone",
        "whether the last command was done",
        "plug it in, check its power; run `cellctl doctor`",
    ),
    Alarm(
        303, "silent_line", _ABORT, _ARM,
        "no byte comes back from the arm's line; a stop was sent all the same",
        _WHERE_ARM_IS,
        "press the emergency stop if anything moves; check cable, power, boards",
    ),
    Alarm(
        304, "reply_timeout", _ABORT, "device",
        "the device took too long to answer",
        "whether the last command was done",
        "check its cable and power; if it happens again, look for a second master on its line",
    ),
    Alarm(
        305, "bad_reply", _ABORT, "device",
        "the device sent bytes that its manual forbids",
        "whether the last command was done",
        "check cable, earth and termination; send the wire trace with your report",
    ),
    Alarm(
        306, "wrong_device", _REFUSED, "device",
        "another device answers at this address",
        "where the device is that belongs there",
        "check address and unit id in the cell file",
    ),
    Alarm(
        307, "refused", _ABORT, "device",
        "the device understood and answered no",
        "nothing: the command was not done",
        "read the device's own code in the message",
    ),
    Alarm(
        308, "fault", _ABORT, "device",
        "the device reports a fault of its own",
        "whether it still holds what it had",
        "read the device's own code in the message; mend it, start again",
    ),
    Alarm(
        309, "position_lost", _ABORT, "device",
        "the device restarted: every position it had is void",
        "where its axes or jaws are, and what they hold",
        "`cellctl recover` shows whether the arm can home with what it holds, and what to look at; "
        "else take that out. With empty grippers the next start references it again",
    ),
    Alarm(
        310, "stalled", _ABORT, "device",
        "a motion ended against something that should not have been there",
        "what it met",
        "look at the jaws, or the axis, before you start again",
    ),
    Alarm(
        311, "stop_not_confirmed", _ABORT, "device",
        "a device did not confirm its stop in time",
        "whether it still moves",
        "press the emergency stop if anything moves; check its cable and power",
    ),
    Alarm(
        320, "stall", _ABORT, _ARM,
        "an axis ended elsewhere than it was sent to: it may have met something",
        "what it met, and whether the part is still held as it was",
        "find what it touched before you start again",
    ),
    Alarm(
        321, "out_of_range", _ABORT, _ARM,
        "a motion beyond the limits of an axis was refused",
        "nothing: nothing was sent",
        "check the cell file's `arm`; report it, plans keep to the limits",
    ),
    Alarm(
        322, "power_off", _ABORT, _ARM,
        "a motion was to begin while motor power is off",
        "nothing: nothing was sent",
        "switch the power on, start again",
    ),
    Alarm(
        323, "motion_stopped", _ABORT, _ARM,
        "a stop ended the motion",
        "nothing: positions were read back",
        "find in the journal who stopped it, start again",
    ),
    Alarm(
        324, "homing", _ABORT, _ARM,
        "an axis did not find its end stop",
        "where the axes are",
        "look for what blocks the axis named, start again",
    ),
    Alarm(
        325, "line_uncertain", _ABORT, _ARM,
        "a byte on the arm's line was corrupted; both boards were stopped",
        "where the arm is, if the message has it that positions are no longer known",
        "start again; if it happens again, check cable and earth",
    ),
    Alarm(
        330, "stopped", _ABORT, _FIXED,
        "a stop ended the motion of the jaws",
        "whether the jaws hold something",
        "find in the journal who stopped it, start again",
    ),
    Alarm(
        340, "device_retried", _WARNING, "device",
        "a picture, a lamp or a reading did not come and was tried again",
        "nothing once it came",
        "if it happens often, check cable and power of the device named",
    ),
    Alarm(
        341, "demoted", _WARNING, "planner",
        "a grasp or a view has failed so often that this batch avoids it",
        "nothing",
        "check pads, force and part; for a view, lamps and camera of the station",
    ),
)  # fmt: skip
