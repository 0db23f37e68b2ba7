"""Emulated lamps: Waveshare modules for voltage and relays, and light from both."""

from ._analog_output import AnalogOutput8Device
from ._lamp import LampCharacter, LampModel, LampSupply, LampWiring, WaveshareSupply
from ._relays import Relay8Device

__all__ = [
    "AnalogOutput8Device",
    "LampCharacter",
    "LampModel",
    "LampSupply",
    "LampWiring",
    "Relay8Device",
    "WaveshareSupply",
]
