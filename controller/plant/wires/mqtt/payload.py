"""Payloads of Sparkplug B, as bytes: the fields that are used here, and nothing else.

Source: Sparkplug 3.0.0, 6.4 (Eclipse Foundation, 2022): numbers of fields and types of data;
Protocol Buffers' encoding: varints, 64-bit values and strings with their length. A decoder that
nobody here wrote reads what this writes (tests/plant/test_sparkplug_stranger.py).
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

Value = bool | int | float | str | None

# What a command may have: a rebirth is one metric of some 40 bytes.
MAX_BYTES: Final = 65_536
MAX_METRICS: Final = 100
MAX_VARINT_BYTES: Final = 10


class PayloadError(ValueError):
    """The bytes are no payload."""


class DataType(IntEnum):
    """Types of data: Sparkplug 3.0.0, 6.4.16."""

    INT32 = 3
    INT64 = 4
    DOUBLE = 10
    BOOLEAN = 11
    STRING = 12
    DATE_TIME = 13


@dataclass(frozen=True, slots=True)
class Metric:
    """A named value.

    Attributes
    ----------
    name : None where the alias stands for it
    at_ms : when the value came about, UTC [ms since 1970]
    kind : None where the birth has said it, or where it is none that is used here
    value : None is null
    """

    name: str | None
    alias: int | None
    at_ms: int | None
    kind: DataType | None
    value: Value
    is_historical: bool = False


@dataclass(frozen=True, slots=True)
class SparkplugPayload:
    """A message's content; `seq` is None in commands and in NDEATH."""

    at_ms: int | None
    seq: int | None
    metrics: tuple[Metric, ...]


def encode(payload: SparkplugPayload) -> bytes:
    """Return the bytes of a payload."""
    parts: list[bytes] = []
    if payload.at_ms is not None:
        parts.append(_number(1, payload.at_ms))
    parts += [_bytes(2, _metric(metric)) for metric in payload.metrics]
    if payload.seq is not None:
        parts.append(_number(3, payload.seq))
    return b"".join(parts)


def _metric(metric: Metric) -> bytes:
    parts: list[bytes] = []
    if metric.name is not None:
        parts.append(_bytes(1, metric.name.encode()))
    if metric.alias is not None:
        parts.append(_number(2, metric.alias))
    if metric.at_ms is not None:
        parts.append(_number(3, metric.at_ms))
    if metric.kind is not None:
        parts.append(_number(4, metric.kind))
    if metric.is_historical:
        parts.append(_number(5, 1))
    parts.append(_number(7, 1) if metric.value is None else _value(metric))
    return b"".join(parts)


def _value(metric: Metric) -> bytes:
    value = metric.value
    match metric.kind:
        case DataType.INT32:
            return _number(10, int(value or 0) & 0xFFFF_FFFF)
        case DataType.INT64 | DataType.DATE_TIME:
            return _number(11, int(value or 0) & 0xFFFF_FFFF_FFFF_FFFF)
        case DataType.DOUBLE:
            return _key(13, 1) + struct.pack("<d", value)
        case DataType.BOOLEAN:
            return _number(14, int(bool(value)))
        case DataType.STRING:
            return _bytes(15, str(value).encode())
        case None:
            raise ValueError(f"{metric.name}: a value without its type")


def _varint(number: int) -> bytes:
    found = bytearray()
    while number > 0x7F:
        found.append(number & 0x7F | 0x80)
        number >>= 7
    found.append(number)
    return bytes(found)


def _key(field: int, wire: int) -> bytes:
    return _varint(field << 3 | wire)


def _number(field: int, number: int) -> bytes:
    return _key(field, 0) + _varint(number)


def _bytes(field: int, data: bytes) -> bytes:
    return _key(field, 2) + _varint(len(data)) + data


def decode(data: bytes) -> SparkplugPayload:
    """Return what bytes from outside say.

    Raises
    ------
    PayloadError : they are no payload, or more than a command may have
    """
    if len(data) > MAX_BYTES:
        raise PayloadError(f"{len(data)} bytes; a command has at most {MAX_BYTES}")
    at_ms: int | None = None
    seq: int | None = None
    metrics: list[Metric] = []
    for field, value in _fields(data):
        if field == 1 and isinstance(value, int):
            at_ms = value
        elif field == 2 and isinstance(value, bytes):
            if len(metrics) == MAX_METRICS:
                raise PayloadError(f"more than {MAX_METRICS} metrics")
            metrics.append(_decode_metric(value))
        elif field == 3 and isinstance(value, int):
            seq = value
    return SparkplugPayload(at_ms, seq, tuple(metrics))


def _decode_metric(data: bytes) -> Metric:
    known = dict(_fields(data))
    name = _text(known[1]) if 1 in known else None
    number = known.get(4)
    kind = DataType(number) if isinstance(number, int) and number in set(DataType) else None
    alias, at_ms = known.get(2), known.get(3)
    return Metric(
        name,
        alias if isinstance(alias, int) else None,
        at_ms if isinstance(at_ms, int) else None,
        kind,
        None if known.get(7) else _decode_value(known),
        bool(known.get(5)),
    )


def _decode_value(known: dict[int, int | bytes]) -> Value:
    if isinstance(number := known.get(10), int):
        return number - (1 << 32) if number >= 1 << 31 else number
    if isinstance(number := known.get(11), int):
        return number - (1 << 64) if number >= 1 << 63 else number
    if isinstance(raw := known.get(13), bytes) and len(raw) == 8:
        return float(struct.unpack("<d", raw)[0])
    if isinstance(number := known.get(14), int):
        return bool(number)
    return _text(known[15]) if 15 in known else None


def _text(value: int | bytes) -> str:
    if not isinstance(value, bytes):
        raise PayloadError("a number where a text belongs")
    try:
        return value.decode()
    except UnicodeDecodeError as error:
        raise PayloadError("a text that is not UTF-8") from error


def _fields(data: bytes) -> Iterator[tuple[int, int | bytes]]:
    """Yield number and content of each field; what has its own length is skipped by the caller."""
    at = 0
    while at < len(data):
        key, at = _read_varint(data, at)
        wire = key & 7
        if wire == 0:
            number, at = _read_varint(data, at)
            yield key >> 3, number
            continue
        if wire == 2:
            size, at = _read_varint(data, at)
        elif wire in (1, 5):
            size = 8 if wire == 1 else 4
        else:
            raise PayloadError(f"wire type {wire}")
        if size > len(data) - at:
            raise PayloadError("cut off")
        yield key >> 3, data[at : at + size]
        at += size


def _read_varint(data: bytes, at: int) -> tuple[int, int]:
    number = 0
    for index, byte in enumerate(data[at : at + MAX_VARINT_BYTES]):
        number |= (byte & 0x7F) << (7 * index)
        if byte < 0x80:
            return number & 0xFFFF_FFFF_FFFF_FFFF, at + index + 1
    raise PayloadError("cut off, or a number of more than 64 bits")
