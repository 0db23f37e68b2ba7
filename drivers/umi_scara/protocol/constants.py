"""Transcript of the known numbers of the UMI RTX / RT100 line, each with its section.

Sections (§) are those of umi_rtx.md. Counts are motor encoder counts.
"""

from enum import IntEnum, IntFlag
from fractions import Fraction
from typing import Final, NamedTuple

from messages import key

# ---- line (§1.1, §1.2) ---------------------------------------------------------------------------
BAUD: Final = 9600  # §1.1; 8 data bits, no parity, 1 stop bit, no flow control
MIN_SPACING_S: Final = 0.008  # §1.2 start of request to start of request
SILENCE_S: Final = 0.020  # §1.6 step 1 and §1.7: the line is idle after this long without a byte
REPLY_TIMEOUT_S: Final = 0.140  # §1.2 "100-250 ms"; three of them with their pauses fit in 0.5 s
BUSY_RETRY_S: Final = 0.010  # §2.9 for 01, 02 and 04
POLL_S: Final = 0.020  # §3.3 asks for >= 10 ms


# ---- motors (§1.3) ------------------------------------------------------------------------------
class Ip(IntEnum):
    """The two Intelligent Peripherals that share the line (§1.3)."""

    WRIST = 0
    ARM = 1

    @property
    def other(self) -> "Ip":
        """The IP at the other end of a hand-over."""
        return Ip(1 - self)


class Axis(IntEnum):
    """The seven motors by their library numbers (§1.3); never sent over the line."""

    ELBOW = 0
    SHOULDER = 1
    ZED = 2
    WRIST1 = 3
    WRIST2 = 4
    YAW = 5
    GRIPPER = 6


class Address(NamedTuple):
    """Address of a motor: its IP, and its controller number 0-4 there (§1.3)."""

    ip: Ip
    ctl: int


ADDRESSES: Final = {  # §1.3: the table every working driver sends, not the manual's tables 1 and 2
    Axis.ELBOW: Address(Ip.ARM, 0),
    Axis.SHOULDER: Address(Ip.ARM, 1),
    Axis.ZED: Address(Ip.ARM, 2),
    Axis.YAW: Address(Ip.ARM, 3),
    Axis.GRIPPER: Address(Ip.ARM, 4),
    Axis.WRIST1: Address(Ip.WRIST, 2),
    Axis.WRIST2: Address(Ip.WRIST, 3),
}
CONTROLLER_COUNT: Final = 5  # §1.3


# ---- requests (§2.1, §2.3-2.7) -------------------------------------------------------------------
class Simple(IntEnum):
    """One-byte commands (§2.3)."""

    GO = 0x00
    IDENTIFY = 0x01
    INIT = 0x08
    START_SOAK = 0x09
    INIT_AND_SOAK = 0x0A
    STOP_SOAK = 0x0B
    GENERAL_STATUS = 0x17
    RESET = 0x20
    DEFINE_HOME = 0x21
    LOAD_DEFAULTS = 0x22
    DEAD_STOP = 0x24
    RAMP_STOP = 0x25
    FREE_STOP = 0x26
    FREE_OFF = 0x27
    TOGGLE_OFF = 0x28
    TOGGLE_ONCE = 0x29
    TOGGLE_ON = 0x2A
    VERSION = 0x38


class Mode(IntEnum):
    """Mode commands, three bytes each (§2.4)."""

    POSITION = 0x18
    FORCE = 0x19
    ABSOLUTE = 0x1A
    RELATIVE = 0x1B
    USER_IO_INPUT = 0x1C
    USER_IO_OUTPUT = 0x1D


CONTROLLER_STATUS: Final = 0x10  # §2.3, + ctl
READ_CP_ERROR: Final = 0x40  # §2.5, + ctl
READ_CURRENT_POSITION: Final = 0x48  # §2.5, + ctl
WRITE_CURRENT_POSITION: Final = 0x58  # §2.5, + ctl
SELECT_READ: Final = 0x60  # §2.5 frame 1 of a deferred read
DEFERRED_READ: Final = 0x68  # §2.5 frame 2, + ctl
SELECT_WRITE: Final = 0x70  # §2.5 frame 1 of a deferred write
DEFERRED_WRITE: Final = 0x78  # §2.5 frame 2, + ctl
FILLER: Final = 0x00  # §2.5: UvA and UTS send 00, iLab and BS send CC; the IP ignores it
MANUAL_GO: Final = 0x80  # §2.6
NUMERIC_GO: Final = 0xA0  # §2.7, | mask
INTERPOLATION: Final = 0xE0  # §2.7 and 9 no. 2: UvA's E0, iLab says C0


class Parameter(IntEnum):
    """Parameters of a controller (§2.5); 15, ACTUAL_POSITION, is not on the wire."""

    CP_ERROR = 0
    CURRENT_POSITION = 1
    ERROR_LIMIT = 2
    NEW_POSITION = 3
    SPEED = 4
    KP = 5
    KI = 6
    KD = 7
    DEAD_BAND = 8
    OFFSET = 9
    MAX_FORCE = 10
    CURRENT_FORCE = 11
    ACCELERATION_TIME = 12
    USER_RAM = 13
    USER_IO = 14


