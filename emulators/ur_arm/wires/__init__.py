"""The controller's ports, without sockets: bytes in, bytes out."""

from ._client_interface import (
    READ_ONLY_CODE,
    message_packet,
    realtime_packet,
    state_packet,
    version_message,
)
from ._dashboard import GREETING, DashboardSession
from ._rtde import BadFrameError, RtdeSession
from ._urcap import UrcapSession

__all__ = [
    "GREETING",
    "READ_ONLY_CODE",
    "BadFrameError",
    "DashboardSession",
    "RtdeSession",
    "UrcapSession",
    "message_packet",
    "realtime_packet",
    "state_packet",
    "version_message",
]
