"""The bytes in the place of an answer, in words: an echo, noise, another unit, half a frame.

Bytes in, words out. A complete valid frame is found wherever it is, so that an odd byte before it
does not hide it.
"""

from typing import Final

from messages import key, say

from ._framing import MAX_RTU_SIZE, MBAP_SIZE, MIN_RTU_SIZE, crc16

_EXCEPTION: Final = 0x80


def _rtu_frame_in(received: bytes) -> tuple[int, bytes] | None:
    """Return the start of the first whole frame in the bytes, and the frame."""
    for begin in range(len(received) - MIN_RTU_SIZE + 1):
        # carried on from byte to byte: this runs on the event loop, for as much noise as came
        crc = crc16(received[begin : begin + MIN_RTU_SIZE - 1])
        for end in range(begin + MIN_RTU_SIZE, min(begin + MAX_RTU_SIZE, len(received)) + 1):
            crc = crc16(received[end - 1 : end], crc)
            if crc == 0:
                return begin, received[begin:end]
    return None


def seen_instead(sent: bytes, received: bytes, *, is_tcp: bool) -> tuple[str, str]:
    """Return the bytes that came instead of an answer, with advice; empty if none came.

    Parameters
    ----------
    sent : the frame of the request
    received : all that has arrived since
    is_tcp : the frames have the header of Modbus TCP, else they are RTU's
    """
    if not received:
        return "", ""
    hex_of = received[:32].hex(" ") + (" ..." if len(received) > 32 else "")
    found = _seen_on_tcp(sent, received) if is_tcp else _seen_on_rtu(sent, received)
    return say("{found} ({hex_of})", found=found[0], hex_of=hex_of), found[1]


def _seen_on_tcp(sent: bytes, received: bytes) -> tuple[str, str]:
    if len(received) <= MBAP_SIZE:
        return key("only part of a header came"), key("the network, or the gateway")
    numbers = [int.from_bytes(frame[:2], "big") for frame in (sent, received)]
    ids = key("; `returns_ids: false` of this device in the cell file accepts a gateway's own")
    if numbers[0] != numbers[1]:
        return (
            say(
                "an answer with transaction number {number} instead of {expected} came",
                number=numbers[1],
                expected=numbers[0],
            ),
            say("the gateway{ids}", ids=ids),
        )
    if received[6] != sent[6]:
        return say("an answer of unit {received} came", received=received[6]), say(
            "the unit id, or the gateway{ids}", ids=ids
        )
    return key("bytes came that are no answer to it"), key("that this port is Modbus TCP")


def _seen_on_rtu(sent: bytes, received: bytes) -> tuple[str, str]:
    if received.startswith(sent):
        rest = received[len(sent) :]
        after = (
            key("and then an answer") if _rtu_frame_in(rest) else key("and nothing usable after it")
        )
        return (
            say("the line echoes what is sent, {after}", after=after),
            key(
                "the adapter: switch its local echo off, or set `echo: true` of this device in the "
                "cell file"
            ),
        )
    found = _rtu_frame_in(received)
    if found is None:
        return (
            key("bytes came that are no frame, by their checksum"),
            key("baud rate and parity, termination, RS-485 A and B"),
        )
    begin, frame = found
    if frame[0] != sent[0]:
        return say("an answer of unit {frame} came", frame=frame[0]), key(
            "the slave id, and for a second master"
        )
    if begin:
        return (
            say("an answer came behind {begin} odd byte(s)", begin=begin),
            key("bias and termination resistors of the RS-485 line"),
        )
    if frame[1] & ~_EXCEPTION != sent[1]:
        return say("an answer to function {frame:02x} came", frame=frame[1]), key(
            "for a second master on the line"
        )
    return "an answer of another size came", "which device has this slave id"
