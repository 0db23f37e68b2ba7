"""Safety copies: what must be known to be healthy before anything moves.

The emergency stop is hard-wired. What stands here may only stop work early.
"""

from drivers.io_modbus import Signal

from .devices import Devices
from .errors import InterlockError

REQUIRED_SIGNALS = {
    "estop_ok": "the emergency stop is pressed, or its chain is open; release and reset it",
    "guard_closed": "the door is open; close it",
    "supply_ok": "the 24 V supply is missing; check the fuse",
}


def check_interlocks(devices: Devices) -> None:
    """Raise InterlockError unless every safety copy is known to be healthy."""
    for name, remedy in REQUIRED_SIGNALS.items():
        signal = devices.io.signal(name)
        if signal is Signal.NOT_OK:
            raise InterlockError(f"{name}: {remedy}")
        if signal is Signal.UNKNOWN:
            raise InterlockError(
                f"{name}: the I/O block gives no fresh reading, which counts as not healthy; "
                "check its cable and power"
            )
