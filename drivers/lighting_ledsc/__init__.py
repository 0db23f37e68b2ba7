"""Lamps on LedSC controllers: four PWM channels each, over Modbus, with no relay behind.

modbus_devices.md 6.3. A channel at 0 is dark. Knows nothing of pictures; it returns from which
instant on the light is as required.
"""

from dataclasses import dataclass
from typing import Final

from ..kinds import Driver, LampUnit, Site
from ._lights import LedscLights, PwmLamp
from ._registers import CHANNEL_COUNT

__all__ = ["CHANNEL_COUNT", "DRIVER", "LedscLights", "LedscSettings", "PwmLamp"]

MAX_UNIT: Final = 247
MAX_SETTLE_S: Final = 60.0


@dataclass(frozen=True, slots=True)
class LedscSettings:
    """The keys allowed under `settings`.

    Attributes
    ----------
    units : Modbus slave ids; lamps with `analog` 0 to 3 are on the first, 4 to 7 on the second
    settle_s : until the light of a lamp is steady, where the cell file has no time of its own
    """

    units: tuple[int, ...] = (1, 2)
    settle_s: float = 0.05

    def __post_init__(self) -> None:
        if not self.units or len(set(self.units)) < len(self.units):
            raise ValueError(f"units: at least one, all different, not {list(self.units)}")
        for unit in self.units:
            if not 1 <= unit <= MAX_UNIT:
                raise ValueError(f"units: slave ids are 1 to {MAX_UNIT}, not {unit}")
        if not 0 <= self.settle_s <= MAX_SETTLE_S:
            raise ValueError(f"settle_s: 0 to {MAX_SETTLE_S:g} s, not {self.settle_s:g}")


def _build(site: Site, settings: LedscSettings) -> LedscLights:
    lamps = tuple(
        PwmLamp(
            lamp.name,
            *divmod(lamp.analog, CHANNEL_COUNT),
            drive=lamp.drive,
            settle_s=settings.settle_s if lamp.settle_s is None else lamp.settle_s,
        )
        for lamp in site.lamps
    )
    return LedscLights(site.open_link(), lamps, settings.units)


DRIVER: Driver[LampUnit, LedscSettings] = Driver(LedscSettings, _build, node_group="dialout")
