"""Alarms 200 to 399: of interlocks and devices. Data only."""

from typing import Final

from messages import key

from .alarm import Alarm, Severity

_ABORT, _HOLD = Severity.ABORT, Severity.HOLD
_WARNING, _REFUSED = Severity.WARNING, Severity.REFUSED
_IO, _ARM, _FIXED = key("I/O block"), "arm", key("fixed gripper")
_WHERE_ARM_IS = key(
    "the position of the arm until it answers; it may finish the motion it was sent"
)

DEVICES: Final = (
    Alarm(
        201, "estop", _ABORT, _IO,
        key("the emergency stop is pressed, or its chain is open"),
        key("the position of the arm: it is homed again"),
        key("make the cell safe, release the emergency stop, reset it, and start again"),
    ),
    Alarm(
        202, "guard_closed", _HOLD, _IO,
        key("the door is open"),
        key("whether anybody has moved the part: the cell looks for it"),
        key("close it, look at the cell, acknowledge, and resume"),
    ),
    Alarm(
        203, "supply", _ABORT, _IO,
        key("the 24 V supply is missing"),
        key("the position of the arm, and whether the fixed gripper still holds"),
        key("check the fuse and start again"),
    ),
    Alarm(
        204, "interlock", _ABORT, _IO,
        key("an interlock is not healthy, or its reading is too old"),
        key("the true state of the interlock named"),
        key("follow the message; check cable and power of the I/O block"),
    ),
    Alarm(
        206, "not_proven", _HOLD, "cell",
        key("the arm or a jaw moved while the door was open"),
        key("whether anybody has moved the part"),
        key("put it back and resume, or stop and start again"),
    ),
    Alarm(
        205, "hand_off_blocked", _ABORT, _FIXED,
        key("the arm was about to come near the fixed gripper, which holds something other "
        "than the part"),
        key("the contents of the fixed gripper"),
        key("look at the fixed gripper; take its contents out with `cellctl recover --open fixed`"),
    ),
    Alarm(
        207, "motor_watchdog", _ABORT, _IO,
        key("the I/O block received nothing for too long; its watchdog cut the motors' supply"),
        key("the position of the arm: it is homed again"),
        key(
            "find out why the computer stalled and start again; a part in a gripper is "
            "reported first"
        ),
    ),
    Alarm(
        208, "watchdog_off", _REFUSED, _IO,
        key("the watchdog that must open its outputs did not trip"),
        "nothing",
        key("set it in the block's web console (commissioning.md, the watchdog)"),
    ),
    Alarm(
        209, "inputs_stale", _ABORT, _IO,
        key("the I/O block was not read in time; the emergency stop need not have been pressed"),
        key("the state of emergency stop, door and supply until it answers, and the position "
        "of the arm: it is homed again"),
        key("check cable and power of the I/O block and its gateway, and start again"),
    ),
    Alarm(
        210, "release_refused", _ABORT, key("both grippers"),
        key("a gripper was about to open that alone is known to hold the part"),
        key("whether the other gripper has the part"),
        key("look at both grippers; take the part out with `cellctl recover`; report it as a bug"),
    ),
    Alarm(
        300, "device", _ABORT, "device",
        key("a device failed in a way that no other alarm covers"),
        key("the last action of the device"),
        key("read the message; run `cellctl doctor`"),
    ),
    Alarm(
        301, "link", _ABORT, "device",
        key("no connection to the device"),
        key("whether the last command was carried out"),
        key("check its cable and power; run `cellctl doctor`"),
    ),
    Alarm(
        302, "unplugged", _ABORT, "device",
        key("an open device disappeared: its node or connection is gone"),
        key("whether the last command was carried out"),
        key("plug it in, check its power; run `cellctl doctor`"),
    ),
    Alarm(
        303, "silent_line", _ABORT, _ARM,
        key("the arm's line returns no bytes; a stop was sent all the same"),
        _WHERE_ARM_IS,
        key("press the emergency stop if anything moves; check cable, power, boards"),
    ),
    Alarm(
        304, "reply_timeout", _ABORT, "device",
        key("the device took too long to answer"),
        key("whether the last command was carried out"),
        key("check its cable and power; if it happens again, look for a second master on its line"),
    ),
    Alarm(
        305, "bad_reply", _ABORT, "device",
        key("the device sent bytes that its manual forbids"),
        key("whether the last command was carried out"),
        key("check cable, earth and termination; send the wire trace with your report"),
    ),
    Alarm(
        306, "wrong_device", _REFUSED, "device",
        key("another device answers at this address"),
        key("the device that belongs there, and its state"),
        key("check address and unit id in the cell file"),
    ),
    Alarm(
        307, "refused", _ABORT, "device",
        key("the device understood the command and refused it"),
        key("nothing: the command was not carried out"),
        key("read the device's own code in the message"),
    ),
    Alarm(
        308, "fault", _ABORT, "device",
        key("the device reports a fault of its own"),
        key("whether it still holds the part it had"),
        key("read the device's own code in the message, correct the fault, and start again"),
    ),
    Alarm(
        309, "position_lost", _ABORT, "device",
        key("the device restarted: all its positions are void"),
        key("the positions of its axes or jaws, and what they hold"),
        key("`cellctl recover` shows whether the arm can home with the part it holds, and what "
        "to check; otherwise take the part out. With empty grippers the next start homes "
        "the device again"),
    ),
    Alarm(
        310, "stalled", _ABORT, "device",
        key("a motion ended against an unexpected obstacle"),
        key("the obstacle"),
        key("look at the jaws or the axis before you start again"),
    ),
    Alarm(
        311, "stop_not_confirmed", _ABORT, "device",
        key("a device did not confirm its stop in time"),
        key("whether it still moves"),
        key("press the emergency stop if anything moves; check its cable and power"),
    ),
    Alarm(
        312, "no_library", _REFUSED, "device",
        key("a library of this computer that the device's driver needs is missing"),
        key("nothing: no command was sent"),
        key("install what the message names; `cellctl doctor` shows it"),
    ),
    Alarm(
        320, "stall", _ABORT, _ARM,
        key("an axis stopped elsewhere than ordered: it may have hit something"),
        key("the obstacle, and whether the part is still held as before"),
        key("find the obstacle before you start again"),
    ),
    Alarm(
        321, "out_of_range", _ABORT, _ARM,
        key("a motion beyond the limits of an axis was refused"),
        key("nothing: no command was sent"),
        key(
            "check `arm` in the cell file; report it as a bug, because plans stay within the "
            "limits"
        ),
    ),
    Alarm(
        322, "power_off", _ABORT, _ARM,
        key("a motion was about to begin while motor power is off"),
        key("nothing: no command was sent"),
        key("switch the power on and start again"),
    ),
    Alarm(
        323, "motion_stopped", _ABORT, _ARM,
        key("a stop ended the motion"),
        key("nothing: positions were read back"),
        key("find in the journal who stopped it, and start again"),
    ),
    Alarm(
        324, "homing", _ABORT, _ARM,
        key("an axis did not find its end stop"),
        key("the positions of the axes"),
        key("look for an obstacle to the axis named, and start again"),
    ),
    Alarm(
        325, "line_uncertain", _ABORT, _ARM,
        key("a byte on the arm's line was corrupted; both boards were stopped"),
        key("the position of the arm, if the message reports positions as lost"),
        key("start again; if it happens again, check cable and earth"),
    ),
    Alarm(
        330, "stopped", _ABORT, _FIXED,
        key("a stop ended the motion of the jaws"),
        key("whether the jaws hold something"),
        key("find in the journal who stopped it, and start again"),
    ),
    Alarm(
        340, "device_retried", _WARNING, "device",
        key("a picture, a lamp command or a reading failed and was repeated"),
        key("nothing once it succeeded"),
        key("if it happens often, check cable and power of the device named"),
    ),
    Alarm(
        341, "demoted", _WARNING, "planner",
        key("a grasp or a view has failed so often that this batch avoids it"),
        "nothing",
        key("check pads, force and part; for a view, lamps and camera of the station"),
    ),
)  # fmt: skip
