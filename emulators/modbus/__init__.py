"""Modbus as devices speak it: framing, buses of devices, and the servers that own a wire.

Own code throughout: the drivers' side uses a library, so this side is the second reading of the
standard. Nothing here knows a register map; devices are in `gripper_modbus`, `lighting_modbus` and
`io_modbus`. Time-dependent objects have `advance(dt_s)`, called by the world or by a `Stepper`.
"""

from ._points import COIL_OFF, COIL_ON, Point, PointMap, coil, parse_range, parse_registers
from ._stepper import Steppable, Stepper
from .bus import Bus, BusReply, WireFaults
from .device import (
    GATEWAY_TARGET_SILENT,
    ILLEGAL_ADDRESS,
    ILLEGAL_FUNCTION,
    ILLEGAL_VALUE,
    ModbusDevice,
    RefusedRequest,
    exception_pdu,
)
from .framing import (
    BrokenStreamError,
    MbapFrame,
    MbapReader,
    RtuFrame,
    RtuReader,
    characters_s,
    crc16,
    encode_mbap,
    encode_rtu,
    frame_gap_s,
    request_length,
)
from .servers import RtuOverTcpServer, RtuPtyServer, TcpGateway, TcpServer

__all__ = [
    "COIL_OFF",
    "COIL_ON",
    "GATEWAY_TARGET_SILENT",
    "ILLEGAL_ADDRESS",
    "ILLEGAL_FUNCTION",
    "ILLEGAL_VALUE",
    "BrokenStreamError",
    "Bus",
    "BusReply",
    "MbapFrame",
    "MbapReader",
    "ModbusDevice",
    "Point",
    "PointMap",
    "RefusedRequest",
    "RtuFrame",
    "RtuOverTcpServer",
    "RtuPtyServer",
    "RtuReader",
    "Steppable",
    "Stepper",
    "TcpGateway",
    "TcpServer",
    "WireFaults",
    "characters_s",
    "coil",
    "crc16",
    "encode_mbap",
    "encode_rtu",
    "exception_pdu",
    "frame_gap_s",
    "parse_range",
    "parse_registers",
    "request_length",
]
