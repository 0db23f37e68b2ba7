"""The one owner of a Modbus line: transports, one request at a time, time-outs, resynchronisation.

Several devices may stand behind one link (a gateway, an RS-485 line); each speaks through its own
`ModbusUnit`. Framing is pymodbus' (pinned exactly); everything a late reply, a lost line or a
silent device means for the caller is decided here. Knows no register of any device.
Source: the reference page modbus_devices.md 8, 9.
"""

from ._address import Address, RtuAddress, RtuOverTcpAddress, TcpAddress
from ._connection import Trace
from ._link import Again, ModbusLink, ModbusUnit, always
from ._request import FunctionCode, Request
from ._seen import seen_instead
from ._verbs import VerbLock

__all__ = [
    "Address",
    "Again",
    "FunctionCode",
    "ModbusLink",
    "ModbusUnit",
    "Request",
    "RtuAddress",
    "RtuOverTcpAddress",
    "TcpAddress",
    "Trace",
    "VerbLock",
    "always",
    "seen_instead",
]
