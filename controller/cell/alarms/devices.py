"""Alarms 200 to 399: of interlocks and devices. Data only."""

from typing import Final

from .alarm import Alarm, Severity

_ABORT, _HOLD = Severity.ABORT, Severity.HOLD
_WARNING, _REFUSED = Severity.WARNING, Severity.REFUSED
_IO, _ARM, _FIXED = "I/O block", "arm", "fixed gripper"
_WHERE_ARM_IS = "the position of the arm until it answers; it may finish the motion it was sent"

DEVICES: Final = (
    Alarm(
        201, "estop", _ABORT, _IO,
        "the emergency stop is pressed, or its chain is open",
        "the position of the arm: it is homed again",
        "make the cell safe, release the emergency stop, reset it, and start again",
    ),
    Alarm(
        202, "guard_closed", _HOLD, _IO,
        "the door is open",
        "whether anybody has moved the part: the cell looks for it",
        "close it, look at the cell, acknowledge, and resume",
    ),
    Alarm(
        203, "supply", _ABORT, _IO,
        "the 24 V supply is missing",
        "the position of the arm, and whether the fixed gripper still holds",
        "check the fuse and start again",
    ),
    Alarm(
        204, "interlock", _ABORT, _IO,
        "an interlock is not healthy, or its reading is too old",
        "the true state of the interlock named",
        "follow the message; check cable and power of the I/O block",
    ),
    Alarm(
        206, "not_proven", _HOLD, "cell",
        "the arm or a jaw moved while the door was open",
        "whether anybody has moved the part",
        "put it back and resume, or stop and start again",
    ),
    Alarm(
        205, "hand_off_blocked", _ABORT, _FIXED,
        "the arm was about to come near the fixed gripper, which holds something other "
        "than the part",
        "the contents of the fixed gripper",
        "look at the fixed gripper; take its contents out with `cellctl recover --open fixed`",
    ),
    Alarm(
        207, "motor_watchdog", _ABORT, _IO,
        "the I/O block received nothing for too long; its watchdog cut the motors' supply",
        "the position of the arm: it is homed again",
        "find out why the computer stalled and start again; a part in a gripper is reported first",
    ),
    Alarm(
        208, "watchdog_off", _REFUSED, _IO,
        "the watchdog that must open its outputs did not trip",
        "nothing",
        "set it in the block's web console (commissioning.md, the watchdog)",
    ),
    Alarm(
        209, "inputs_stale", _ABORT, _IO,
        "the I/O block was not read in time; the emergency stop need not have been pressed",
        "the state of emergency stop, door and supply until it answers, and the position "
        "of the arm: it is homed again",
        "check cable and power of the I/O block and its gateway, and start again",
    ),
    Alarm(
        210, "release_refused", _ABORT, "both grippers",
        "a gripper was about to open that alone is known to hold the part",
        "whether the other gripper has the part",
        "look at both grippers; take the part out with `cellctl recover`; report it as a bug",
    ),
    Alarm(
        300, "device", _ABORT, "device",
        "a device failed in a way that no other alarm covers",
        "the last action of the device",
        "read the message; run `cellctl doctor`",
    ),
    Alarm(
        301, "link", _ABORT, "device",
        "no connection to the device",
        "whether the last command was carried out",
        "check its cable and power; run `cellctl doctor`",
    ),
    Alarm(
        302, "unplugged", _ABORT, "device",
        "an open device disappeared: its node or connection is gone",
        "whether the last command was carried out",
        "plug it in, check its power; run `cellctl doctor`",
    ),
    Alarm(
        303, "silent_line", _ABORT, _ARM,
        "the arm's line returns no bytes; a stop was sent all the same",
        _WHERE_ARM_IS,
        "press the emergency stop if anything moves; check cable, power, boards",
    ),
    Alarm(
        304, "reply_timeout", _ABORT, "device",
        "the device took too long to answer",
        "whether the last command was carried out",
        "check its cable and power; if it happens again, look for a second master on its line",
    ),
    Alarm(
        305, "bad_reply", _ABORT, "device",
        "the device sent bytes that its manual forbids",
        "whether the last command was carried out",
        "check cable, earth and termination; send the wire trace with your report",
    ),
    Alarm(
        306, "wrong_device", _REFUSED, "device",
        "another device answers at this address",
        "the device that belongs there, and its state",
        "check address and unit id in the cell file",
    ),
    Alarm(
        307, "refused", _ABORT, "device",
        "the device understood the command and refused it",
        "nothing: the command was not carried out",
        "read the device's own code in the message",
    ),
    Alarm(
        308, "fault", _ABORT, "device",
        "the device reports a fault of its own",
        "whether it still holds the part it had",
        "read the device's own code in the message, correct the fault, and start again",
    ),
    Alarm(
        309, "position_lost", _ABORT, "device",
        "the device restarted: all its positions are void",
        "the positions of its axes or jaws, and what they hold",
        "`cellctl recover` shows whether the arm can home with the part it holds, and what "
        "to check; otherwise take the part out. With empty grippers the next start homes "
        "the device again",
    ),
    Alarm(
        310, "stalled", _ABORT, "device",
        "a motion ended against an unexpected obstacle",
        "the obstacle",
        "look at the jaws or the axis before you start again",
    ),
    Alarm(
        311, "stop_not_confirmed", _ABORT, "device",
        "a device did not confirm its stop in time",
        "whether it still moves",
        "press the emergency stop if anything moves; check its cable and power",
    ),
    Alarm(
        312, "no_library", _REFUSED, "device",
        "a library of this computer that the device's driver needs is missing",
        "nothing: no command was sent",
        "install what the message names; `cellctl doctor` shows it",
    ),
    Alarm(
        320, "stall", _ABORT, _ARM,
        "an axis stopped elsewhere than ordered: it may have hit something",
        "the obstacle, and whether the part is still held as before",
        "find the obstacle before you start again",
    ),
    Alarm(
        321, "out_of_range", _ABORT, _ARM,
        "a motion beyond the limits of an axis was refused",
        "nothing: no command was sent",
        "check `arm` in the cell file; report it as a bug, because plans stay within the limits",
    ),
    Alarm(
        322, "power_off", _ABORT, _ARM,
        "a motion was about to begin while motor power is off",
        "nothing: no command was sent",
        "switch the power on and start again",
    ),
    Alarm(
        323, "motion_stopped", _ABORT, _ARM,
        "a stop ended the motion",
        "nothing: positions were read back",
        "find in the journal who stopped it, and start again",
    ),
    Alarm(
        324, "homing", _ABORT, _ARM,
        "an axis did not find its end stop",
        "the positions of the axes",
        "look for an obstacle to the axis named, and start again",
    ),
    Alarm(
        325, "line_uncertain", _ABORT, _ARM,
        "a byte on the arm's line was corrupted; both boards were stopped",
        "the position of the arm, if the message reports positions as lost",
        "start again; if it happens again, check cable and earth",
    ),
    Alarm(
        330, "stopped", _ABORT, _FIXED,
        "a stop ended the motion of the jaws",
        "whether the jaws hold something",
        "find in the journal who stopped it, and start again",
    ),
    Alarm(
        340, "device_retried", _WARNING, "device",
        "a picture, a lamp command or a reading failed and was repeated",
        "nothing once it succeeded",
        "if it happens often, check cable and power of the device named",
    ),
    Alarm(
        341, "demoted", _WARNING, "planner",
        "a grasp or a view has failed so often that this batch avoids it",
        "nothing",
        "check pads, force and part; for a view, lamps and camera of the station",
    ),
)  # fmt: skip
