"""RTDE, version 2: packages of the controller's state (§2). Bytes in, values out.

Sections (§) are those of ur.md.
"""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from drivers.errors import BadReplyError
from messages import say

__all__ = [
    "OPTIONAL_FIELDS",
    "REQUIRED_FIELDS",
    "Package",
    "PackageReader",
    "PackageType",
    "Recipe",
    "decode_accepted",
    "decode_recipe",
    "decode_text",
    "decode_version",
    "encode_outputs",
    "encode_request",
    "encode_version",
]

PROTOCOL_VERSION: Final = 2
HEADER: Final = struct.Struct(">HB")  # §2.1: size with the header, type
NOT_FOUND: Final = "NOT_FOUND"  # §2.2
IN_USE: Final = "IN_USE"  # §2.2

# §2.3; all that the driver decides by
REQUIRED_FIELDS: Final = (
    "timestamp",
    "actual_q",
    "actual_qd",
    "robot_mode",
    "safety_mode",
    "runtime_state",
    "speed_scaling",
    "target_speed_fraction",
)
# read back where the controller has them: from 5.10 or so
OPTIONAL_FIELDS: Final = ("payload", "payload_cog", "tcp_offset")

# §2.3: name of a type -> one value in struct's words, and how many
_TYPES: Final[Mapping[str, tuple[str, int]]] = {
    "BOOL": ("?", 1),
    "UINT8": ("B", 1),
    "UINT32": ("I", 1),
    "UINT64": ("Q", 1),
    "INT32": ("i", 1),
    "DOUBLE": ("d", 1),
    "VECTOR3D": ("d", 3),
    "VECTOR6D": ("d", 6),
    "VECTOR6INT32": ("i", 6),
    "VECTOR6UINT32": ("I", 6),
}


class PackageType(IntEnum):
    """Type of a package (§2.1): an ASCII letter."""

    VERSION = ord("V")
    CONTROLLER = ord("v")
    TEXT = ord("M")
    DATA = ord("U")
    OUTPUTS = ord("O")
    INPUTS = ord("I")
    START = ord("S")
    PAUSE = ord("P")


@dataclass(frozen=True, slots=True)
class Package:
    """A package without its header."""

    type: PackageType
    payload: bytes


class PackageReader:
    """Cuts the stream into packages."""

    def __init__(self) -> None:
        self._data = bytearray()

    def feed(self, data: bytes) -> list[Package]:
        """Return the packages that are whole now.

        Raises
        ------
        BadReplyError : a size or type that the guide forbids
        """
        self._data += data
        packages = []
        while len(self._data) >= HEADER.size:
            size, kind = HEADER.unpack_from(self._data)
            if size < HEADER.size or kind not in PackageType.__members__.values():
                raise BadReplyError(
                    say(
                        "arm: not RTDE: {bytes}; is this the port of RTDE?",
                        bytes=bytes(self._data[:16]).hex(" "),
                    )
                )
            if len(self._data) < size:
                break
            payload = bytes(self._data[HEADER.size : size])
            packages.append(Package(PackageType(kind), payload))
            del self._data[:size]
        return packages


@dataclass(frozen=True, slots=True)
class Recipe:
    """The fields of a data package, in their order.

    Attributes
    ----------
    number : the controller's number for it
    names, types : name and type of each field
    """

    number: int
    names: tuple[str, ...]
    types: tuple[str, ...]

    @property
    def missing(self) -> tuple[str, ...]:
        """Names that the controller does not have."""
        pairs = zip(self.names, self.types, strict=True)
        return tuple(name for name, kind in pairs if kind == NOT_FOUND)

    def unpack(self, payload: bytes) -> dict[str, float | tuple[float, ...]]:
        """Return the values of a data package by name.

        Raises
        ------
        BadReplyError : it is of another recipe, or not as long as this one
        """
        codes = [_TYPES[kind] for kind in self.types]
        layout = struct.Struct(">B" + "".join(code * count for code, count in codes))
        if len(payload) != layout.size or payload[0] != self.number:
            raise BadReplyError(
                say(
                    "arm: RTDE data of {payload_count} bytes, {size} expected: {payload}",
                    payload_count=len(payload),
                    size=layout.size,
                    payload=payload[:16].hex(" "),
                )
            )
        values = layout.unpack(payload)[1:]
        found: dict[str, float | tuple[float, ...]] = {}
        for name, (_, count) in zip(self.names, codes, strict=True):
            found[name] = values[0] if count == 1 else values[:count]
            values = values[count:]
        return found


def encode_request(kind: PackageType, payload: bytes = b"") -> bytes:
    """Return a package."""
    return HEADER.pack(HEADER.size + len(payload), kind) + payload


def encode_version() -> bytes:
    """Return the request for protocol version 2 (§2.2)."""
    return encode_request(PackageType.VERSION, struct.pack(">H", PROTOCOL_VERSION))


def encode_outputs(frequency_hz: float, names: Sequence[str]) -> bytes:
    """Return the request for data packages with these fields (§2.2)."""
    payload = struct.pack(">d", frequency_hz) + ",".join(names).encode("ascii")
    return encode_request(PackageType.OUTPUTS, payload)


def decode_accepted(payload: bytes) -> bool:
    """Return whether a version, a start or a pause was accepted (§2.2).

    Raises
    ------
    BadReplyError : not one byte
    """
    if len(payload) != 1:
        raise BadReplyError(
            say("arm: RTDE: one byte expected, not {payload}", payload=payload[:16].hex(" "))
        )
    return payload[0] == 1


def decode_version(payload: bytes) -> tuple[int, int, int, int]:
    """Return the controller's version: major, minor, bugfix, build (§2.2).

    Raises
    ------
    BadReplyError : not four numbers
    """
    if len(payload) != 16:
        raise BadReplyError(
            say("arm: RTDE: a version expected, not {payload}", payload=payload[:16].hex(" "))
        )
    major, minor, bugfix, build = struct.unpack(">IIII", payload)
    return major, minor, bugfix, build


def decode_recipe(payload: bytes, names: Sequence[str]) -> Recipe:
    """Return the recipe of a request for outputs (§2.2).

    Raises
    ------
    BadReplyError : another number of types than of names, or a type that is not in the guide
    """
    types = tuple(payload[1:].decode("ascii", "replace").strip().split(","))
    known = _TYPES.keys() | {NOT_FOUND, IN_USE}
    if not payload or len(types) != len(names) or not known.issuperset(types):
        raise BadReplyError(
            say(
                "arm: RTDE: types of {names_count} fields expected, not {payload}",
                names_count=len(names),
                payload=repr(payload),
            )
        )
    return Recipe(payload[0], tuple(names), types)


def decode_text(payload: bytes) -> str:
    """Return the words of a text message: what, and from where (§2.1)."""
    words, rest = _text(payload)
    source, _ = _text(rest)
    return say("{words} ({source})", words=words, source=source) if source else words


def _text(data: bytes) -> tuple[str, bytes]:
    if not data:
        return "", b""
    end = 1 + data[0]
    return data[1:end].decode("utf-8", "replace").strip(), data[end:]
