"""Bytes of the UMI RTX line: every request of the reference, and a reader of the replies.

Requests go out as bytes, replies come in as bytes and leave as values: no link, no clock, no log.
Which IP gets a request is the line's business. Sections (§) are those of umi_rtx.md.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from drivers.errors import BadReplyError, PositionLostError, RefusedError, WrongDeviceError
from messages import key, say

from . import constants as c
from .constants import Drive, Ip, Mode, Parameter, Simple, StatusBits


def checksum(value: int) -> int:
    """Return the XOR of the four nibbles of a 16-bit value (§2.2)."""
    word = value & 0xFFFF
    return (word ^ word >> 4 ^ word >> 8 ^ word >> 12) & 0xF


def _word(value: int) -> bytes:
    if not -0x8000 <= value <= 0x7FFF:
        raise ValueError(f"{value} does not fit 16 bits")
    return value.to_bytes(2, "little", signed=True)


def _ctl(ctl: int) -> int:
    if not 0 <= ctl < c.CONTROLLER_COUNT:
        raise ValueError(f"ctl is 0 to {c.CONTROLLER_COUNT - 1}, not {ctl}")
    return ctl


# ---- requests ----------------------------------------------------------------------------------
def encode_simple(command: Simple) -> bytes:
    """Return a one-byte command (§2.3)."""
    return bytes([command])


def encode_controller_status(ctl: int) -> bytes:
    """Return the request for the status of one controller (§2.3)."""
    return bytes([c.CONTROLLER_STATUS + _ctl(ctl)])


def encode_mode(mode: Mode, ctl: int = 0) -> bytes:
    """Return a mode command (§2.4); the user I/O modes concern the whole IP and ignore `ctl`."""
    return bytes([mode, _ctl(ctl), 0x00])


def encode_immediate_read(parameter: Parameter, ctl: int) -> bytes:
    """Return the one-frame read of CP_ERROR or CURRENT_POSITION (§2.5).

    Raises
    ------
    ValueError : the parameter has a deferred read only
    """
    if parameter not in c.IMMEDIATE:
        raise ValueError(f"{parameter.name} takes a deferred read")
    is_error = parameter is Parameter.CP_ERROR
    return bytes([(c.READ_CP_ERROR if is_error else c.READ_CURRENT_POSITION) + _ctl(ctl)])


def encode_immediate_write(ctl: int, counts: int) -> bytes:
    """Return the one-frame write of CURRENT_POSITION: a label, no motion (§2.5)."""
    return bytes([c.WRITE_CURRENT_POSITION + _ctl(ctl)]) + _word(counts)


def _deferred(parameter: Parameter) -> int:
    if parameter in c.IMMEDIATE:
        raise ValueError(f"{parameter.name} has no deferred access that is known to work")  # §9.14
    return parameter


def encode_deferred_read(parameter: Parameter, ctl: int) -> tuple[bytes, bytes]:
    """Return both frames of the read of any other parameter (§2.5); always send both."""
    select = bytes([c.SELECT_READ, _deferred(parameter), c.FILLER])
    return select, bytes([c.DEFERRED_READ + _ctl(ctl)])


def encode_deferred_write(parameter: Parameter, ctl: int, value: int) -> tuple[bytes, bytes]:
    """Return both frames of the write of any other parameter (§2.5); always send both.

    Parameters
    ----------
    parameter : any but the read-only ones
    ctl : the controller on its IP, 0 to 4
    value : in the parameter's own units, a signed word

    Raises
    ------
    ValueError : read-only, no deferred parameter, or it does not fit into a word
    """
    if parameter in c.READ_ONLY:
        raise ValueError(f"{parameter.name} is read-only")
    select = bytes([c.SELECT_WRITE, _deferred(parameter), c.FILLER])
    return select, bytes([c.DEFERRED_WRITE + _ctl(ctl)]) + _word(value)


def encode_manual_go(drives: Mapping[int, Drive]) -> bytes:
    """Return a manual go from ctl to drive (§2.6); a ctl that is not named holds."""
    word = 0
    for ctl, drive in drives.items():
        word |= drive << 2 * _ctl(ctl)
    return bytes([c.MANUAL_GO, word & 0xFF, word >> 8])


def encode_numeric_go(ctls: Iterable[int]) -> bytes:
    """Return the command that starts these controllers towards their NEW_POSITION (§2.7).

    Raises
    ------
    ValueError : no controller is named
    """
    mask = 0
    for ctl in ctls:
        mask |= 1 << _ctl(ctl)
    if not mask:
        raise ValueError("a numeric go of no controller")
    return bytes([c.NUMERIC_GO | mask])


def encode_interpolation(increments: Mapping[int, int]) -> bytes:
    """Return one interpolation step, ctl to increment of -8 to 7 counts (§2.7); untried (§9.2).

    Raises
    ------
    ValueError : an increment is outside -8 to 7 counts
    """
    nibbles = [0] * c.CONTROLLER_COUNT
    for ctl, increment in increments.items():
        if not -8 <= increment <= 7:
            raise ValueError(f"an increment is -8 to 7 counts, not {increment}")
        nibbles[_ctl(ctl)] = increment & 0xF
    n0, n1, n2, n3, grasp = nibbles
    return bytes([c.INTERPOLATION | grasp, n1 << 4 | n0, n3 << 4 | n2])


def request_length(opcode: int) -> int:
    """Return the length in bytes of a request that begins with `opcode`: 1 or 3 (§2.1)."""
    if opcode < 0x40:
        return 3 if 0x18 <= opcode <= 0x1D else 1
    if opcode < 0x80:
        return 3 if 0x58 <= opcode <= 0x67 or opcode >= 0x70 else 1
    return 1 if 0xA0 <= opcode <= 0xBF else 3


def is_go(request: bytes) -> bool:
    """Return whether a request is a numeric go (§2.7), which the arm may refuse as busy."""
    return 0xA0 <= request[0] <= 0xBF


def is_query(request: bytes) -> bool:
    """Return whether a one-byte request only reads, and may be sent again (§2.3, §2.5)."""
    opcode = request[0]
    return len(request) == 1 and (
        opcode in (Simple.IDENTIFY, Simple.VERSION)
        or c.CONTROLLER_STATUS <= opcode <= Simple.GENERAL_STATUS
        or c.READ_CP_ERROR <= opcode < 0x50
        or c.DEFERRED_READ <= opcode < c.SELECT_WRITE
    )


# ---- replies -----------------------------------------------------------------------------------
@dataclass(frozen=True, slots=True)
class Acknowledged:
    """Done, or accepted (§2.9 code 00; §2.5 for the first frame of a deferred access)."""


@dataclass(frozen=True, slots=True)
class Identity:
    """The IP that listens (§2.3)."""

    ip: Ip


@dataclass(frozen=True, slots=True)
class Version:
    """ROM of an IP (§2.3); two sources guess the order of the two bytes (§9.4)."""

    ip: Ip
    revision: int
    version: int


@dataclass(frozen=True, slots=True)
class Status:
    """Status of one controller, or of the IP where `ctl` is None (§2.8).

    `third` is the byte that every known driver ignores (§9.3).
    """

    ctl: int | None
    bits: StatusBits
    third: int


@dataclass(frozen=True, slots=True)
class Value:
    """The 16-bit value of a parameter, its checksum verified (§2.5)."""

    value: int


Reply = Acknowledged | Identity | Version | Status | Value

_ACKNOWLEDGED: Final = Acknowledged()
_THREE_BYTE_CLASSES: Final = frozenset({0x1, 0x8, 0xD})  # §2.1
_CLASSES: Final = frozenset({0x0, 0x1, 0x2, 0x8, 0xA, 0xC, 0xD, 0xE, 0xF})  # §2.1


def looks_like_text(data: bytes) -> bool:
    """Return whether bytes are a message in ASCII, as a non-standard ROM sends (§8.7).

    Four characters at least, three of them letters: no reply of the protocol reads like that.
    """
    letter_count = sum(chr(byte).isalpha() for byte in data if byte < 0x80)
    printable = all(0x20 <= byte < 0x7F or byte in b"\r\n\t" for byte in data)
    return printable and len(data) >= 4 and letter_count >= 3


def _expected_classes(request: bytes) -> frozenset[int]:
    """Return the high nibbles, other than 0, that may answer a request (§2.1 to §2.7)."""
    opcode = request[0]
    if opcode in (Simple.GO, Simple.IDENTIFY, Simple.VERSION):
        return frozenset({0x2})
    if opcode in range(c.CONTROLLER_STATUS, 0x18):
        return frozenset({0x1})
    if opcode in range(c.READ_CP_ERROR, 0x50):
        return frozenset({0x8})
    if opcode in range(c.WRITE_CURRENT_POSITION, 0x60):
        return frozenset({0xA})
    deferred = {0x60: 0xC, 0x68: 0xD, 0x70: 0xE, 0x78: 0xF}.get(opcode & 0xF8)
    return frozenset() if deferred is None else frozenset({deferred})


class ReplyReader:
    """Reads the reply to one request, fed in pieces of any size.

    Raises, from `feed`
    -------------------
    PositionLostError : codes 0E, 0F: the IP has restarted (§1.5)
    RefusedError : codes 01 to 0D (§2.9); `code` holds it
    BadReplyError : a reply that does not answer this request, is too long, or whose checksum fails
    WrongDeviceError : the bytes are text: unsupported ROM or monitor mode (§8.7)

    Raises
    ------
    ValueError : the bytes it is made with are no whole request
    """

    def __init__(self, request: bytes) -> None:
        if not request or len(request) != request_length(request[0]):
            raise ValueError(f"not a request: {request.hex(' ')}")
        self._request = request
        self._data = bytearray()

    @property
    def data(self) -> bytes:
        """All bytes fed so far."""
        return bytes(self._data)

    def feed(self, data: bytes) -> Reply | None:
        """Take bytes as they arrive; return the reply, or None for "more bytes, please".

        Raises
        ------
        WrongDeviceError : the answer is text: an unsupported ROM, or its monitor mode
        BadReplyError : bytes that the protocol does not have, or more than are due
        """
        self._data += data
        if not self._data:
            return None
        if looks_like_text(self.data):
            raise WrongDeviceError(
                say(
                    "unsupported ROM or monitor mode: it answers in text, {data}",
                    data=repr(self.data),
                )
            )
        head = self._data[0]
        if self._request[0] == Simple.RESET and len(self._data) == 1:
            return _ACKNOWLEDGED  # the reply byte of a reset is specified nowhere (§1.5)
        if head >> 4 not in _CLASSES:
            raise self._bad(key("begins with a byte that the protocol does not have"))
        length = 3 if head >> 4 in _THREE_BYTE_CLASSES or self._asks_version(head) else 1
        if len(self._data) < length:
            return None
        if len(self._data) > length:
            raise self._bad(
                say(
                    "has {data_count} bytes where {length} are due",
                    data_count=len(self._data),
                    length=length,
                )
            )
        return self._parse(head)

    def _asks_version(self, head: int) -> bool:
        return self._request[0] == Simple.VERSION and head >> 4 == 0x2

    def _bad(self, what: str) -> BadReplyError:
        return BadReplyError(
            say(
                "the reply {data} to {request} {what}",
                data=self.data.hex(" ").upper(),
                request=self._request.hex(" ").upper(),
                what=what,
            )
        )

    def _parse(self, head: int) -> Reply:
        kind, low = head >> 4, head & 0xF
        if kind == 0 and low:
            raise self._refusal(head)
        expected = _expected_classes(self._request)
        if kind == 0 and (not expected or self._request[0] == Simple.GO):
            return _ACKNOWLEDGED
        if kind not in expected:
            raise self._bad(key("belongs to another kind of request"))
        if kind == 0x1:
            return self._status(head)
        if kind == 0x2:
            return self._identity(head)
        if kind in (0xC, 0xE):
            return _ACKNOWLEDGED
        payload = self._data[1:] if kind in (0x8, 0xD) else self._request[1:]
        value = int.from_bytes(payload, "little", signed=True)
        if low != checksum(value):
            raise self._bad(
                say(
                    "fails its checksum: {checksum:X} belongs to {value}",
                    checksum=checksum(value),
                    value=value,
                )
            )
        return Value(value) if kind in (0x8, 0xD) else _ACKNOWLEDGED

    def _refusal(self, code: int) -> PositionLostError | RefusedError:
        asked = self._request.hex(" ").upper()
        if code in c.RESTARTED_CODES:
            return PositionLostError(
                say(
                    "arm: an IP has restarted (it answers {code:02X} to {asked}): all "
                    "positions are lost; connect and home again",
                    code=code,
                    asked=asked,
                )
            )
        return RefusedError(
            say(
                "arm: {reply_texts} ({code:02X}) in answer to {asked}",
                reply_texts=c.REPLY_TEXTS[code],
                code=code,
                asked=asked,
            ),
            code,
        )

    def _status(self, head: int) -> Status:
        if head != self._request[0]:
            raise self._bad(key("is the status of another controller"))
        ctl = None if head == Simple.GENERAL_STATUS else head - c.CONTROLLER_STATUS
        return Status(ctl, StatusBits(self._data[1]), self._data[2])

    def _identity(self, head: int) -> Identity | Version:
        if head & 0x7 not in (0, 1) or head & 0x8:
            raise self._bad(key("names an IP that an arm does not have"))
        ip = Ip(head & 0x7)
        return Version(ip, self._data[1], self._data[2]) if len(self._data) == 3 else Identity(ip)
