"""Control packets: requests in, acknowledges out; docs/protocols/gige_vision.md 1.

Bytes alone: no registers, no socket. A datagram that is no request at all is None, which a camera
passes over in silence.
"""

from dataclasses import dataclass
from enum import IntEnum
from struct import Struct
from typing import Final

PORT: Final = 3956
_KEY: Final = 0x42
_ACK_REQUIRED: Final = 1 << 0
_HEADER: Final = Struct(">BBHHH")  # key or status' high byte, flags, command, length, request id
_ACK: Final = Struct(">HHHH")  # status, acknowledge, length, request id
_WORD: Final = Struct(">I")
_WRITE: Final = Struct(">II")
_RANGE: Final = Struct(">IHH")  # address, reserved, count
_INDEX: Final = Struct(">HH")  # reserved, number of writes done
_RESEND: Final = Struct(">HHII")  # stream channel, block id, first and last packet id
_PACKET_ID_MASK: Final = 0xFF_FFFF
MEMORY_BYTES_MAX: Final = 536  # of one READMEM or WRITEMEM


class Command(IntEnum):
    """Requests that are answered; an acknowledge has the number that follows."""

    DISCOVERY = 0x0002
    PACKETRESEND = 0x0040
    READREG = 0x0080
    WRITEREG = 0x0082
    READMEM = 0x0084
    WRITEMEM = 0x0086


class Status(IntEnum):
    """Codes of an acknowledge."""

    SUCCESS = 0x0000
    NOT_IMPLEMENTED = 0x8001
    INVALID_PARAMETER = 0x8002
    INVALID_ADDRESS = 0x8003
    WRITE_PROTECT = 0x8004
    BAD_ALIGNMENT = 0x8005
    ACCESS_DENIED = 0x8006
    BUSY = 0x8007
    INVALID_HEADER = 0x800E


class Refused(Exception):  # noqa: N818  (no fault: an answer of the camera)
    """The camera says no.

    Parameters
    ----------
    status : its code
    done_count : writes of the request done before this one
    """

    def __init__(self, status: Status, done_count: int = 0) -> None:
        super().__init__(status.name)
        self.status, self.done_count = status, done_count


@dataclass(frozen=True, slots=True)
class Request:
    """A request as it came.

    Attributes
    ----------
    command : its number, perhaps none of `Command`
    number : the number by which its acknowledge is known
    wants_answer : whether the sender waits for an acknowledge
    body : what follows the header
    """

    command: int
    number: int
    wants_answer: bool
    body: bytes


def read_request(datagram: bytes) -> Request | None:
    """Return the request in a datagram; None if it is none."""
    if len(datagram) < _HEADER.size:
        return None
    key, flags, command, length, number = _HEADER.unpack_from(datagram)
    body = datagram[_HEADER.size :]
    if key != _KEY or length != len(body) or number == 0:
        return None
    return Request(command, number, bool(flags & _ACK_REQUIRED), body)


def acknowledge(request: Request, body: bytes = b"", status: Status = Status.SUCCESS) -> bytes:
    """Return the acknowledge of a request.

    Parameters
    ----------
    request : request as it came
    body : what follows the header
    status : how it ended
    """
    return _ACK.pack(status, request.command + 1, len(body), request.number) + body


def addresses_of(body: bytes) -> list[int]:
    """Return the addresses of a READREG.

    Raises
    ------
    Refused : none, or not whole words
    """
    if not body or len(body) % _WORD.size:
        raise Refused(Status.INVALID_HEADER)
    return [word for (word,) in _WORD.iter_unpack(body)]


def writes_of(body: bytes) -> list[tuple[int, int]]:
    """Return address and value of each write of a WRITEREG.

    Raises
    ------
    Refused : none, or not whole pairs
    """
    if not body or len(body) % _WRITE.size:
        raise Refused(Status.INVALID_HEADER)
    return list(_WRITE.iter_unpack(body))


def range_of(body: bytes) -> tuple[int, int]:
    """Return address and count [bytes] of a READMEM.

    Raises
    ------
    Refused : another length, or more than a packet takes
    """
    if len(body) != _RANGE.size:
        raise Refused(Status.INVALID_HEADER)
    address, _, count = _RANGE.unpack(body)
    if not 0 < count <= MEMORY_BYTES_MAX:
        raise Refused(Status.INVALID_PARAMETER)
    return address, count


def memory_of(body: bytes) -> tuple[int, bytes]:
    """Return address and bytes of a WRITEMEM.

    Raises
    ------
    Refused : no bytes, or more than a packet takes
    """
    if not _WORD.size < len(body) <= _WORD.size + MEMORY_BYTES_MAX:
        raise Refused(Status.INVALID_HEADER)
    return _WORD.unpack_from(body)[0], body[_WORD.size :]


def resend_of(body: bytes) -> tuple[int, int, int]:
    """Return block, first and last packet of a PACKETRESEND.

    Raises
    ------
    Refused : another length, or another stream channel than the first
    """
    if len(body) != _RESEND.size:
        raise Refused(Status.INVALID_HEADER)
    channel, block, first, last = _RESEND.unpack(body)
    if channel != 0:
        raise Refused(Status.INVALID_PARAMETER)
    return block, first & _PACKET_ID_MASK, last & _PACKET_ID_MASK


def words(values: list[int]) -> bytes:
    """Return the body of a READREG's acknowledge."""
    return b"".join(_WORD.pack(value) for value in values)


def memory(address: int, data: bytes) -> bytes:
    """Return the body of a READMEM's acknowledge."""
    return _WORD.pack(address) + data


def written(count: int) -> bytes:
    """Return the body of a WRITEREG's or WRITEMEM's acknowledge: writes or bytes done."""
    return _INDEX.pack(0, count)
