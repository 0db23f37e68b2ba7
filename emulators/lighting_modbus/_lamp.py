"""Light of one lamp: an LED driver with a 0 to 10 V input behind a relay.

Source: modbus_devices.md 6.4. Voltage dims, and does not darken: below about 0.57 V the light
stays at its lowest level until the relay takes the driver off its supply. A broken dimming wire
is full light. Light rises and falls over some 30 ms and droops a little as the LEDs warm up.
"""

from dataclasses import dataclass
from math import expm1
from typing import Final, Protocol

from ._analog_output import FULL_SCALE_MV, AnalogOutput8Device
from ._relays import Relay8Device

_NEGLIGIBLE: Final = 1e-6


@dataclass(frozen=True, slots=True)
class LampWiring:
    """The connection of a lamp; channels from 0."""

    name: str
    analog_channel: int
    relay_channel: int


@dataclass(frozen=True, slots=True, kw_only=True)
class LampCharacter:
    """Properties of an LED driver and its LEDs.

    Attributes
    ----------
    full_level : light of this lamp when new, as a factor on the nominal one's
    lowest_level : light at 0 mV, as a fraction; reached at this fraction of 10 V
    ramp_s : from dark to full light or back [world s]
    exponent : exponent of light over voltage; 1 is a linear driver
    droop_fraction : light lost when warm
    warm_up_s : time constant of warming up and of cooling down [world s]
    """

    full_level: float = 1.0
    lowest_level: float = 0.057
    ramp_s: float = 0.03
    exponent: float = 1.0
    droop_fraction: float = 0.03
    warm_up_s: float = 120.0


class LampSupply(Protocol):
    """The lamps' drive by the electronics of a make."""

    def drive(self, wiring: LampWiring, character: LampCharacter, *, is_wire_broken: bool) -> float:
        """Return the drive of a lamp's LEDs, 0 to 1.

        Parameters
        ----------
        wiring : its wiring
        character : response of its light to the drive
        is_wire_broken : the wire that dims it
        """
        ...


class WaveshareSupply:
    """An LED driver with a 0 to 10 V input for each lamp, behind its relay.

    Parameters
    ----------
    analog : the module that dims
    relays : the module that switches the supply
    """

    def __init__(self, analog: AnalogOutput8Device, relays: Relay8Device) -> None:
        self._analog = analog
        self._relays = relays

    def drive(self, wiring: LampWiring, character: LampCharacter, *, is_wire_broken: bool) -> float:
        """Return the drive of a lamp's LEDs, 0 to 1.

        Parameters
        ----------
        wiring : its wiring
        character : response of its light to the dimming voltage
        is_wire_broken : the driver sees an open input
        """
        if not self._relays.is_closed(wiring.relay_channel):
            return 0.0
        if is_wire_broken:
            return 1.0
        fraction = self._analog.output_mv(wiring.analog_channel) / FULL_SCALE_MV
        light = fraction if character.exponent == 1.0 else fraction**character.exponent
        return max(light, character.lowest_level)


class LampModel:
    """One lamp.

    Parameters
    ----------
    wiring : its wiring
    supply : supply that dims and switches it
    character : response of its light to the dimming voltage and to time

    Attributes
    ----------
    wiring : its wiring
    is_dimming_wire_broken : state of the dimming wire; its effect is the supply's affair
    is_dead : the LEDs give no light
    strength : strength of the LEDs, as a fraction of what they gave when new
    is_supply_on : the light supply behind the relay
    """

    def __init__(
        self,
        wiring: LampWiring,
        supply: LampSupply,
        character: LampCharacter | None = None,
    ) -> None:
        self.wiring = wiring
        self.is_dimming_wire_broken = False
        self.is_dead = False
        self.strength = 1.0
        self.is_supply_on = True
        self._supply = supply
        self._character = LampCharacter() if character is None else character
        self._drive = 0.0  # what the driver gives the LEDs, 0 to 1
        self._warmth = 0.0  # 0 cold, 1 after long full light

    @property
    def level(self) -> float:
        """The light as a fraction of the cold nominal lamp's full light."""
        if self.is_dead:
            return 0.0
        character = self._character
        cold = self.strength * character.full_level * self._drive
        return cold * (1.0 - character.droop_fraction * self._warmth)

    def advance(self, dt_s: float) -> None:
        """Let time pass [world s]."""
        character = self._character
        away = self._asked_drive() - self._drive
        if away:
            reach = dt_s / character.ramp_s
            self._drive += max(-reach, min(reach, away))
        cold = self._drive - self._warmth
        if abs(cold) > _NEGLIGIBLE:
            self._warmth -= cold * expm1(-dt_s / character.warm_up_s)

    def _asked_drive(self) -> float:
        if not self.is_supply_on:
            return 0.0
        broken = self.is_dimming_wire_broken
        return self._supply.drive(self.wiring, self._character, is_wire_broken=broken)
