"""The check that a picture file is complete, for formats whose decoders do not check it.

PNG: the checksum of every chunk, and of the pixels when unpacked (ISO/IEC 15948, 5.3 and 10.1).
TIFF, BMP, PGM and PPM, WebP: as many bytes as the header promises; they have no checksums, so a
changed byte among the pixels shows in none of them.
"""

import re
import struct
import zlib
from collections.abc import Callable
from typing import Final

from messages import key, say

from ._header import NETPBM, PNG_BEGIN, TIFF_HEIGHT, TIFF_WIDTH, size_in_header, tiff_fields

# bits a pixel by colour type: ISO/IEC 15948, 11.2.2 (channels times the bit depth)
_PNG_CHANNELS: Final = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
_PNG_PIECE_BYTES: Final = 1 << 20  # bytes unpacked at a time, so that a small file fills no memory
# TIFF 6.0, section 8: where the strips or tiles are, and what a pixel is
_TIFF_BITS, _TIFF_COMPRESSION, _TIFF_SAMPLES = 258, 259, 277
_TIFF_PLACES: Final = ((273, 279), (324, 325))  # offsets and byte counts of strips, of tiles
_TIFF_UNCOMPRESSED: Final = 1
_BMP_RAW: Final = (0, 3)  # codes of uncompressed pictures: plain, and with masks of the channels
_PLAIN_NUMBER: Final = re.compile(rb"#[^\n]*\n|(\d+)")


class BrokenPictureError(ValueError):
    """The bytes are not one whole picture."""


def check_whole(data: bytes) -> None:
    """Check that a file other than a JPEG has all its bytes.

    Raises
    ------
    BrokenPictureError : it has not, or a checksum is wrong
    """
    try:
        _checker(data)(data)
    except (struct.error, IndexError, KeyError, zlib.error) as error:
        raise BrokenPictureError(say("is cut off or damaged ({error})", error=error)) from error


def _checker(data: bytes) -> Callable[[bytes], None]:
    if data.startswith(PNG_BEGIN):
        return _check_png
    if data[:2] in (b"II", b"MM"):
        return _check_tiff
    if data.startswith(b"BM"):
        return _check_bmp
    return _check_webp if data.startswith(b"RIFF") else _check_netpbm


def _expect(there: int, needed: int, what: str) -> None:
    if there < needed:
        raise BrokenPictureError(
            say(
                "is cut off or damaged: {what} {there} bytes of {needed}",
                what=what,
                there=there,
                needed=needed,
            )
        )


def _check_png(data: bytes) -> None:
    at, packed = len(PNG_BEGIN), bytearray()
    name = b""
    while name != b"IEND":
        length, name = struct.unpack_from(">I4s", data, at)
        end = at + 8 + length
        (checksum,) = struct.unpack_from(">I", data, end)
        if zlib.crc32(data[at + 4 : end]) != checksum:
            raise BrokenPictureError(
                say(
                    "is cut off or damaged: the checksum of the PNG chunk at byte {at} is wrong",
                    at=at,
                )
            )
        if name == b"IDAT":
            packed += data[at + 8 : end]
        at = end + 4
    width, height, bits, colour, _, _, interlace = struct.unpack_from(">IIBBBBB", data, 16)
    needed = height * (1 + (width * bits * _PNG_CHANNELS[colour] + 7) // 8)
    unpacking, got, rest = zlib.decompressobj(), 0, bytes(packed)
    while rest and not unpacking.eof and got <= 2 * needed:
        got += len(unpacking.decompress(rest, _PNG_PIECE_BYTES))
        rest = unpacking.unconsumed_tail
    if not unpacking.eof or (not interlace and got != needed):
        raise BrokenPictureError(
            say(
                "is cut off or damaged: its pixels unpack to {got} bytes of {needed}",
                got=got,
                needed=needed,
            )
        )


def _check_bmp(data: bytes) -> None:
    (first, head) = struct.unpack_from("<II", data, 10)
    size = size_in_header(data)
    assert size is not None
    if head == 12:
        (bits,), compression = struct.unpack_from("<H", data, 24), 0
    else:
        bits, compression = struct.unpack_from("<HI", data, 28)
    if compression not in _BMP_RAW:
        raise BrokenPictureError(key("is a compressed BMP; store it as PNG"))
    _expect(len(data) - first, (size[0] * bits + 31) // 32 * 4 * size[1], "BMP pixels take")


def _check_webp(data: bytes) -> None:
    (length,) = struct.unpack_from("<I", data, 4)
    _expect(len(data), 8 + length, "WebP has")


def _check_netpbm(data: bytes) -> None:
    match = NETPBM.match(data[:1024])
    assert match is not None, "by its header"
    kind, count = data[1:2], int(match[1]) * int(match[2])
    if kind in b"36":
        count *= 3
    if kind in b"123":
        digits = (len(one[1]) for one in _PLAIN_NUMBER.finditer(data, match.end()) if one[1])
        # those of a PBM need no blanks between them; the others' first number is the largest level
        there = sum(digits) if kind == b"1" else sum(1 for _ in digits) - 1
        if there < count:
            raise BrokenPictureError(
                say("is cut off or damaged: {there} levels of {count}", there=there, count=count)
            )
        return
    if kind == b"4":
        _expect(len(data) - match.end(), (int(match[1]) + 7) // 8 * int(match[2]), "PBM rows take")
        return
    largest = re.compile(rb"(?:\s|#[^\n]*\n)*(\d+)\s").match(data, match.end() - 1)
    if largest is None:
        raise BrokenPictureError(key("is cut off or damaged: no largest level in its header"))
    count *= 2 if int(largest[1]) > 255 else 1
    _expect(len(data) - largest.end(), count, "PGM or PPM levels take")


def _check_tiff(data: bytes) -> None:
    fields: dict[int, tuple[int, ...]] = {}
    for tag, form, place in tiff_fields(data):
        _expect(len(data) - place, struct.calcsize(form), say("TIFF field {tag} takes", tag=tag))
        fields[tag] = struct.unpack_from(form, data, place)
    stored = 0
    for offsets, lengths in _TIFF_PLACES:
        if len(fields.get(offsets, ())) != len(fields.get(lengths, ())):
            raise BrokenPictureError(key("is cut off or damaged: a TIFF with strips of no length"))
        for begin, length in zip(fields.get(offsets, ()), fields.get(lengths, ()), strict=True):
            _expect(
                len(data) - begin, length, say("the TIFF strip at byte {begin} has", begin=begin)
            )
            stored += length
    needed = 1
    if fields.get(_TIFF_COMPRESSION, (_TIFF_UNCOMPRESSED,))[0] == _TIFF_UNCOMPRESSED:
        samples = fields.get(_TIFF_SAMPLES, (1,))[0]
        bits = fields.get(_TIFF_BITS, (1,))[0] * samples
        needed = fields[TIFF_HEIGHT][0] * ((fields[TIFF_WIDTH][0] * bits + 7) // 8)
    _expect(stored, needed, "TIFF strips hold")
