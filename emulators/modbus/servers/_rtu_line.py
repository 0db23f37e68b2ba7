"""One RS-485 line with RTU devices on it, seen from the master's plug."""

import asyncio
from collections.abc import Callable
from typing import Final, Protocol

from emulators.clock import WorldClock

from ..bus import Bus, BusReply
from ..framing import RtuReader, characters_s, encode_rtu, frame_gap_s
from ._pace import Pacer

# a device takes its time before it answers (typical, not from a manual)
DEFAULT_TURNAROUND_S: Final = 0.001


class HangUp(Exception):  # noqa: N818 (an outcome asked for by a test, not an error of ours)
    """The connection is to end here."""


class MasterPlug(Protocol):
    """The source of the master's bytes and the sink of the line's."""

    reader: asyncio.StreamReader

    def write(self, data: bytes) -> None:
        """Send bytes to the master at once; they are lost if nobody takes them."""
        ...


class RtuLine:
    """Serves one bus over a byte stream as RTU, in the world's time.

    A frame lies between two silences of 3.5 characters: bytes that follow a request without that
    pause void it, as on a real line. Request and reply take the time of their characters; reply
    characters leave one by one as they fall due.

    Parameters
    ----------
    bus : the devices on the line
    clock : the world's time
    baudrate : baudrate of the line [bit/s]; it gives the length of a character and of the silence
        between frames
    turnaround_s : from the end of a request to the reply's first character [world s]
    """

    def __init__(
        self,
        bus: Bus,
        clock: WorldClock,
        baudrate: int,
        turnaround_s: float = DEFAULT_TURNAROUND_S,
    ) -> None:
        self._bus = bus
        self._clock = clock
        self._pacer = Pacer(clock)
        self._baudrate = baudrate
        self._gap_s = frame_gap_s(baudrate)
        self._turnaround_s = turnaround_s
        self._talking = asyncio.Lock()

    async def serve(self, plug: MasterPlug) -> None:
        """Answer a master until its stream ends.

        Raises
        ------
        HangUp : a fault asks for the connection to end
        """
        hearing = RtuReader()
        while data := await plug.reader.read(4096):
            heard_s = self._clock.now_s()
            hearing.feed(data)
            is_over = False
            while not is_over:
                # the whole frame is handed over at once; on the line it would still be going on
                end_s = heard_s + characters_s(hearing.byte_count, self._baudrate)
                silence_s = end_s + self._gap_s - self._clock.now_s()
                wait_s = self._pacer.silence_s(
                    max(silence_s, 0.0), is_frame_complete=hearing.is_complete
                )
                more = await self._pacer.read_within(plug.reader, wait_s)
                is_over = not more
                hearing.feed(more or b"")
            frame = hearing.silence()
            if frame is None:
                continue
            async with self._talking:
                reply = self._bus.request(frame.unit, frame.pdu, self._clock.now_s())
                if reply is not None:
                    await self._say(reply, plug.write)

    async def _say(self, reply: BusReply, write: Callable[[bytes], None]) -> None:
        if reply.is_connection_dropped:
            raise HangUp
        frame = encode_rtu(reply.unit, reply.pdu)
        if reply.is_corrupt:
            frame = frame[:-1] + bytes((frame[-1] ^ 0x40,))
        frame = frame[: reply.byte_count]
        start_s = self._clock.now_s() + self._turnaround_s + reply.delay_s
        if reply.fault is None:
            await self._send(frame, start_s, write)
            return
        index, fault = reply.fault
        index = min(index, len(frame) - 1)
        harmed = fault.apply(frame[index])
        late_s = max((one_s for _, one_s in harmed), default=0.0)
        await self._send(frame[:index], start_s, write)
        rest = bytes(byte for byte, _ in harmed) + frame[index + 1 :]
        await self._send(rest, self._clock.now_s() + late_s, write)

    async def _send(self, frame: bytes, start_s: float, write: Callable[[bytes], None]) -> None:
        character_s = characters_s(1, self._baudrate)
        sent = 0
        while sent < len(frame):
            await self._pacer.until(start_s + (sent + 1) * character_s)
            due = max(sent + 1, int((self._clock.now_s() - start_s) / character_s))
            write(frame[sent:due])
            sent = due
