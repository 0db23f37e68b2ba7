"""The stop of the cell when its controller cannot: a process of its own that hears its heartbeat.

The controller sends a heartbeat. When that stays away, this process sends on every wire a stop that
needs neither driver nor answer, by a way of its own: the serial line opened once more, a further
connection to a Modbus device. It knows no device. Drivers give it bytes (`BlindStop`, `BlindLook`).
Run it as ``python -m drivers.supervisor`` (`__main__`). Why it is a process: ADR 98,
*The supervisor*.
"""

from .words import (
    BEAT_S,
    BLIND_BEATS,
    MISSED_BEATS,
    BlindLook,
    BlindStop,
    LooksBlindly,
    Orders,
    StopsBlindly,
)

__all__ = [
    "BEAT_S",
    "BLIND_BEATS",
    "MISSED_BEATS",
    "BlindLook",
    "BlindStop",
    "LooksBlindly",
    "Orders",
    "StopsBlindly",
]
