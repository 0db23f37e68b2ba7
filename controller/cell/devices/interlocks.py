"""Safety copies: what must be known to be healthy before anything moves.

The emergency stop is hard-wired. What stands here may only stop work early.
"""

from contextlib import suppress

from drivers.clock import CellClock
from drivers.kinds import IoBlock, Signal

from ..errors import InterlockError

GUARD = "guard_closed"
REQUIRED_SIGNALS = {
    "estop_ok": "the emergency stop is pressed, or its chain is open; release and reset it",
    GUARD: "the door is open; close it",
    "supply_ok": "the 24 V supply is missing; check the fuse",
}
FIRST_READINGS_S = 1.0  # for an input to be read twice [cell s]


async def settled_signal(io: IoBlock, name: str, clock: CellClock) -> Signal:
    """Return a safety copy once it was read twice, or what is known of it after a second.

    Parameters
    ----------
    io : where it is read; just connected
    name : of the signal
    clock : the cell's
    """
    # one that is not healthy never comes
    with suppress(TimeoutError):
        async with clock.timeout(FIRST_READINGS_S):
            await io.wait_for(name, Signal.OK)
    return io.signal(name)


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
    for name, advice in REQUIRED_SIGNALS.items():
        if is_person_inside and name == GUARD:
            continue
        signal = io.signal(name)
        if signal is Signal.NOT_OK:
            raise InterlockError(f"{name}: {advice}")
        if signal is Signal.UNKNOWN:
            raise InterlockError(
                f"{name}: the I/O block gives no fresh reading, which counts as not healthy; "
                "check its cable and power"
            )
