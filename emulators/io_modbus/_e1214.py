"""Moxa ioLogik E1214: six inputs and six relays on Modbus TCP, with the factory's register map.

With another configuration it is the E1212 beside it, which has eight of each (§7.2).

Sources: modbus_devices.md 7.1 (map), §7.4 (what is wired where in this cell). Peer-to-peer I/O and
the web console are not emulated; their status bits read 0.

Sections (§) are those of modbus_devices.md.
"""

from ._map import E1214Config, build_map
from ._signals import CellSignals
from ._state import BlockState


class E1214Device:
    """The block. `advance` samples the contacts, runs pulse trains and the watchdog.

    Parameters
    ----------
    signals : the contacts behind the inputs; healthy ones by default
    unit : Modbus unit id
    config : settings of its web console

    Attributes
    ----------
    unit : Modbus number
    signals : the contacts behind the inputs
    broken_wires : inputs whose wire is off; they read 0
    is_powered : off, the block is silent and its relays are open
    is_watchdog_off : somebody has switched it off in the web console
    is_motor_relay_bridged : its contact is not in the motors' supply after all
    """

    hears_broadcast = False

    def __init__(
        self,
        signals: CellSignals | None = None,
        unit: int = 1,
        config: E1214Config | None = None,
    ) -> None:
        self.unit = unit
        self.signals = CellSignals() if signals is None else signals
        self.broken_wires: set[int] = set()
        self.is_watchdog_off = False
        self.is_motor_relay_bridged = False
        self._config = E1214Config() if config is None else config
        self._is_powered = True
        self._boot()

    def _boot(self) -> None:
        self._state = BlockState(len(self._config.safe_state))
        self._sampled: tuple[bool, ...] = ()
        self._points = build_map(self._state, self.inputs, self._config)

    @property
    def is_powered(self) -> bool:
        """Whether the supply is on."""
        return self._is_powered

    @is_powered.setter
    def is_powered(self, is_powered: bool) -> None:
        self._is_powered = is_powered
        if not is_powered:
            self._boot()

    def is_closed(self, relay: int) -> bool:
        """Return whether a relay's contact is closed, channels from 0."""
        return self._state.relays[relay].is_closed

    @property
    def passes_motor_supply(self) -> bool:
        """Whether the contact in the supply of the arm's motors, if there is one, is closed."""
        relay = self._config.motor_relay
        return relay is None or self.is_motor_relay_bridged or self.is_closed(relay)

    def inputs(self) -> tuple[bool, ...]:
        """Return the inputs as the block reads them; unwired ones read 0."""
        signals = self.signals
        contacts = [False] * self._state.channel_count
        on_them = (
            signals.is_estop_chain_ok,
            signals.is_door_closed,
            signals.is_part_in_nest,
            signals.is_part_between_jaws,
            signals.is_24v_ok,
            signals.is_operator_acknowledging,
        )
        for number, is_on in zip(self._config.wired, on_them, strict=True):
            contacts[number] = is_on
        return tuple(on and n not in self.broken_wires for n, on in enumerate(contacts))

    def request(self, pdu: bytes, now_s: float) -> bytes | None:
        """Return the reply to one request; None without power."""
        if not self._is_powered:
            return None
        self._state.idle_s = 0.0
        self._sample()
        return self._points.answer(pdu)

    def advance(self, dt_s: float) -> None:
        """Let time pass [world s]."""
        if not self._is_powered:
            return
        state = self._state
        state.uptime_s += dt_s
        state.idle_s += dt_s
        self._sample()
        for relay in state.relays:
            if relay.is_pulsing:
                relay.advance(dt_s)
        limit_s = None if self.is_watchdog_off else self._config.watchdog_s
        if limit_s is not None and state.idle_s >= limit_s and not state.has_watchdog_bitten:
            state.bite(self._config.safe_state)

    def _sample(self) -> None:
        inputs = self.inputs()
        if inputs == self._sampled:
            return
        self._sampled = inputs
        for counter, is_on in zip(self._state.counters, inputs, strict=True):
            counter.see(is_on)
