"""The size of a stored picture, read from its header before anything is decoded.

A file of a few kilobytes may hold 60,000 x 60,000 pixels; decoded, they fill the memory.
Formats: PNG (ISO/IEC 15948, 11.2.2), JPEG (ITU-T T.81, B.2.2), TIFF 6.0 (sections 2 and 8), BMP,
PGM and PPM (netpbm), WebP (RFC 9649).
"""

import re
import struct
from collections.abc import Iterator

PNG_BEGIN = b"\x89PNG\r\n\x1a\n"
JPEG_BEGIN = b"\xff\xd8\xff"
# start of frame; C4, C8 and CC are tables and extensions
JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
JPEG_BARE = frozenset((0x01, *range(0xD0, 0xD9)))  # markers without a length
TIFF_WIDTH, TIFF_HEIGHT = 256, 257
TIFF_TYPES = {3: "H", 4: "I"}
NETPBM = re.compile(rb"P[1-6](?:\s|#[^\n]*\n)+(\d+)(?:\s|#[^\n]*\n)+(\d+)\s")


def size_in_header(data: bytes) -> tuple[int, int] | None:
    """Return (width, height) in pixels from the header; None if there is no known header."""
    try:
        if data.startswith(PNG_BEGIN):
            width, height = struct.unpack_from(">II", data, 16)
            return width, height
        if data.startswith(JPEG_BEGIN):
            return _of_jpeg(data)
        if data[:4] in (b"II*\0", b"MM\0*"):
            return _of_tiff(data)
        if data.startswith(b"BM"):
            return _of_bmp(data)
        if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
            return _of_webp(data)
        if (found := NETPBM.match(data[:1024])) is not None:
            return int(found[1]), int(found[2])
    except (struct.error, IndexError, ValueError):
        return None
    return None


def _of_jpeg(data: bytes) -> tuple[int, int] | None:
    at = 2
    while at + 9 <= len(data):
        if data[at] != 0xFF:
            return None
        marker = data[at + 1]
        if marker == 0xFF:  # padding
            at += 1
            continue
        if marker in JPEG_BARE:
            at += 2
            continue
        if marker in JPEG_FRAMES:
            height, width = struct.unpack_from(">HH", data, at + 5)
            return width, height
        at += 2 + int(struct.unpack_from(">H", data, at + 2)[0])
    return None


def tiff_fields(data: bytes) -> Iterator[tuple[int, str, int]]:
    """Yield tag, format and place of each field of whole numbers in a TIFF's first directory."""
    order = "<" if data[:2] == b"II" else ">"
    (at,) = struct.unpack_from(f"{order}I", data, 4)
    (count,) = struct.unpack_from(f"{order}H", data, at)
    for i in range(count):
        place = at + 2 + 12 * i
        tag, kind, value_count = struct.unpack_from(f"{order}HHI", data, place)
        if kind not in TIFF_TYPES:
            continue
        form, place = f"{order}{value_count}{TIFF_TYPES[kind]}", place + 8
        if struct.calcsize(form) > 4:  # the field has their place then
            (place,) = struct.unpack_from(f"{order}I", data, place)
        yield tag, form, place


def _of_tiff(data: bytes) -> tuple[int, int] | None:
    found: dict[int, int] = {}
    for tag, form, place in tiff_fields(data):
        if tag in (TIFF_WIDTH, TIFF_HEIGHT):
            (found[tag],) = struct.unpack_from(form[0] + form[-1], data, place)  # the first value
    if len(found) < 2:
        return None
    return found[TIFF_WIDTH], found[TIFF_HEIGHT]


def _of_bmp(data: bytes) -> tuple[int, int]:
    (head,) = struct.unpack_from("<I", data, 14)
    if head == 12:  # the oldest header has sizes of 16 bits
        width, height = struct.unpack_from("<HH", data, 18)
        return width, height
    width, height = struct.unpack_from("<ii", data, 18)
    return abs(width), abs(height)  # a negative height: the top row comes first


def _of_webp(data: bytes) -> tuple[int, int] | None:
    kind = data[12:16]
    if kind == b"VP8X":
        width = int.from_bytes(data[24:27], "little") + 1
        return width, int.from_bytes(data[27:30], "little") + 1
    if kind == b"VP8L":
        bits = int.from_bytes(data[21:25], "little")
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", data, 26)
        return width & 0x3FFF, height & 0x3FFF
    return None
