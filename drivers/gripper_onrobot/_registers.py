"""Register map of OnRobot's RG2 and RG6, transcribed: modbus_devices.md 3.2 and 3.3.

Numbers in, numbers out: no link, no clock. Sections (§) are those of modbus_devices.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntFlag
from typing import Final

from messages import say

from ..errors import BadReplyError

COMMAND_REGISTER: Final = 0x0000  # §3.2: force, width, control
CONTROL_REGISTER: Final = 0x0002
GO_WITH_OFFSET: Final = 16
STOP: Final = 8
STATUS_REGISTER: Final = 0x010C
STATE_COUNT: Final = 8  # 0x010C to 0x0113
PRODUCT_REGISTER: Final = 0x0600
PRODUCT_COUNT: Final = 6  # product to build
BOX_UNIT: Final = 63  # §3.1
POWER_CYCLE: Final = 2  # §3.3, to 0x0000 of that unit
TENTHS: Final = 10


class Flag(IntFlag):
    """Status bits, §3.3."""

    BUSY = 0x01
    GRASP = 0x02
    SWITCH_1 = 0x04
    SWITCH_1_TRIGGERED = 0x08
    SWITCH_2 = 0x10
    SWITCH_2_TRIGGERED = 0x20
    SAFETY_ERROR = 0x40


SAFETY: Final = (
    Flag.SWITCH_1
    | Flag.SWITCH_1_TRIGGERED
    | Flag.SWITCH_2
    | Flag.SWITCH_2_TRIGGERED
    | Flag.SAFETY_ERROR
)


@dataclass(frozen=True, slots=True)
class Model:
    """One of the two grippers, §3.2."""

    name: str
    product: int
    max_opening_mm: float
    max_force_n: float


MODELS: Final = {
    "rg2": Model("RG2", 0x20, 110.0, 40.0),
    "rg6": Model("RG6", 0x21, 160.0, 120.0),
}


def encode_command(force_n: float, opening_mm: float) -> tuple[int, int, int]:
    """Return the three registers of a motion to an opening between the fingertips."""
    return round(force_n * TENTHS), round(opening_mm * TENTHS), GO_WITH_OFFSET


def decode_state(registers: Sequence[int]) -> tuple[Flag, float]:
    """Return status and opening between the fingertips [mm] from 0x010C to 0x0113.

    Raises
    ------
    BadReplyError : a status bit is set that has no meaning
    """
    status = registers[0]
    if status & ~int(SAFETY | Flag.BUSY | Flag.GRASP):
        raise BadReplyError(say("no OnRobot RG sends the status {status:04X}", status=status))
    width = registers[-1]
    return Flag(status), (width - 0x10000 if width & 0x8000 else width) / TENTHS
