"""A PLC: orders and results by registers over Modbus TCP, with a handshake (ADR 128)."""

from ._server import ModbusServer
from ._wire import PlcWire

__all__ = ["ModbusServer", "PlcWire"]
