"""The framing of a request or an answer: the header of Modbus TCP, the checksum of RTU."""

from typing import Final

MBAP_SIZE: Final = 7  # Modbus messaging on TCP/IP V1.0b, 3.1.3; the unit id among them
# Modbus over serial line V1.02, 2.5.1: unit, function, exception code, CRC; and the longest frame.
MIN_RTU_SIZE: Final = 5
MAX_RTU_SIZE: Final = 256


def _of_byte(crc: int) -> int:
    for _ in range(8):
        crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc


_CRC_OF_BYTE: Final = tuple(map(_of_byte, range(256)))


def crc16(data: bytes, begun: int = 0xFFFF) -> int:
    """Return the checksum of bytes, Modbus over serial line V1.02, appendix B.

    Over a whole frame, its own checksum among the bytes, it is 0.

    Parameters
    ----------
    data : the bytes
    begun : checksum of what comes before them
    """
    crc = begun
    for byte in data:
        crc = crc >> 8 ^ _CRC_OF_BYTE[(crc ^ byte) & 0xFF]
    return crc
