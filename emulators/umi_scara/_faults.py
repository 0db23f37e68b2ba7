"""Faults of the line, as ordinary inputs of the wire.

Faults of the body (a jammed axis, the emergency stop) are inputs of the arm model.
"""

from dataclasses import dataclass
from typing import Final

RESTARTED: Final = 0x0F  # umi_rtx.md 2.9; 0x0E means the same

# The answer of a non-standard ROM; umi_rtx.md 8.7 has its meaning, not the exact text
MONITOR_BANNER: Final = b"\r\nMSP SYSTEM ROM  VERSION 01.00  JUN 1987\r\n(C) UMI 1987\r\nOK\r\n"
MONITOR_ERROR: Final = b"ERROR\r\n"


@dataclass(slots=True)
class Faults:
    """Faults of the line and of the IPs' firmware; the "next" ones disarm themselves.

    Attributes
    ----------
    drop_reply_byte : index of the byte lost from the next reply that is long enough
    corrupt_next_read : flip a data bit in the next checksummed reply
    corrupt_next_write : flip a data bit in the next value written, before it reaches the arm
    reply_delay_s : added to the latency of every reply [world s]
    sticky_busy : numeric go is always answered `03`
    reset_toggles : `20` switches the line over as well
    restart_code : answer of a restarted IP, `0F` or `0E`
    monitor_rom : the boards hold a ROM that talks in ASCII
    mute : no reply gets back; the arm hears and obeys
    unplugged : no byte gets through, either way
    """

    drop_reply_byte: int | None = None
    corrupt_next_read: bool = False
    corrupt_next_write: bool = False
    reply_delay_s: float = 0.0
    sticky_busy: bool = False
    reset_toggles: bool = False
    restart_code: int = RESTARTED
    monitor_rom: bool = False
    mute: bool = False
    unplugged: bool = False
