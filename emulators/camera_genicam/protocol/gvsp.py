"""Stream packets of pictures: leader, payload, trailer; docs/protocols/gige_vision.md 2."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from struct import Struct
from typing import Final

_HEADER: Final = Struct(">HHI")  # status, block id, format (8 bits) and packet id (24 bits)
_LEADER: Final = Struct(">HHQIIIIIHH")
_TRAILER: Final = Struct(">HHI")
_IMAGE: Final = 0x0001  # payload type
IP_UDP_BYTES: Final = 28
HEADER_BYTES: Final = IP_UDP_BYTES + _HEADER.size  # of a packet's size in all
LAST_BLOCK: Final = 0xFFFF  # 1 follows: no block is number 0


class Format(IntEnum):
    """Kinds of packets."""

    LEADER = 1
    TRAILER = 2
    PAYLOAD = 3


class PacketStatus(IntEnum):
    """Codes of a packet."""

    SUCCESS = 0x0000
    UNAVAILABLE = 0x800C


@dataclass(frozen=True, slots=True)
class Image:
    """What the leader says of a picture.

    Attributes
    ----------
    timestamp : camera's time of the exposure [ticks]
    pixel_format : number of the format
    width_px, height_px, x_px, y_px : region of the sensor
    """

    timestamp: int
    pixel_format: int
    width_px: int
    height_px: int
    x_px: int
    y_px: int


def _packet(
    block: int, kind: Format, number: int, body: bytes, status: PacketStatus = PacketStatus.SUCCESS
) -> bytes:
    return _HEADER.pack(status, block, kind << 24 | number) + body


def packets_of(block: int, image: Image, pixels: bytes, packet_bytes: int) -> list[bytes]:
    """Return all packets of a picture in their order; the index of each is its packet id.

    Parameters
    ----------
    block : number of the picture, 1 to `LAST_BLOCK`
    image : what the leader says
    pixels : its bytes, row by row
    packet_bytes : size of a packet with all its headers, as SCPS has it
    """
    step = packet_bytes - HEADER_BYTES
    leader = _LEADER.pack(
        0,
        _IMAGE,
        image.timestamp,
        image.pixel_format,
        image.width_px,
        image.height_px,
        image.x_px,
        image.y_px,
        0,
        0,
    )
    pieces: Sequence[bytes] = [pixels[at : at + step] for at in range(0, len(pixels), step)]
    trailer = _TRAILER.pack(0, _IMAGE, image.height_px)
    return [
        _packet(block, Format.LEADER, 0, leader),
        *(_packet(block, Format.PAYLOAD, n, piece) for n, piece in enumerate(pieces, start=1)),
        _packet(block, Format.TRAILER, len(pieces) + 1, trailer),
    ]


def unavailable(block: int, number: int) -> bytes:
    """Return the answer to a request for a packet that cannot be sent again."""
    return _packet(block, Format.PAYLOAD, number, b"", PacketStatus.UNAVAILABLE)


def fired_for_test(packet_bytes: int) -> bytes:
    """Return a test packet of a size with all its headers; block and packet are number 0."""
    return _packet(0, Format.PAYLOAD, 0, bytes(packet_bytes - HEADER_BYTES))
