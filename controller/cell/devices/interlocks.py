"""Safety copies: what must be known to be healthy before anything moves.

The emergency stop is hard-wired. What stands here may only stop work early.
"""

from drivers.kinds import IoBlock, Signal

from ..errors import InterlockError

GUARD = "guard_closed"
REQUIRED_SIGNALS = {
    "estop_ok": "the emergency stop is pressed, or its chain is open; release and reset it",
    GUARD: "the door is open; close it",
    "supply_ok": "the 24 V supply is missing; check the fuse",
}


def check_interlocks(io: IoBlock, *, is_person_inside: bool = False) -> None:
    """Check that every safety copy is known to be healthy.

    Parameters
    ----------
    io : where the safety copies are read
    is_person_inside : somebody holds the part by hand, so that the door may be open

    Raises
    ------
    InterlockError : one is not, or gives no fresh reading; the message says which and what to do
    """
    for name, remedy in REQUIRED_SIGNALS.items():
        if is_person_inside and name == GUARD:
            continue
        signal = io.signal(name)
        if signal is Signal.NOT_OK:
            raise InterlockError(f"{name}: {remedy}")
        if signal is Signal.UNKNOWN:
            raise InterlockError(
                f"{name}: the I/O block gives no fresh reading, which counts as not healthy; "
                "check its cable and power"
            )