IMMEDIATE: Final = frozenset({Parameter.CP_ERROR, Parameter.CURRENT_POSITION})  # §2.5
READ_ONLY: Final = frozenset({Parameter.CP_ERROR, Parameter.CURRENT_FORCE})  # §2.5
RELOADED: Final = frozenset(Parameter) - {  # 7, on `22`: parameters 2, 4-10 and 12
    Parameter.CP_ERROR,
    Parameter.CURRENT_POSITION,
    Parameter.NEW_POSITION,
    Parameter.CURRENT_FORCE,
    Parameter.USER_RAM,
    Parameter.USER_IO,
}


class Drive(IntEnum):
    """Order of a manual go to one controller, two bits each (§2.6)."""

    HOLD = 0b00
    FORWARD = 0b01
    REVERSE = 0b10
    FREE = 0b11


# ---- replies (§2.1, §2.8, §2.9) ----------------------------------------------------------------
class StatusBits(IntFlag):
    """Status byte of a controller or, OR-ed over its controllers, of an IP (§2.8).

    Bits 4 and 5 mean the user I/O lines in a general status; bit 1 carries no decision.
    """

    MOVING = 0x01
    STOPPED = 0x02
    FOLLOWING_ERROR = 0x04
    STALLED = 0x08
    RELATIVE = 0x10
    FORCE_MODE = 0x20
    ENGAGED = 0x40
    IO_CHANGED = 0x10
    IO_INPUT = 0x20


FAULT_BITS: Final = StatusBits.FOLLOWING_ERROR | StatusBits.STALLED  # §2.8

REPLY_TEXTS: Final = {  # §2.9
    0x01: key("in progress"),
    0x02: "stored",
    0x03: key("axis busy"),
    0x04: key("IP or decoder busy"),
    0x05: key("parameter out of range"),
    0x06: key("read-only parameter"),
    0x07: key("read-only parameter"),
    0x08: key("selection (ctl) out of range"),
    0x09: key("command out of range"),
    0x0A: key("command not supported"),
    0x0B: key("frame timeout: request bytes missing"),
    0x0C: key("frame overrun: too many or too early bytes"),
    0x0D: key("parity error"),
}
RETRY_CODES: Final = frozenset({0x01, 0x02, 0x04})  # §2.9: ask again after 10 ms
AXIS_BUSY: Final = 0x03  # §2.9
RESTARTED_CODES: Final = frozenset({0x0E, 0x0F})  # §1.5, §2.9

# ---- scaling (§5.1, §5.3) ------------------------------------------------------------------------
SHOULDER_COUNTS_PER_DEG: Final = 29.221
ELBOW_COUNTS_PER_DEG: Final = 14.611
YAW_COUNTS_PER_DEG: Final = 9.740
WRIST_COUNTS_PER_DEG: Final = 13.487
ZED_COUNTS_PER_MM: Final = 3.750

# ---- ranges [counts] (§5.2) ---------------------------------------------------------------------
SHOULDER_RANGE: Final = (-2630, 2630)
ELBOW_RANGE: Final = (-2630, 2206)
ZED_RANGE: Final = (-3303, -20)  # software
ZED_STOPS: Final = (-3554, 0)
YAW_LESS_ELBOW_RANGE: Final = (-1071, 1071)  # range of yaw - elbow / 3
YAW_ELBOW_RATIO: Final = Fraction(1, 3)  # §5.2, §5.4: the yaw belt runs over the elbow axis
WRIST_SUM_RANGE: Final = (-2642, 108)  # range of W1 + W2: pitch
WRIST_DIFFERENCE_RANGE: Final = (-3560, 4882)  # range of W1 - W2: roll
GRIPPER_RANGE: Final = (-30, 1200)

# ---- homing (§4.1, §4.2) -------------------------------------------------------------------------
STOP_COUNTS: Final = {  # §4.2, column UvA: satisfies the combined limits exactly
    Axis.ZED: 0,
    Axis.SHOULDER: 2630,
    Axis.ELBOW: -2629,
    Axis.YAW: -1947,
    Axis.WRIST1: -3101,
    Axis.WRIST2: 459,
    Axis.GRIPPER: 0,
}
HOMING_CREEP_COUNTS: Final = 440  # §4.1 step 3: the elbow swings the gripper clear by this much
# Homing that keeps the jaws shut (§4.7): position of the shoulder while the elbow goes to its
# forward stop, so that the hand stays on the side away from the column
KEEPING_SHOULDER_COUNTS: Final = -1110
# and the position of zed afterwards: below the top counts that §5.2 keeps free, so that moves may
# begin there
KEEPING_ZED_COUNTS: Final = -38
PARK_COUNTS: Final = {axis: -18 if axis is Axis.ZED else 0 for axis in Axis}  # §4.1 step 7
GRASP_COUNTS: Final = -500  # §5.5: iLab's target beyond closed

# ---- motion (7) --------------------------------------------------------------------------------
NOMINAL_COUNTS_PER_S: Final = {  # 7, from §5.7: unsourced; only forecasts and speed ratios use it
    Axis.ZED: 412.0,
    Axis.SHOULDER: 672.0,
    Axis.ELBOW: 643.0,
    Axis.YAW: 1071.0,
    Axis.WRIST1: 1400.0,
    Axis.WRIST2: 1400.0,
    Axis.GRIPPER: 1400.0,
}
NOMINAL_SPEED: Final = 100  # §2.5, §5.6: "top speed"
RAMP_S: Final = 0.25  # 7: time to reach full speed
MAX_SPEED: Final = 160  # §2.5, §5.6: the highest value any driver has used
