"""Modbus over TCP: the sockets. Each server decides on the use of a frame."""

import asyncio
from abc import abstractmethod

from emulators.clock import WorldClock
from emulators.tcp_listener import TcpListener

from ..bus import BROADCAST_UNIT, Bus, BusReply
from ..device import GATEWAY_TARGET_SILENT, exception_pdu
from ..framing import (
    BrokenStreamError,
    MbapFrame,
    MbapReader,
    characters_s,
    encode_mbap,
    frame_gap_s,
)
from ._pace import Pacer
from ._rtu_line import DEFAULT_TURNAROUND_S, HangUp, RtuLine


class _ModbusListener(TcpListener):
    """A listener whose connections also end with a broken stream or a silent device."""

    ended_by = (ConnectionError, BrokenStreamError, HangUp)


class _MbapListener(_ModbusListener):
    def __init__(self, bus: Bus, clock: WorldClock, host: str, port: int) -> None:
        super().__init__(host, port)
        self.bus = bus
        self._clock = clock
        self._pacer = Pacer(clock)
        self._line = asyncio.Lock()  # one request at a time; waiters are served in order

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        frames = MbapReader()
        while data := await reader.read(4096):
            for frame in frames.feed(data):
                async with self._line:
                    reply = await self._exchange(frame)
                if reply is None:
                    continue
                if reply.is_connection_dropped:
                    raise HangUp
                writer.write(_tcp_frame(frame.transaction, reply))
                await writer.drain()

    @abstractmethod
    async def _exchange(self, frame: MbapFrame) -> BusReply | None:
        """Carry out one request and return the reply to the client, when there is one."""


def _tcp_frame(transaction: int, reply: BusReply) -> bytes:
    data = encode_mbap(transaction, reply.unit, reply.pdu)
    if reply.is_corrupt:  # TCP has no CRC of Modbus; the protocol number is what a client can check
        data = data[:2] + b"\x40\x00" + data[4:]
    return data[: reply.byte_count]


class TcpGateway(_MbapListener):
    """Modbus TCP to RS-485 gateway: the master of one serial line, for several clients.

    Behind it requests and replies take the time of their characters. A device that is silent,
    late, unreadable or answers under another's number has not answered for the gateway.
    """

    def __init__(
        self,
        bus: Bus,
        clock: WorldClock,
        host: str = "127.0.0.1",
        port: int = 0,
        *,
        baudrate: int = 115200,
        reply_timeout_s: float = 0.2,
        is_silence_answered: bool = True,
        turnaround_s: float = DEFAULT_TURNAROUND_S,
    ) -> None:
        """Make a gateway; `start` opens it.

        Parameters
        ----------
        bus : the devices on the line
        clock : the world's clock
        host, port : address to listen on; port 0 takes a free one
        baudrate : baudrate of the line, 8N1 [bit/s]
        reply_timeout_s : time that the gateway waits for the first character [world s]
        is_silence_answered : exception 0B for a silent device; False: the client gets nothing
        turnaround_s : from the end of a request to the start of the reply [world s]
        """
        super().__init__(bus, clock, host, port)
        self._baudrate = baudrate
        self._gap_s = frame_gap_s(baudrate)
        self._reply_timeout_s = reply_timeout_s
        self._is_silence_answered = is_silence_answered
        self._turnaround_s = turnaround_s
        self._line_free_s = 0.0

    async def _exchange(self, frame: MbapFrame) -> BusReply | None:
        start_s = max(self._clock.now_s(), self._line_free_s)
        sent_s = start_s + self._characters_s(frame.pdu)
        await self._pacer.until(sent_s)
        reply = self.bus.request(frame.unit, frame.pdu, self._clock.now_s())
        self._line_free_s = sent_s + self._gap_s
        if frame.unit == BROADCAST_UNIT:  # which has no answer: the gateway does not listen
            return None
        wait_s = self._turnaround_s + (reply.delay_s if reply is not None else 0.0)
        if reply is not None and reply.is_connection_dropped:
            return reply
        if (
            reply is not None
            and reply.is_sound
            and reply.unit == frame.unit
            and wait_s <= self._reply_timeout_s
        ):
            done_s = sent_s + wait_s + self._characters_s(reply.pdu)
            self._line_free_s = done_s + self._gap_s
            await self._pacer.until(done_s)
            return reply
        await self._pacer.until(sent_s + self._reply_timeout_s)
        self._line_free_s = sent_s + self._reply_timeout_s + self._gap_s
        if not self._is_silence_answered:
            return None
        return BusReply(frame.unit, exception_pdu(frame.pdu[0], GATEWAY_TARGET_SILENT))

    def _characters_s(self, pdu: bytes) -> float:
        return characters_s(1 + len(pdu) + 2, self._baudrate)


class TcpServer(_MbapListener):
    """A device that speaks Modbus TCP itself: no line behind it, so no serial time.

    Requests to a unit it does not have stay without an answer.
    """

    def __init__(
        self,
        bus: Bus,
        clock: WorldClock,
        host: str = "127.0.0.1",
        port: int = 0,
        *,
        turnaround_s: float = DEFAULT_TURNAROUND_S,
        is_silence_answered: bool = False,
    ) -> None:
        """Make a server; `start` opens it.

        Parameters
        ----------
        bus : the device, or several that share one network plug
        clock : the world's clock
        host, port : address to listen on; port 0 takes a free one
        turnaround_s : from request to reply [world s]
        is_silence_answered : exception 0B where nobody answers; False: the client gets nothing
        """
        super().__init__(bus, clock, host, port)
        self._turnaround_s = turnaround_s
        self._is_silence_answered = is_silence_answered

    async def _exchange(self, frame: MbapFrame) -> BusReply | None:
        now_s = self._clock.now_s()
        reply = self.bus.request(frame.unit, frame.pdu, now_s)
        if reply is not None:
            await self._pacer.until(now_s + self._turnaround_s + reply.delay_s)
            return reply
        if not self._is_silence_answered:
            return None
        return BusReply(frame.unit, exception_pdu(frame.pdu[0], GATEWAY_TARGET_SILENT))


class _SocketPlug:
    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader = reader
        self._writer = writer

    def write(self, data: bytes) -> None:
        self._writer.write(data)


class RtuOverTcpServer(_ModbusListener):
    """RTU frames over a TCP stream, CRC and all: a serial device server in transparent mode."""

    def __init__(
        self,
        bus: Bus,
        clock: WorldClock,
        host: str = "127.0.0.1",
        port: int = 0,
        *,
        baudrate: int = 115200,
        turnaround_s: float = DEFAULT_TURNAROUND_S,
    ) -> None:
        """Make a server; `start` opens it.

        Parameters
        ----------
        bus : the devices on the line
        clock : the world's clock
        host, port : address to listen on; port 0 takes a free one
        baudrate : baudrate of the line, 8N1 [bit/s]
        turnaround_s : from the end of a request to the start of the reply [world s]
        """
        super().__init__(host, port)
        self.bus = bus
        self._line = RtuLine(bus, clock, baudrate, turnaround_s)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await self._line.serve(_SocketPlug(reader, writer))
