"""Lamps over Modbus: a Waveshare analog output module dims, a relay module switches.

Dark needs both: below their lowest dimming voltage LED drivers are not off for certain, and a
broken dimming wire makes a lamp brighter (modbus_devices.md 6.4). Knows nothing of pictures; it
says from which instant on the light is as asked.
"""

from ._config import LampChannel, LightsConfig
from ._lights import LampState, Lights, LightsReading

__all__ = ["LampChannel", "LampState", "Lights", "LightsConfig", "LightsReading"]
