"""Lamps over Modbus: a Waveshare analog output module dims, a relay module switches.

Dark needs both: below their lowest dimming voltage LED drivers are not off for certain, and a
broken dimming wire makes a lamp brighter (modbus_devices.md 6.4). Knows nothing of pictures; it
returns from which instant on the light is as required.
"""

from ..kinds import Driver, LampUnit, NoSettings, Site
from ._config import MAX_MV, LampChannel, LightsConfig
from ._lights import LampState, Lights, LightsReading

__all__ = ["DRIVER", "LampChannel", "LampState", "Lights", "LightsConfig", "LightsReading"]


def _build(site: Site, _: NoSettings) -> Lights:
    # the cell counts channels from 0, the modules' print from 1
    lamps = tuple(
        LampChannel(
            name=lamp.name,
            analog_channel=lamp.analog + 1,
            relay_channel=lamp.relay + 1,
            full_scale_mv=round(lamp.drive * MAX_MV),
            settle_s=lamp.settle_s,
        )
        for lamp in site.lamps
    )
    config = LightsConfig(
        lamps=lamps,
        analog_unit=site.section["analog_unit"],
        relay_unit=site.section["relay_unit"],
    )
    return Lights(site.open_link(), config)


DRIVER: Driver[LampUnit, NoSettings] = Driver(NoSettings, _build, node_group="dialout")
