"""Check the safety copies: each must be known to be healthy before anything moves.

The emergency stop itself is hard-wired. The checks here can only stop the work early.
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
FIRST_READINGS_S = 1.0  # time in which an input is read twice [cell s]


async def settled_signal(io: IoBlock, name: str, clock: CellClock) -> Signal:
    """Return a safety copy once it was read twice, or its state after one second.

    Parameters
    ----------
    io : the I/O block that reads it; just connected
    name : of the signal
    clock : the cell's
    """
    # the wait for an unhealthy signal times out
    with suppress(TimeoutError):
        async with clock.timeout(FIRST_READINGS_S):
            await io.wait_for(name, Signal.OK)
    return io.signal(name)


def check_interlocks(io: IoBlock, *, is_person_inside: bool = False) -> None:
    """Check that every safety copy is known to be healthy.

    Parameters
    ----------
    io : the I/O block that reads the safety copies
    is_person_inside : a person holds the part by hand, so the door may be open

    Raises
    ------
    InterlockError : a safety copy is not healthy, or has no fresh reading; the message names it
        and says what to do
    """
    for name, advice in REQUIRED_SIGNALS.items():
        if is_person_inside and name == GUARD:
            continue
        signal = io.signal(name)
        if signal is Signal.NOT_OK:
            raise InterlockError(f"{name}: {advice}")
        if signal is Signal.UNKNOWN:
            raise InterlockError(
                f"{name}: the I/O block has no fresh reading, which counts as not healthy; "
                "check its cable and power"
            )
