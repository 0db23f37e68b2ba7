"""A Modbus TCP server over a block of registers: framing, functions, exceptions, bounds.

Source: MODBUS Messaging on TCP/IP Implementation Guide V1.0b (3.1.3, MBAP header), and MODBUS
Application Protocol V1.1b3 (6.3, 6.4, 6.6, 6.12, 6.17; exceptions in 7). Own code and not pymodbus'
server, which is for simulators: it answers one of ten requests that come in one segment, and has no
bound of connections (ADR 128). Knows no meaning of any register.
"""

import asyncio
import logging
import struct
from collections.abc import Callable, Sequence
from contextlib import suppress
from ipaddress import ip_address
from typing import Final

log = logging.getLogger(__name__)

MAX_CONNECTIONS: Final = 8  # a PLC takes one or two, a panel one
# A client that is silent for so long is gone; a PLC asks several times a second.
SILENT_S: Final = 60.0
SENT_S: Final = 5.0
MAX_PDU: Final = 253  # implementation guide, 3.1.3: 260 bytes with unit and header
MAX_READ: Final = 125
MAX_WRITTEN: Final = 123
MAX_READ_WRITTEN: Final = 121
READ_HOLDING: Final = 3
READ_INPUT: Final = 4
WRITE_ONE: Final = 6
WRITE_MANY: Final = 16
READ_WRITE: Final = 23
ILLEGAL_FUNCTION: Final = 1
ILLEGAL_ADDRESS: Final = 2
ILLEGAL_VALUE: Final = 3


class _RefusedError(Exception):
    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class ModbusServer:
    """Serves registers.

    Parameters
    ----------
    count : registers, from 0
    writable : first register that may be written; all after it may be, too
    read : returns all registers as they are now
    write : takes in an address and values; called for each request, in order
    clients : addresses that may connect; empty: all that reach it
    """

    def __init__(
        self,
        count: int,
        writable: int,
        read: Callable[[], Sequence[int]],
        write: Callable[[int, Sequence[int]], None],
        clients: frozenset[str] = frozenset(),
    ) -> None:
        self._count = count
        self._writable = writable
        self._read = read
        self._write = write
        self._clients = clients
        self._open: dict[asyncio.Task[None], asyncio.StreamWriter] = {}

    async def serve(self, host: str, port: int) -> None:
        """Serve until cancelled.

        Raises
        ------
        OSError : the address cannot be listened to
        """
        server = await asyncio.start_server(self._connect, host, port, limit=4096)
        try:
            await asyncio.Event().wait()  # `serve_forever` would wait for clients to hang up
        finally:
            server.close()
            for writer in self._open.values():  # a task that is cancelled is logged by asyncio
                writer.transport.abort()
            await asyncio.gather(*self._open)

    async def _connect(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        peer = writer.get_extra_info("peername")
        try:
            if not self._may_connect(str(peer[0]) if peer else ""):
                log.warning("PLC: %s may not connect; see `clients` in the cell file", peer)
                return
            if len(self._open) >= MAX_CONNECTIONS:
                log.warning("PLC: %s is one connection too many", peer)
                return
            self._open[task] = writer
            with suppress(TimeoutError, asyncio.IncompleteReadError, ConnectionError):
                await self._answer_all(reader, writer)
        finally:
            self._open.pop(task, None)
            writer.transport.abort()

    def _may_connect(self, address: str) -> bool:
        if not self._clients:
            return True
        try:
            found = ip_address(address)
        except ValueError:
            return False
        mapped = getattr(found, "ipv4_mapped", None)
        return str(mapped or found) in self._clients

    async def _answer_all(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while True:
            async with asyncio.timeout(SILENT_S):
                header = await reader.readexactly(7)
                transaction, protocol, length, unit = struct.unpack(">HHHB", header)
                if protocol != 0 or not 2 <= length <= MAX_PDU + 1:
                    return  # not Modbus, and there is no way to find its next frame
                request = await reader.readexactly(length - 1)
            try:
                reply = self._answer(request)
            except _RefusedError as error:
                reply = bytes((request[0] | 0x80, error.code))
            writer.write(struct.pack(">HHHB", transaction, 0, len(reply) + 1, unit) + reply)
            async with asyncio.timeout(SENT_S):
                await writer.drain()

    def _answer(self, request: bytes) -> bytes:
        function, body = request[0], request[1:]
        if function in (READ_HOLDING, READ_INPUT):
            address, count = _unpack(">HH", body)
            return bytes((function,)) + self._values(address, count, MAX_READ)
        if function == WRITE_ONE:
            address, value = _unpack(">HH", body)
            self._take(address, (value,))
            return request
        if function == WRITE_MANY:
            address, count = _unpack(">HH", body[:4])
            self._take(address, _values_of(body[4:], count, MAX_WRITTEN))
            return request[:5]
        if function == READ_WRITE:
            read_at, read_count, address, count = _unpack(">HHHH", body[:8])
            values = _values_of(body[8:], count, MAX_READ_WRITTEN)
            self._values(read_at, read_count, MAX_READ)  # refused before anything is written
            self._take(address, values)
            return bytes((function,)) + self._values(read_at, read_count, MAX_READ)
        raise _RefusedError(ILLEGAL_FUNCTION)

    def _values(self, address: int, count: int, most: int) -> bytes:
        if not 1 <= count <= most:
            raise _RefusedError(ILLEGAL_VALUE)
        if address + count > self._count:
            raise _RefusedError(ILLEGAL_ADDRESS)
        values = self._read()[address : address + count]
        return struct.pack(f">B{count}H", 2 * count, *values)

    def _take(self, address: int, values: Sequence[int]) -> None:
        if address < self._writable or address + len(values) > self._count:
            raise _RefusedError(ILLEGAL_ADDRESS)
        self._write(address, values)


def _unpack(form: str, data: bytes) -> tuple[int, ...]:
    if len(data) != struct.calcsize(form):
        raise _RefusedError(ILLEGAL_VALUE)
    return struct.unpack(form, data)


def _values_of(data: bytes, count: int, most: int) -> tuple[int, ...]:
    if not 1 <= count <= most or len(data) != 1 + 2 * count or data[0] != 2 * count:
        raise _RefusedError(ILLEGAL_VALUE)
    return struct.unpack(f">{count}H", data[1:])
