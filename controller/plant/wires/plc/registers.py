"""The register map of the PLC's wire: addresses, bits, and what is packed how. No I/O.

Holding registers, counted from 0. Numbers of more than one register have their high word first;
text is ASCII, two signs a register, the first one high, filled with zeros. `docs/plant-plc.md` has
it for those who program a PLC.
"""

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Final

from ...model import Disposition, PartResult

MAP_VERSION: Final = 1
COUNT: Final = 120
# out
VERSION: Final = 0
STATUS: Final = 1
PACKML: Final = 2
ALARM: Final = 3
REFUSAL: Final = 4
HEARTBEAT: Final = 5
RESULT: Final = 6
TRAY: Final = 7
INSPECTION: Final = 8
RESULT_SERIAL: Final = 10
VALUES: Final = 26
VALUE_COUNT: Final = 20
# in: all from here on may be written, and nothing else
COMMAND: Final = 100
RECIPE: Final = 101
QUANTITY: Final = 102
PLC_HEARTBEAT: Final = 103
SERIAL: Final = 104
SERIAL_COUNT: Final = 16  # registers, of two signs each

NOT_A_NUMBER: Final = math.nan


class Status(IntFlag):
    """Bits of the status register."""

    ONLINE = 1 << 0
    READY = 1 << 1
    BUSY = 1 << 2
    RESULT_VALID = 1 << 3
    START_ACKNOWLEDGED = 1 << 4
    COMMAND_FAILED = 1 << 5
    HELD = 1 << 6
    FAULT = 1 << 7
    REMOTE_ALLOWED = 1 << 8


class CommandBit(IntFlag):
    """Bits of the command register."""

    START = 1 << 0
    STOP = 1 << 1
    RESULT_ACKNOWLEDGED = 1 << 2
    RESET = 1 << 3


NO_BITS: Final = CommandBit(0)


class FailureReason(IntEnum):
    """Why a command failed."""

    NONE = 0
    NOT_READY = 1
    REMOTE_NOT_ALLOWED = 2
    UNKNOWN_RECIPE = 3
    BUSY = 4
    RESULTS_WAIT = 5
    HEARTBEAT_STANDS = 6
    ORDER_REFUSED = 7
    BAD_SERIAL = 8
    STOP_REFUSED = 9
    STOP_BIT_IS_SET = 10


DISPOSITIONS: Final[dict[Disposition | None, int]] = {
    None: 0,
    "accept": 1,
    "reject": 2,
    "quarantine": 3,
}


@dataclass(frozen=True, slots=True)
class Command:
    """What the PLC has written.

    Attributes
    ----------
    serial : None where it is no printable ASCII; empty where none is given
    """

    bits: CommandBit = NO_BITS
    recipe: int = 0
    quantity: int = 0
    heartbeat: int = 0
    serial: str | None = ""


def read_command(registers: Sequence[int]) -> Command:
    """Return what stands in the registers from `COMMAND` on.

    Parameters
    ----------
    registers : all of the map
    """
    raw = b"".join(
        one.to_bytes(2, "big") for one in registers[SERIAL : SERIAL + SERIAL_COUNT]
    ).rstrip(b"\0 ")
    is_text = all(0x20 <= byte < 0x7F for byte in raw)
    known = NO_BITS
    for bit in CommandBit:
        known |= bit & registers[COMMAND]
    return Command(
        known,
        registers[RECIPE],
        registers[QUANTITY],
        registers[PLC_HEARTBEAT],
        raw.decode("ascii") if is_text else None,
    )


def result_registers(result: PartResult, values: Sequence[str]) -> dict[int, int]:
    """Return a result, by register.

    Parameters
    ----------
    result : what is told
    values : ids of the characteristics, in the PLC's order
    """
    found = {
        RESULT: DISPOSITIONS[result.disposition],
        TRAY: DISPOSITIONS[result.tray],
        INSPECTION: result.seq >> 16 & 0xFFFF,
        INSPECTION + 1: result.seq & 0xFFFF,
    }
    text = (result.serial or "").encode("ascii", "replace")[: 2 * SERIAL_COUNT]
    text = text.ljust(2 * SERIAL_COUNT, b"\0")
    for place in range(SERIAL_COUNT):
        found[RESULT_SERIAL + place] = int.from_bytes(text[2 * place : 2 * place + 2], "big")
    measured = {one.id: one.measured for one in result.characteristics}
    for place in range(VALUE_COUNT):
        value = measured.get(values[place]) if place < len(values) else None
        high, low = struct.unpack(">HH", as_float32(value))
        found[VALUES + 2 * place], found[VALUES + 2 * place + 1] = high, low
    return found


def as_float32(value: float | None) -> bytes:
    """Return four bytes, the high one first; NaN where nothing was measured."""
    try:
        return struct.pack(">f", NOT_A_NUMBER if value is None else value)
    except OverflowError:  # beyond 3.4e38
        return struct.pack(">f", NOT_A_NUMBER)
