"""Check the safety copies: each must be known to be healthy before anything moves.

The emergency stop itself is hard-wired. The checks here can only stop the work early.
"""

from collections.abc import Sequence
from contextlib import suppress
from typing import Final

from drivers.clock import CellClock
from drivers.kinds import IoBlock, Signal

from ...errors import InterlockError
from .logic import Truth
from .rules import BUILT_IN_RULES, REQUIRED_SIGNALS, CheckTime, Facts, Rule, first_violation

FIRST_READINGS_S: Final = 1.0  # longest time for two readings of an input [cell s]


async def settled_signal(io: IoBlock, name: str, clock: CellClock) -> Signal:
    """Return a safety copy once it was read twice, or its state after one second.

    Parameters
    ----------
    io : the I/O block that reads it; just connected
    name : name of the signal
    clock : the cell's clock
    """
    # the wait for an unhealthy signal times out
    with suppress(TimeoutError):
        async with clock.timeout(FIRST_READINGS_S):
            await io.wait_for(name, Signal.OK)
    return io.signal(name)


def check_interlocks(
    io: IoBlock, rules: Sequence[Rule] = BUILT_IN_RULES, *, is_person_inside: bool = False
) -> None:
    """Check that every safety signal is known to be healthy, before anything moves.

    Parameters
    ----------
    io : the I/O block that reads the safety copies
    rules : rules of the cell
    is_person_inside : a person holds the part by hand, so the door may be open

    Raises
    ------
    InterlockError : a safety copy is not healthy, or has no fresh reading; the message names it
        and says what to do
    """
    facts: Facts = {
        **{name: Truth.of_signal(io.signal(name)) for name in REQUIRED_SIGNALS},
        "always": Truth.TRUE,
        "moves_arm": Truth.FALSE,
        "person_inside": Truth.of(is_person_inside),
    }
    violation = first_violation(
        rules, CheckTime.RECOVER if is_person_inside else CheckTime.DURING, facts
    )
    if violation is not None:
        raise InterlockError(violation.message, violation.code, holds=violation.rule.holds)
