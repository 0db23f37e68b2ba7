"""Modbus frames as a device reads and writes them: RTU with its CRC, TCP with its MBAP header.

Sources: Modbus application protocol V1.1b3 (sections 6.1 to 6.21), Modbus over serial line V1.02
(2.5.1 RTU framing, 6.2.2 CRC), Modbus messaging on TCP/IP V1.0b (3.1.3 MBAP header).
No link, no clock: whoever owns the wire says when bytes came and when the line fell silent.
"""

import struct
from dataclasses import dataclass
from typing import Final

MAX_RTU_FRAME: Final = 256  # serial line V1.02, 2.5.1: unit + 253 of PDU + CRC
MAX_PDU: Final = 253
BITS_PER_CHARACTER: Final = 10  # 8N1: start, 8 data, stop
FRAME_GAP_CHARACTERS: Final = 3.5  # serial line V1.02, 2.5.1.1
FIXED_GAP_ABOVE_BAUD: Final = 19200  # above it the standard recommends a fixed gap ...
FIXED_GAP_S: Final = 0.00175  # ... of 1.750 ms

# Length of the request PDU by function code; negative: the byte at -n counts the bytes after it.
_PDU_LENGTH: Final = {
    0x01: 5,
    0x02: 5,
    0x03: 5,
    0x04: 5,
    0x05: 5,
    0x06: 5,
    0x07: 1,
    0x08: 5,
    0x0B: 1,
    0x0C: 1,
    0x0F: -5,
    0x10: -5,
    0x11: 1,
    0x16: 7,
    0x17: -9,
}

_MBAP: Final = struct.Struct(">HHHB")  # transaction, protocol, length, unit


class BrokenStreamError(Exception):
    """A TCP stream that is not Modbus: nothing after this point can be framed."""


@dataclass(frozen=True, slots=True)
class RtuFrame:
    """One RTU frame without its CRC."""

    unit: int
    pdu: bytes


@dataclass(frozen=True, slots=True)
class MbapFrame:
    """One Modbus TCP frame."""

    transaction: int
    unit: int
    pdu: bytes


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        crc = byte
        for _ in range(8):
            crc = (crc >> 1) ^ 0xA001 if crc & 1 else crc >> 1
        table.append(crc)
    return tuple(table)


_CRC_TABLE: Final = _crc_table()


def crc16(data: bytes) -> int:
    """Return the CRC of RTU frames (polynomial A001 reflected, start FFFF)."""
    crc = 0xFFFF
    for byte in data:
        crc = (crc >> 8) ^ _CRC_TABLE[(crc ^ byte) & 0xFF]
    return crc


def encode_rtu(unit: int, pdu: bytes) -> bytes:
    """Return the RTU frame of a PDU, CRC low byte first."""
    body = bytes((unit,)) + pdu
    return body + struct.pack("<H", crc16(body))


def encode_mbap(transaction: int, unit: int, pdu: bytes) -> bytes:
    """Return the Modbus TCP frame of a PDU.

    Parameters
    ----------
    transaction : the number by which the master recognises the reply, 0 to 65535
    unit : unit id of the device
    pdu : function code and data
    """
    return _MBAP.pack(transaction, 0, len(pdu) + 1, unit) + pdu


def request_length(data: bytes | bytearray) -> int | None:
    """Return the length in bytes of the RTU request that begins with these.

    Returns
    -------
    length in bytes, CRC included; None while the bytes do not tell yet, or if the function code
    is one whose length nobody knows (only silence ends such a frame)
    """
    if len(data) < 2:
        return None
    length = _PDU_LENGTH.get(data[1])
    if length is None:
        return None
    if length > 0:
        return 1 + length + 2
    count_at = 1 - length  # position in the frame of the byte that counts the rest
    if len(data) <= count_at:
        return None
    return count_at + 1 + data[count_at] + 2


class RtuReader:
    """Collects the bytes of one RTU device between two silences.

    A device of the serial line takes everything between two silences as one frame: too much, too
    little or a wrong CRC makes all of it void. `is_complete` is only a hint that no more bytes
    are to be expected, so that the owner of the wire need not wait longer than the gap.
    """

    def __init__(self) -> None:
        self._data = bytearray()

    def feed(self, data: bytes) -> None:
        """Take bytes off the wire."""
        room = MAX_RTU_FRAME + 1 - len(self._data)  # one too many is enough to void the frame
        self._data += data[:room]

    @property
    def byte_count(self) -> int:
        """The number of bytes since the last silence."""
        return len(self._data)

    @property
    def is_complete(self) -> bool:
        """Whether the bytes so far have the length their function code announces."""
        length = request_length(self._data)
        return length is not None and len(self._data) >= length

    def silence(self) -> RtuFrame | None:
        """Return the frame that the line's silence ended, or None if it was not a sound one."""
        data = bytes(self._data)
        self._data.clear()
        if not 4 <= len(data) <= MAX_RTU_FRAME:
            return None
        # a CRC does not notice zeros after its frame, so the length is checked on its own
        if request_length(data) not in (None, len(data)):
            return None
        if crc16(data[:-2]) != struct.unpack("<H", data[-2:])[0]:
            return None
        return RtuFrame(unit=data[0], pdu=data[1:-2])


class MbapReader:
    """Cuts a TCP stream into Modbus frames; the stream may be chopped anywhere."""

    def __init__(self) -> None:
        self._data = bytearray()

    def feed(self, data: bytes) -> list[MbapFrame]:
        """Take bytes off the stream and return the frames they complete.

        Raises
        ------
        BrokenStreamError : a header with another protocol or an impossible length
        """
        self._data += data
        frames = []
        while len(self._data) >= _MBAP.size:
            transaction, protocol, length, unit = _MBAP.unpack_from(self._data)
            if protocol != 0 or not 2 <= length <= MAX_PDU + 1:
                raise BrokenStreamError(f"MBAP header {self._data[: _MBAP.size].hex(' ')}")
            end = 6 + length
            if len(self._data) < end:
                break
            frames.append(MbapFrame(transaction, unit, bytes(self._data[_MBAP.size : end])))
            del self._data[:end]
        return frames


def characters_s(count: float, baudrate: int) -> float:
    """Return the duration of characters of 8N1 on a serial line [s]."""
    return count * BITS_PER_CHARACTER / baudrate


def frame_gap_s(baudrate: int) -> float:
    """Return the silence that ends an RTU frame [s]; serial line V1.02, 2.5.1.1."""
    if baudrate > FIXED_GAP_ABOVE_BAUD:
        return FIXED_GAP_S
    return characters_s(FRAME_GAP_CHARACTERS, baudrate)
