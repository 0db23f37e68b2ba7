"""The serial line: bytes in and out, its turns, and the one of two boards that listens.

It knows requests and replies, no motor.
"""

from ._link import Guard, Link
from ._recorded import Exchanged, RecordedArm, RecordedLine, RecordedTransport, exchanges_of
from ._transport import SerialTransport, Transport
from ._wire import LineUncertainError, LinkConfig, Trace, WireExchange, breaks_step

__all__ = [
    "Exchanged",
    "Guard",
    "LineUncertainError",
    "Link",
    "LinkConfig",
    "RecordedArm",
    "RecordedLine",
    "RecordedTransport",
    "SerialTransport",
    "Trace",
    "Transport",
    "WireExchange",
    "breaks_step",
    "exchanges_of",
]
