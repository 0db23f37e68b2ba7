"""One open connection: pymodbus' client with its silences, losses and late replies made visible.

Turns pymodbus' errors into two outcomes, `NoAnswer` and `Lost`; what follows from them is the
link's decision. A connection is used once: to reconnect, make a new one.
"""

import asyncio
import logging
import termios
from collections.abc import Callable
from contextlib import suppress

from pymodbus.exceptions import ConnectionException, ModbusIOException
from pymodbus.pdu import ModbusPDU

from messages import say

from ..clock import CellClock
from ..wires import LineTap
from ._address import CONNECT_TIMEOUT_WALL_S, Address, Hooks, TcpAddress
from ._framing import MBAP_SIZE
from ._request import FunctionCode, Request

wire_log = logging.getLogger("cellctl.wire.modbus")

Trace = Callable[[bool, bytes], None]
"""Called with (sending, frame) for everything that crosses the wire; must not block."""


class NoAnswer(Exception):  # noqa: N818  an outcome between two private files, never shown
    """Time is up; holds the frame sent and the bytes that arrived instead of an answer."""

    def __init__(self, sent: bytes, received: bytes) -> None:
        super().__init__(sent, received)
        self.sent = sent
        self.received = received


class Lost(Exception):  # noqa: N818  an outcome between two private files, never shown
    """The connection ended."""


class Connection:
    """A connection: opened once, used for one request after the other, closed."""

    def __init__(self, address: Address, trace: Trace | None, tap: LineTap | None = None) -> None:
        pymodbus_log = logging.getLogger("pymodbus.logging")
        if pymodbus_log.level == logging.NOTSET:
            # It shouts with frame dumps about what the link handles; whoever wants it sets a level.
            pymodbus_log.setLevel(logging.CRITICAL + 1)
        self._address = address
        self._trace = trace
        self._tap = tap
        self._client = address.client(Hooks(self._on_packet, self._on_pdu, self._on_connected))
        self._lost = asyncio.Event()
        self.is_asking = False  # a request is out
        self._unconsumed = b""
        self._received = bytearray()
        self._sent = b""
        self._returns_ids = not isinstance(address, TcpAddress) or address.returns_ids
        self.late_reply = asyncio.Event()  # set by a reply that nobody waits for any more

    async def open(self, clock: CellClock) -> str | None:
        """Open it; return None, or why that failed."""
        try:
            # opening is the host's business: it is no faster where cell time is
            async with clock.timeout(CONNECT_TIMEOUT_WALL_S * clock.speed):
                if await self._client.connect():
                    return None
        except TimeoutError:
            pass
        except (termios.error, ValueError) as error:  # parity or baud rate the line cannot do
            return say("the line refuses the settings ({error})", error=error)
        finally:
            await asyncio.sleep(0)  # a serial transport starts reading one turn later
        return await self._address.why_not()

    @property
    def is_open(self) -> bool:
        """Whether a request has a chance."""
        return self._client.connected and not self._lost.is_set()

    async def aclose(self) -> None:
        """Close it, without waiting for data written."""
        self._client.close()
        await asyncio.sleep(0)  # the socket itself is closed by the loop's next turn

    async def exchange(
        self, request: Request, unit: int, clock: CellClock, timeout_s: float
    ) -> ModbusPDU:
        """Send a request and return the reply that pymodbus accepts within a time [cell s].

        Parameters
        ----------
        request : request to send
        unit : unit id, or slave id on RS-485
        clock : the cell's clock, which measures the patience
        timeout_s : patience with the unit [cell s]

        Raises
        ------
        NoAnswer : nothing usable arrived in time
        Lost : the connection ended before or meanwhile
        """
        self._received.clear()
        self._sent = self._unconsumed = b""
        self.is_asking = True
        answer = asyncio.ensure_future(self._send(request, unit))
        lost = asyncio.ensure_future(self._lost.wait())
        try:
            with suppress(TimeoutError):
                async with clock.timeout(timeout_s):
                    await asyncio.wait({answer, lost}, return_when=asyncio.FIRST_COMPLETED)
            if answer.done():
                return answer.result()
            if lost.done():
                raise Lost
            raise NoAnswer(self._sent, bytes(self._received))
        except ConnectionException as error:
            raise Lost from error
        except ModbusIOException as error:
            raise NoAnswer(self._sent, bytes(self._received)) from error
        finally:
            self.is_asking = False
            self.late_reply.clear()
            answer.cancel()
            lost.cancel()
            await asyncio.gather(answer, lost, return_exceptions=True)

    async def _send(self, request: Request, unit: int) -> ModbusPDU:
        """Pass a request to pymodbus; a coroutine, because the call itself may raise."""
        client, first = self._client, request.address
        count, values = request.count, request.values
        match request.function:
            case FunctionCode.READ_COILS:
                return await client.read_coils(first, count=count, device_id=unit)
            case FunctionCode.READ_DISCRETE_INPUTS:
                return await client.read_discrete_inputs(first, count=count, device_id=unit)
            case FunctionCode.READ_HOLDING_REGISTERS:
                return await client.read_holding_registers(first, count=count, device_id=unit)
            case FunctionCode.READ_INPUT_REGISTERS:
                return await client.read_input_registers(first, count=count, device_id=unit)
            case FunctionCode.WRITE_COIL:
                return await client.write_coil(first, bool(values[0]), device_id=unit)
            case FunctionCode.WRITE_REGISTER:
                return await client.write_register(first, values[0], device_id=unit)
            case FunctionCode.WRITE_COILS:
                bits = [bool(value) for value in values]
                return await client.write_coils(first, bits, device_id=unit)
            case FunctionCode.WRITE_REGISTERS:
                return await client.write_registers(first, list(values), device_id=unit)

    def _on_packet(self, sending: bool, data: bytes) -> bytes:
        if sending:
            self._sent = data
            self._show(">", True, data)
            return data
        # pymodbus shows the whole unconsumed buffer each time; the trace wants each byte once.
        is_growing = len(data) > len(self._unconsumed) and data.startswith(self._unconsumed)
        fresh = data[len(self._unconsumed) :] if is_growing else data
        self._unconsumed = data
        self._received += fresh
        self._show("<" if self.is_asking else "< (late)", False, fresh)
        if self._returns_ids or len(data) < MBAP_SIZE:
            return data
        # pymodbus skips an answer with other ids: it is given those of the request
        return self._sent[:2] + data[2:6] + self._sent[6:7] + data[MBAP_SIZE:]

    def _on_pdu(self, sending: bool, pdu: ModbusPDU) -> ModbusPDU:
        if not sending:
            self._unconsumed = b""
            if not self.is_asking:
                self.late_reply.set()
        return pdu

    def _on_connected(self, connected: bool) -> None:
        if not connected:
            self._lost.set()
            if self._tap is not None:
                self._tap.lost()

    def _show(self, mark: str, sending: bool, data: bytes) -> None:
        if wire_log.isEnabledFor(logging.DEBUG):
            wire_log.debug("%s %s %s", self._address, mark, data.hex(" "))
        if self._trace is not None:
            self._trace(sending, data)
        if self._tap is not None:
            self._tap.carried(data, sending=sending, in_time=self.is_asking)
