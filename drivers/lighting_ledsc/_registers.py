"""Register map of an LedSC controller, transcribed: modbus_devices.md 6.3.

Numbers in, numbers out: no link, no clock.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

FIRST_REGISTER: Final = 0  # levels of the four channels, then transition, live, cycle
STATE_COUNT: Final = 7
ADDRESS_REGISTER: Final = 1000
CHANNEL_COUNT: Final = 4
MAX_CYCLE: Final = 255  # limit of channel A, used for all channels so that levels mean the same
AT_ONCE_MS: Final = 0
LIVE: Final = 1  # "0/any"


@dataclass(frozen=True, slots=True)
class State:
    """The settings of a controller.

    Attributes
    ----------
    values : values of the four channels, 0 to `cycle`
    transition_ms : duration of a change
    is_live : True if values take effect as they are written
    cycle : value of full light
    """

    values: tuple[int, ...]
    transition_ms: int
    is_live: bool
    cycle: int

    @property
    def is_ready(self) -> bool:
        """Whether a written value takes effect at once."""
        return self.is_live and self.transition_ms == AT_ONCE_MS


def decode_state(registers: Sequence[int]) -> State:
    """Return the state from registers 0 to 6."""
    *values, transition_ms, live, cycle = registers
    return State(tuple(values), transition_ms, live != 0, cycle)


def encode_values(values: Sequence[int]) -> tuple[int, ...]:
    """Return registers 0 to 5: all four channels, at once and live."""
    return (*values, AT_ONCE_MS, LIVE)
