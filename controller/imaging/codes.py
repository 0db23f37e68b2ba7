"""Codes in a picture: QR codes and Data Matrices, found and read by zxing-cpp (ADR 129).

A picture is read several times, each time prepared otherwise: a code of few pixels a module wants a
larger picture, marks that stand apart as dots want a softer one, and what is dim or uneven wants
its contrast levelled. Both symbologies correct their errors and check the result.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Final, Literal

import cv2
import numpy as np

from controller.arrays import FloatArray, Grey

CodeKind = Literal["data_matrix", "qr"]

# Least width of a module in a picture: from here on more than nine in ten are read (ADR 129).
MIN_MODULE_PX: Final = 3.0
# Contrast is levelled over this distance, a standard deviation: about the width of a code.
LEVELLED_PX: Final = 24.0
FLAT_GREY: Final = 2.0  # where a picture varies less, there is noise to level and nothing else
# How a picture is prepared: standard deviation of its smoothing [px], None for one that is not
# levelled either; enlargement; whether one threshold is taken for all of it. Each reads codes that
# the others do not; dots are read where smoothing closes the gaps between them.
PASSES: Final[tuple[tuple[float | None, int, bool], ...]] = (
    (None, 3, False),
    (0.7, 3, False),
    (0.7, 1, True),
    (1.2, 1, True),
    (2.0, 1, True),
    (2.0, 1, False),
    (3.0, 1, False),
)
SAME_PLACE: Final = 0.5  # two readings of one text are one code within this share of its width

_GS1_FIELD: Final = re.compile(r"\((\d{2,4})\)([^(]*)")
_ISO15434: Final = re.compile(r"\[\)>\x1e06\x1d(.*)\x1e\x04", re.DOTALL)
_DATA_FIELD: Final = re.compile(r"(\d{0,3}[A-Z])(.*)", re.DOTALL)
NO_FIELDS: Final[Mapping[str, str]] = MappingProxyType({})


@dataclass(frozen=True, slots=True, eq=False)
class Code:
    """A code that was read.

    Attributes
    ----------
    kind : symbology
    text : content, as people read it; signs that cannot be printed have names, as ``<GS>``
    corners_px : (4, 2) corners of the symbol, in turn
    fields : content by GS1 application identifier (``21``) or ISO 15434 data identifier (``S``)
    """

    kind: CodeKind
    text: str
    corners_px: FloatArray
    fields: Mapping[str, str] = field(default_factory=lambda: NO_FIELDS)

    @property
    def centre_px(self) -> FloatArray:
        """Its middle, (2,)."""
        middle: FloatArray = self.corners_px.mean(axis=0)
        return middle

    @property
    def width_px(self) -> float:
        """The mean length of its edges."""
        edges = np.roll(self.corners_px, -1, axis=0) - self.corners_px
        return float(np.linalg.norm(edges, axis=1).mean())


def can_read_codes() -> bool:
    """Return whether the library that reads codes is installed."""
    from importlib.util import find_spec

    return find_spec("zxingcpp") is not None


def read_codes(picture: Grey, kinds: Sequence[CodeKind]) -> tuple[Code, ...]:
    """Return the codes in a picture, each once.

    Parameters
    ----------
    picture : (height, width)
    kinds : symbologies to look for

    Raises
    ------
    ModuleNotFoundError : the library is not installed (`can_read_codes`)
    """
    import zxingcpp

    formats = {
        "data_matrix": zxingcpp.BarcodeFormat.DataMatrix,
        "qr": zxingcpp.BarcodeFormat.QRCode,
    }
    kind_of = {formats[kind]: kind for kind in kinds}
    found: list[Code] = []
    for prepared, scale, has_one_level in _prepared(picture):
        way = zxingcpp.Binarizer.GlobalHistogram if has_one_level else None
        for read in zxingcpp.read_barcodes(
            prepared,
            formats=zxingcpp.BarcodeFormats(list(kind_of)),
            binarizer=way or zxingcpp.Binarizer.LocalAverage,
        ):
            code = _code(read, kind_of[read.format.symbology], scale)
            if not any(_is_same(code, known) for known in found):
                found.append(code)
    return tuple(found)


def _prepared(picture: Grey) -> Iterator[tuple[Grey, int, bool]]:
    levelled = _levelled(picture)
    for sigma_px, scale, has_one_level in PASSES:
        image = picture if sigma_px is None else cv2.GaussianBlur(levelled, (0, 0), sigma_px)
        if scale > 1:
            image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
        yield np.ascontiguousarray(image, np.uint8), scale, has_one_level


def _levelled(picture: Grey) -> Grey:
    """Return a picture of the same mean and contrast everywhere."""
    grey = picture.astype(np.float32)
    off = grey - cv2.GaussianBlur(grey, (0, 0), LEVELLED_PX)
    spread = np.sqrt(cv2.GaussianBlur(off * off, (0, 0), LEVELLED_PX))
    return np.clip(128.0 + 55.0 * off / np.maximum(spread, FLAT_GREY), 0, 255).astype(np.uint8)


def _code(read: Any, kind: CodeKind, scale: int) -> Code:  # noqa: ANN401 (zxing's result)
    place = read.position
    turn = (place.top_left, place.top_right, place.bottom_right, place.bottom_left)
    corners = np.array([(one.x, one.y) for one in turn], float)
    raw = bytes(read.bytes).decode("utf-8", errors="replace")
    is_gs1 = read.content_type.name == "GS1"
    text = read.text if is_gs1 else printable(raw)
    fields = fields_of_gs1(read.text) if is_gs1 else fields_of_iso15434(raw)
    # the middle of the first pixel is at 0, in either picture
    return Code(kind, text, (corners + 0.5) / scale - 0.5, fields)


def _is_same(one: Code, other: Code) -> bool:
    apart_px = float(np.linalg.norm(one.centre_px - other.centre_px))
    return one.text == other.text and apart_px <= SAME_PLACE * max(one.width_px, other.width_px)


_NAMED: Final = {"\x1d": "<GS>", "\x1e": "<RS>", "\x04": "<EOT>"}


def printable(text: str) -> str:
    """Return a text with names in place of signs that cannot be printed."""
    return "".join(
        one if one.isprintable() else _NAMED.get(one, f"<{ord(one):02X}>") for one in text
    )


def fields_of_gs1(text: str) -> Mapping[str, str]:
    """Return the fields of a GS1 code by application identifier, from ``(01)0401..(21)A1``."""
    return dict(_GS1_FIELD.findall(text))


def fields_of_iso15434(raw: str) -> Mapping[str, str]:
    """Return the fields of an envelope of ISO 15434, format 06, by data identifier."""
    envelope = _ISO15434.fullmatch(raw)
    if envelope is None:
        return NO_FIELDS
    found = (_DATA_FIELD.fullmatch(one) for one in envelope.group(1).split("\x1d"))
    return {one.group(1): one.group(2) for one in found if one is not None}
