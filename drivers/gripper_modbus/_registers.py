"""Register map of Robotiq's 2F grippers, transcribed: modbus_devices.md 2.2 to 2.4.

Numbers in, numbers out: no link, no millimetres, no clock.

Sections (§) are those of modbus_devices.md.
"""

from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import Final, NewType

from messages import key, say

from ..errors import BadReplyError

Counts = NewType("Counts", int)  # 0 open .. 255 closed, of the encoders or of a request

OUTPUT_REGISTER: Final = 0x03E8  # §2.1: master to gripper
OUTPUT_COUNT: Final = 3
INPUT_REGISTER: Final = 0x07D0  # §2.1: gripper to master
INPUT_COUNT: Final = 3

ACTIVATE: Final = 0x01  # rACT, §2.2
GO_TO: Final = 0x08  # rGTO, §2.2
FULLY_OPEN: Final = Counts(0x00)
FULLY_CLOSED: Final = Counts(0xFF)

_RESERVED_STATUS_BITS: Final = 0x06  # §2.3: bits 1 and 2 of the status byte have no meaning


class ActivationState(IntEnum):
    """gSTA, 2.3."""

    RESET = 0
    ACTIVATING = 1
    ACTIVE = 3


class ObjectState(IntEnum):
    """gOBJ, §2.3; without meaning unless gGTO is set."""

    MOVING = 0
    CONTACT_OPENING = 1
    CONTACT_CLOSING = 2
    AT_POSITION = 3


class FaultClass(Enum):
    """The way in which a fault ends, 2.4."""

    NONE = "none"
    PRIORITY = "priority"  # the order of commands was wrong
    MINOR = "minor"  # ends by itself
    MAJOR = "major"  # needs a new activation, which moves the jaws


@dataclass(frozen=True, slots=True)
class Fault:
    """The meaning of a fault number, and the advice on it."""

    kind: FaultClass
    text: str
    advice: str


_REACTIVATE: Final = key("take the part out if one is held, then activate the gripper again")

FAULTS: Final[dict[int, Fault]] = {  # §2.4
    0x00: Fault(FaultClass.NONE, key("no fault"), key("nothing to do")),
    0x05: Fault(
        FaultClass.PRIORITY, key("action delayed by an activation"), key("let it finish activating")
    ),
    0x07: Fault(FaultClass.PRIORITY, key("not activated"), key("activate it before it is moved")),
    0x08: Fault(
        FaultClass.MINOR, key("over-temperature, 85 degC or more"), key("let it cool below 80 degC")
    ),
    0x09: Fault(
        FaultClass.MINOR, key("no communication for 1 s"), key("nothing to do: any message ends it")
    ),
    0x0A: Fault(
        FaultClass.MAJOR,
        key("supply under-voltage"),
        say("check its 24 V supply; {reactivate}", reactivate=_REACTIVATE),
    ),
    0x0B: Fault(
        FaultClass.MAJOR,
        key("automatic release in progress"),
        say("wait for its end; {reactivate}", reactivate=_REACTIVATE),
    ),
    0x0C: Fault(
        FaultClass.MAJOR,
        key("internal fault"),
        say("{reactivate}; if it returns, ask Robotiq's support", reactivate=_REACTIVATE),
    ),
    0x0D: Fault(
        FaultClass.MAJOR,
        key("activation fault"),
        say("free the fingers; {reactivate}", reactivate=_REACTIVATE),
    ),
    0x0E: Fault(
        FaultClass.MAJOR,
        "over-current",
        say("look for jammed fingers; {reactivate}", reactivate=_REACTIVATE),
    ),
    0x0F: Fault(FaultClass.MAJOR, key("automatic release completed"), _REACTIVATE),
}
_UNLISTED: Final = Fault(
    FaultClass.MAJOR,
    key("a fault that the manual does not list"),
    say("note it; {reactivate}", reactivate=_REACTIVATE),
)
NO_MESSAGE_FAULT: Final = 0x09
RELEASING_FAULT: Final = 0x0B


def fault_of(code: int) -> Fault:
    """Return the fault with a gFLT number."""
    return FAULTS.get(code, _UNLISTED)


@dataclass(frozen=True, slots=True)
class Inputs:
    """The three input registers, taken apart (§2.3)."""

    activation_echo: bool  # gACT
    go_to_echo: bool  # gGTO
    activation: ActivationState  # gSTA
    object: ObjectState  # gOBJ
    fault: int  # gFLT
    controller_fault: int  # kFLT
    requested: Counts  # gPR
    position: Counts  # gPO
    current_ma: int  # gCU is about 10 mA per count


def decode_inputs(registers: tuple[int, ...]) -> Inputs:
    """Return the fields of the input registers.

    Raises
    ------
    BadReplyError : a bit is set that the manual gives no meaning, or gSTA is 2
    """
    status = registers[0] >> 8
    activation = status >> 4 & 0x03
    if status & _RESERVED_STATUS_BITS or activation not in (0, 1, 3):
        raise BadReplyError(
            say(
                "no Robotiq 2F sends {register}: bits of its status byte "
                "{status:02X} have no meaning",
                register=" ".join(f"{register:04X}" for register in registers),
                status=status,
            )
        )
    faults = registers[1] >> 8
    return Inputs(
        activation_echo=bool(status & ACTIVATE),
        go_to_echo=bool(status & GO_TO),
        activation=ActivationState(activation),
        object=ObjectState(status >> 6),
        fault=faults & 0x0F,
        controller_fault=faults >> 4,
        requested=Counts(registers[1] & 0xFF),
        position=Counts(registers[2] >> 8),
        current_ma=(registers[2] & 0xFF) * 10,
    )


def encode_outputs(
    action: int, position: Counts = FULLY_OPEN, speed: int = 0, force: int = 0
) -> tuple[int, int, int]:
    """Return the three output registers: action << 8, rPR, rSP << 8 | rFR (§2.2).

    Parameters
    ----------
    action : the bits of ACTION REQUEST: rACT, rGTO, rATR, rARD
    position : requested position rPR, 0 open to 255 closed [counts]
    speed : rSP, 0 slowest to 255
    force : rFR, 0 least to 255

    Raises
    ------
    ValueError : one of them does not fit into a byte
    """
    if not all(0 <= byte <= 0xFF for byte in (action, position, speed, force)):
        raise ValueError(f"bytes hold 0..255, not {action}, {position}, {speed}, {force}")
    return action << 8, position, speed << 8 | force
