"""Modbus frames as bytes, for the supervisor, which has no link.

By the Modbus application protocol V1.1b3 (functions 02, 05, 06), its TCP guide and its serial line
guide (CRC-16).
"""

import struct
from typing import Final

from ._address import Address, RtuAddress, TcpAddress
from ._framing import MBAP_SIZE, crc16
from ._request import FunctionCode

_NUMBER: Final = 0xB11D  # transaction number; our own connection has no other


def place_of(address: Address) -> str:
    """Return the place of a line: the device node, or ``host:port``."""
    return address.device if isinstance(address, RtuAddress) else f"{address.host}:{address.port}"


def write_frame(address: Address, unit: int, register: int, value: int) -> bytes:
    """Return the frame that writes one register (FC06).

    Parameters
    ----------
    address : address of the line, which decides on the framing
    unit : unit id
    register : zero based
    value : 0..65535
    """
    return _framed(address, unit, struct.pack(">BHH", FunctionCode.WRITE_REGISTER, register, value))


def coil_frame(address: Address, unit: int, coil: int, *, is_on: bool) -> bytes:
    """Return the frame that switches one coil (FC05).

    Parameters
    ----------
    address : address of the line, which decides on the framing
    unit : unit id
    coil : zero based
    is_on : state to switch it to
    """
    pdu = struct.pack(">BHH", FunctionCode.WRITE_COIL, coil, 0xFF00 if is_on else 0x0000)
    return _framed(address, unit, pdu)


def inputs_frame(address: TcpAddress, unit: int, count: int) -> bytes:
    """Return the frame that reads the first discrete inputs (FC02).

    Parameters
    ----------
    address : address of the line
    unit : unit id
    count : number of coils or registers
    """
    return _framed(address, unit, struct.pack(">BHH", FunctionCode.READ_DISCRETE_INPUTS, 0, count))


def inputs_mask(count: int, wanted: tuple[int, ...]) -> bytes:
    """Return a mask over the answer to `inputs_frame`, with the bits of some inputs set.

    Parameters
    ----------
    count : number of inputs read
    wanted : numbers of those that are looked at
    """
    bits = sum(1 << number for number in wanted)
    return bytes(MBAP_SIZE + 2) + bits.to_bytes((count + 7) // 8, "little")


def _framed(address: Address, unit: int, pdu: bytes) -> bytes:
    if isinstance(address, TcpAddress):
        return struct.pack(">HHHB", _NUMBER, 0, len(pdu) + 1, unit) + pdu
    data = bytes([unit]) + pdu
    return data + struct.pack("<H", crc16(data))
