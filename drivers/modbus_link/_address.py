"""The address of a Modbus line, its opening, and the reason why it could not be opened."""

import asyncio
import os
import stat
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pymodbus import FramerType
from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient
from pymodbus.client.base import ModbusBaseClient
from pymodbus.pdu import ModbusPDU

from messages import key, say

# opening a connection is up to the host: it does not scale with cell time
CONNECT_TIMEOUT_WALL_S = 3.0
_NO_TIMEOUT_WALL_S = (
    86400.0  # pymodbus' own, for replies too, is the wall clock's: the link's counts
)


@dataclass(frozen=True, slots=True)
class Hooks:
    """The callbacks of a client at work; the first two return their arguments."""

    packet: Callable[[bool, bytes], bytes]
    pdu: Callable[[bool, ModbusPDU], ModbusPDU]
    connected: Callable[[bool], None]


@dataclass(frozen=True, slots=True)
class TcpAddress:
    """Modbus TCP: a device of its own, or a gateway to RS-485 (then units are slave ids).

    Attributes
    ----------
    returns_ids : answers carry the transaction number and unit id of their request, as the
        standard has it; some gateways put their own, and answers are then told apart as on RTU
    """

    host: str
    port: int = 502
    returns_ids: bool = True

    def __str__(self) -> str:
        return say("Modbus TCP {host}:{port}", host=self.host, port=self.port)

    @property
    def check(self) -> str:
        """The things to check when it cannot be reached."""
        return say(
            "check cable, power, the address {host} and that port {port} is Modbus",
            host=self.host,
            port=self.port,
        )

    def client(self, hooks: Hooks) -> ModbusBaseClient:
        """Return an unconnected client; needs a running loop."""
        return _tcp_client(self.host, self.port, FramerType.SOCKET, hooks)

    async def why_not(self) -> str:
        """Return the host's own words for a connection that fails."""
        return await _why_no_connection(self.host, self.port)


@dataclass(frozen=True, slots=True)
class RtuOverTcpAddress:
    """RTU frames on a TCP stream, without MBAP header: transparent device servers, UR RS485.

    Attributes
    ----------
    echoes : True if every sent byte comes back before the answer, and is dropped
    """

    host: str
    port: int
    echoes: bool = False

    def __str__(self) -> str:
        return say("Modbus RTU over TCP {host}:{port}", host=self.host, port=self.port)

    @property
    def check(self) -> str:
        """The things to check when it cannot be reached."""
        return say(
            "check cable, power, the address {host} and that port {port} "
            "passes the serial line through unchanged",
            host=self.host,
            port=self.port,
        )

    def client(self, hooks: Hooks) -> ModbusBaseClient:
        """Return an unconnected client; needs a running loop."""
        client = _tcp_client(self.host, self.port, FramerType.RTU, hooks)
        client.ctx.comm_params.handle_local_echo = self.echoes  # no argument of pymodbus' for TCP
        return client

    async def why_not(self) -> str:
        """Return the host's own words for a connection that fails."""
        return await _why_no_connection(self.host, self.port)


@dataclass(frozen=True, slots=True)
class RtuAddress:
    """Modbus RTU on a serial line of this computer, 8 data bits.

    Attributes
    ----------
    echoes : an RS-485 adapter whose receiver stays on while it sends: what is sent comes back
        before the answer, and is dropped
    """

    device: str
    baudrate: int
    parity: Literal["N", "E", "O"] = "N"
    stopbits: Literal[1, 2] = 1
    echoes: bool = False

    def __str__(self) -> str:
        return say(
            "Modbus RTU {device} at {baudrate} 8{parity}{stopbits}",
            device=self.device,
            baudrate=self.baudrate,
            parity=self.parity,
            stopbits=self.stopbits,
        )

    @property
    def check(self) -> str:
        """The things to check when it cannot be opened."""
        return say(
            "check the USB/RS-485 adapter, the device name {device} and its permissions",
            device=self.device,
        )

    def client(self, hooks: Hooks) -> ModbusBaseClient:
        """Return an unconnected client; needs a running loop."""
        return AsyncModbusSerialClient(
            self.device,
            framer=FramerType.RTU,
            baudrate=self.baudrate,
            bytesize=8,
            parity=self.parity,
            stopbits=self.stopbits,
            name=str(self),
            handle_local_echo=self.echoes,
            reconnect_delay=0,
            timeout=_NO_TIMEOUT_WALL_S,
            retries=0,
            trace_packet=hooks.packet,
            trace_pdu=hooks.pdu,
            trace_connect=hooks.connected,
        )

    async def why_not(self) -> str:
        """Return the reason why the device node cannot be opened, as far as it is known."""
        try:
            mode = Path(self.device).stat().st_mode  # noqa: ASYNC240  a stat of /dev does not block
        except OSError as error:
            return os.strerror(error.errno or 0)
        if not stat.S_ISCHR(mode):
            return key("not a character device")
        if not os.access(self.device, os.R_OK | os.W_OK):
            return key("permission denied")
        return key("another program holds it, or the line settings are refused")


Address = TcpAddress | RtuAddress | RtuOverTcpAddress


def _tcp_client(host: str, port: int, framer: FramerType, hooks: Hooks) -> ModbusBaseClient:
    # Reconnecting, retrying and timing out are the link's: pymodbus would re-execute writes.
    return AsyncModbusTcpClient(
        host,
        port=port,
        framer=framer,
        name=f"{host}:{port}",
        reconnect_delay=0,
        timeout=_NO_TIMEOUT_WALL_S,
        retries=0,
        trace_packet=hooks.packet,
        trace_pdu=hooks.pdu,
        trace_connect=hooks.connected,
    )


async def _why_no_connection(host: str, port: int) -> str:
    # pymodbus returns a bare False; only a second attempt by hand shows the reason.
    try:
        async with asyncio.timeout(CONNECT_TIMEOUT_WALL_S):
            _reader, writer = await asyncio.open_connection(host, port)
    except TimeoutError:
        return say(
            "no answer within {connect_timeout_wall_s:g} s",
            connect_timeout_wall_s=CONNECT_TIMEOUT_WALL_S,
        )
    except OSError as error:
        return os.strerror(error.errno) if error.errno and error.errno > 0 else str(error)
    writer.close()
    return key("it answers now, but did not a moment ago")
