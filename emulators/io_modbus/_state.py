"""An ioLogik's memory while it has power: counters, relays, pulse trains, watchdog.

Source: modbus_devices.md 7.1.
"""

from dataclasses import dataclass, field
from typing import Final

CHANNEL_COUNT: Final = 6
PULSE_UNIT_S: Final = 1.5  # unit of on and off widths
COUNTER_END: Final = 1 << 32


@dataclass(slots=True)
class EdgeCounter:
    """Counts closing edges of one input.

    Attributes
    ----------
    is_running : counting; stopped, edges are missed
    count : 32 bits; starts again at 0 after its end, and tells by `has_overflowed`
    """

    is_running: bool = False
    count: int = 0
    has_overflowed: bool = False
    _was_on: bool = False

    def see(self, is_on: bool) -> None:
        """Take the input's present state."""
        if is_on and not self._was_on and self.is_running:
            self.count += 1
            if self.count == COUNTER_END:
                self.count = 0
                self.has_overflowed = True
        self._was_on = is_on

    def run(self, is_running: bool) -> None:
        """Start or stop counting."""
        self.is_running = is_running

    def clear_count(self) -> None:
        """Start again at 0."""
        self.count = 0

    def clear_overflow(self) -> None:
        """Forget that the count passed its end."""
        self.has_overflowed = False


@dataclass(slots=True)
class RelayChannel:
    """One relay with its counters of switching and its pulse train.

    Attributes
    ----------
    is_closed : the contact
    total_count, current_count : closings since manufacture and since the last reset
    pulse_count : pulses of a train; 0: without end
    on_units, off_units : widths of a pulse and of the pause after it [1.5 s]
    is_pulsing : a train is running
    is_held : the block is in its safe state, where commands are answered and change nothing
    """

    is_closed: bool = False
    total_count: int = 0
    current_count: int = 0
    pulse_count: int = 0
    on_units: int = 1
    off_units: int = 1
    is_pulsing: bool = False
    is_held: bool = False
    _left_s: float = 0.0
    _pulses_done: int = 0

    def switch(self, is_closed: bool) -> None:
        """Close or open the contact."""
        if is_closed and not self.is_closed:
            self.total_count = (self.total_count + 1) % COUNTER_END
            self.current_count = (self.current_count + 1) % COUNTER_END
        self.is_closed = is_closed

    def command(self, is_closed: bool) -> None:
        """Close or open the contact by a master's word, which ends a pulse train."""
        if self.is_held:
            return
        self.is_pulsing = False
        self.switch(is_closed)

    def clear_current_count(self) -> None:
        """Begin a new count of closings."""
        self.current_count = 0

    def set_pulsing(self, is_pulsing: bool) -> None:
        """Start a pulse train from its beginning, or end it with the contact open."""
        if self.is_held:
            return
        self.is_pulsing = is_pulsing
        self._pulses_done = 0
        self._left_s = self.on_units * PULSE_UNIT_S
        self.switch(is_pulsing)

    def advance(self, dt_s: float) -> None:
        """Let time pass [world s]."""
        if not self.is_pulsing:
            return
        self._left_s -= dt_s
        if self._left_s > 0.0:
            return
        if self.is_closed:
            self.switch(False)
            self._left_s += self.off_units * PULSE_UNIT_S
            self._pulses_done += 1
            self.is_pulsing = self._pulses_done != self.pulse_count
        else:
            self.switch(True)
            self._left_s += self.on_units * PULSE_UNIT_S


@dataclass(slots=True)
class BlockState:
    """The whole state, fresh at power-up.

    Attributes
    ----------
    channel_count : inputs, and as many relays
    uptime_s, idle_s : since power-up and since the last request [world s]
    has_watchdog_bitten : the alarm flag, until it is cleared
    """

    channel_count: int = CHANNEL_COUNT
    relays: tuple[RelayChannel, ...] = field(init=False)
    counters: tuple[EdgeCounter, ...] = field(init=False)
    uptime_s: float = 0.0
    idle_s: float = 0.0
    has_watchdog_bitten: bool = False

    def __post_init__(self) -> None:
        self.relays = tuple(RelayChannel() for _ in range(self.channel_count))
        self.counters = tuple(EdgeCounter() for _ in range(self.channel_count))

    def bite(self, safe_state: tuple[bool, ...]) -> None:
        """Bring the relays to their safe state, and keep them there until the flag is cleared."""
        self.has_watchdog_bitten = True
        for relay, is_closed in zip(self.relays, safe_state, strict=True):
            relay.is_pulsing = False
            relay.switch(is_closed)
            relay.is_held = True

    def clear_watchdog(self, _: int = 0) -> None:
        """Clear the alarm flag; the relays stay unchanged and obey again."""
        self.has_watchdog_bitten = False
        for relay in self.relays:
            relay.is_held = False
