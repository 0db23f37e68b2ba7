"""A device as a set of addressable points, answered by the rules of the Modbus standard.

Sources: Modbus application protocol V1.1b3, 6.1 to 6.17 and its state diagrams: first the function
code (exception 01), then the quantity (03), the addresses (02), and what the device makes of the
values (03).
A block is carried out whole or not at all.
"""

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

from .device import (
    ILLEGAL_ADDRESS,
    ILLEGAL_FUNCTION,
    ILLEGAL_VALUE,
    RefusedRequest,
    exception_pdu,
)

COIL_ON: Final = 0xFF00
COIL_OFF: Final = 0x0000


_MAX_BITS_READ: Final = 2000
_MAX_REGISTERS_READ: Final = 125
_MAX_COILS_WRITTEN: Final = 0x07B0
_MAX_REGISTERS_WRITTEN: Final = 123


def _is_coil_value(value: int) -> bool:
    return value in (COIL_ON, COIL_OFF)


@dataclass(frozen=True, slots=True)
class Point:
    """One address.

    Attributes
    ----------
    read : gives its word, or for a bit anything true or false; None: the address cannot be read
    write : takes its word, for a coil the word of FC05; None: the address cannot be written
    accepts : test whether a word may be written here (exception 03 otherwise)
    """

    read: Callable[[], int] | None = None
    write: Callable[[int], None] | None = None
    accepts: Callable[[int], bool] = lambda _: True


def coil(read: Callable[[], int] | None, write: Callable[[int], None] | None) -> Point:
    """Return a coil by the standard, which knows FF00 and 0000 only."""
    return Point(read, write, _is_coil_value)


Points = Mapping[int, Point]


@dataclass(frozen=True, slots=True, eq=False)
class PointMap:
    """The four address areas of a device and the function codes it knows."""

    functions: frozenset[int]
    coils: Points = field(default_factory=dict)
    discretes: Points = field(default_factory=dict)
    holdings: Points = field(default_factory=dict)
    inputs: Points = field(default_factory=dict)

    def answer(self, pdu: bytes) -> bytes:
        """Carry out a request and return its reply or exception.

        Parameters
        ----------
        pdu : function code and data, at least one byte
        """
        function = pdu[0]
        try:
            if function not in self.functions:
                raise RefusedRequest(ILLEGAL_FUNCTION)
            return self._carry_out(function, pdu[1:])
        except RefusedRequest as refused:
            return exception_pdu(function, refused.code)

    def _carry_out(self, function: int, body: bytes) -> bytes:
        match function:
            case 0x01:
                return bytes((function,)) + _read_bits(self.coils, body)
            case 0x02:
                return bytes((function,)) + _read_bits(self.discretes, body)
            case 0x03:
                return bytes((function,)) + _read_words(self.holdings, body)
            case 0x04:
                return bytes((function,)) + _read_words(self.inputs, body)
            case 0x05:
                address, value = _two_words(body)
                _write(self.coils, address, [value])
                return bytes((function,)) + body
            case 0x06:
                address, value = _two_words(body)
                _write(self.holdings, address, [value])
                return bytes((function,)) + body
            case 0x0F:
                address, values = _parse_coils(body)
                _write(self.coils, address, values)
                return bytes((function,)) + body[:4]
            case 0x10:
                address, values = parse_registers(body)
                _write(self.holdings, address, values)
                return bytes((function,)) + body[:4]
            case _:
                raise RefusedRequest(ILLEGAL_FUNCTION)


def _two_words(body: bytes) -> tuple[int, int]:
    if len(body) != 4:
        raise RefusedRequest(ILLEGAL_VALUE)
    first, second = struct.unpack(">HH", body)
    return first, second


def parse_range(body: bytes, limit: int = _MAX_REGISTERS_READ) -> tuple[int, int]:
    """Return address and count of a read.

    Raises
    ------
    RefusedRequest : 03, the count is zero or above `limit`, or the body has another length
    """
    address, count = _two_words(body)
    if not 1 <= count <= limit:
        raise RefusedRequest(ILLEGAL_VALUE)
    return address, count


def parse_registers(body: bytes) -> tuple[int, list[int]]:
    """Return address and words of an FC16 body.

    Raises
    ------
    RefusedRequest : 03, count, byte count and length do not fit each other or the standard
    """
    if len(body) < 5:
        raise RefusedRequest(ILLEGAL_VALUE)
    address, count, byte_count = struct.unpack_from(">HHB", body)
    if not 1 <= count <= _MAX_REGISTERS_WRITTEN:
        raise RefusedRequest(ILLEGAL_VALUE)
    if byte_count != 2 * count or len(body) != 5 + byte_count:
        raise RefusedRequest(ILLEGAL_VALUE)
    return address, list(struct.unpack_from(f">{count}H", body, 5))


def _parse_coils(body: bytes) -> tuple[int, list[int]]:
    if len(body) < 5:
        raise RefusedRequest(ILLEGAL_VALUE)
    address, count, byte_count = struct.unpack_from(">HHB", body)
    if not 1 <= count <= _MAX_COILS_WRITTEN:
        raise RefusedRequest(ILLEGAL_VALUE)
    if byte_count != (count + 7) // 8 or len(body) != 5 + byte_count:
        raise RefusedRequest(ILLEGAL_VALUE)
    bits = int.from_bytes(body[5:], "little")  # the first coil is the lowest bit of the first byte
    return address, [COIL_ON if bits >> i & 1 else COIL_OFF for i in range(count)]


def _read(points: Points, address: int, count: int) -> list[int]:
    readers = []
    for at in range(address, address + count):
        point = points.get(at)
        if point is None or point.read is None:
            raise RefusedRequest(ILLEGAL_ADDRESS)
        readers.append(point.read)
    return [read() for read in readers]


def _read_bits(points: Points, body: bytes) -> bytes:
    address, count = parse_range(body, _MAX_BITS_READ)
    packed = sum(1 << i for i, value in enumerate(_read(points, address, count)) if value)
    byte_count = (count + 7) // 8
    return bytes((byte_count,)) + packed.to_bytes(byte_count, "little")


def _read_words(points: Points, body: bytes) -> bytes:
    address, count = parse_range(body)
    words = _read(points, address, count)
    return bytes((2 * count,)) + struct.pack(f">{count}H", *words)


def _write(points: Points, address: int, values: list[int]) -> None:
    writers = []
    for at, value in enumerate(values, address):
        point = points.get(at)
        if point is None or point.write is None:
            raise RefusedRequest(ILLEGAL_ADDRESS)
        writers.append((point, point.write, value))
    for point, _, value in writers:
        if not point.accepts(value):
            raise RefusedRequest(ILLEGAL_VALUE)
    for _, write, value in writers:
        write(value)
