"""The channels of each lamp, and the voltage of a level.

Sections (§) are those of modbus_devices.md.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

CHANNEL_COUNT: Final = 8  # channels of either module, modbus_devices.md 6.1 and 6.2
MAX_MV: Final = 10_000  # §6.1: the (B) module takes 0..10000 mV


@dataclass(frozen=True, slots=True)
class LampChannel:
    """One lamp: its supply is switched by a relay, its brightness set by 0-10 V.

    Attributes
    ----------
    name : name used in recipes
    analog_channel : output of the analog module as printed on it, 1..8
    relay_channel : relay as printed on the module, 1..8
    full_scale_mv : dimming voltage of level 1 [mV]
    min_on_mv : dimming voltage just above level 0; below about 1 V many LED drivers are not
        defined, modbus_devices.md 6.4 [mV]
    settle_s : until its light is steady [cell s]; None for the unit's figure
    """

    name: str
    analog_channel: int
    relay_channel: int
    full_scale_mv: int = MAX_MV
    min_on_mv: int = 0
    settle_s: float | None = None

    def __post_init__(self) -> None:
        for what, channel in (("analog", self.analog_channel), ("relay", self.relay_channel)):
            if not 1 <= channel <= CHANNEL_COUNT:
                raise ValueError(
                    f"lamp {self.name!r}: {what} channels are 1..{CHANNEL_COUNT} as printed on the "
                    f"module, not {channel}"
                )
        if not 0 <= self.min_on_mv < self.full_scale_mv <= MAX_MV:
            raise ValueError(
                f"lamp {self.name!r}: min_on_mv must be below full_scale_mv, both within "
                f"0..{MAX_MV} mV, not {self.min_on_mv} and {self.full_scale_mv}"
            )

    def level_to_mv(self, level: float) -> int:
        """Return the dimming voltage [mV] of a level 0..1; level 0 is 0 mV.

        Raises
        ------
        ValueError : the level is not between 0 and 1
        """
        if not 0 <= level <= 1:
            raise ValueError(f"lamp {self.name!r}: levels are 0..1, not {level:g}")
        if level == 0:
            return 0
        return round(self.min_on_mv + level * (self.full_scale_mv - self.min_on_mv))

    def mv_to_level(self, voltage_mv: int) -> float:
        """Return the level of a dimming voltage [mV], relay closed."""
        return max(0.0, (voltage_mv - self.min_on_mv) / (self.full_scale_mv - self.min_on_mv))


@dataclass(frozen=True, slots=True)
class LightsConfig:
    """The two modules and the lamps on them.

    Attributes
    ----------
    lamps : all lamps
    analog_unit, relay_unit : slave ids; both modules leave the factory as 1
    settle_s : from the acknowledge until the light is steady, LED driver's ramp included; 20 to
        50 ms, modbus_devices.md 6.4 [cell s]
    relay_settle_s : from closing a relay until the dimming voltage may rise [cell s]
    spacing_s : 3.5 characters at 9600 baud [cell s]
    """

    lamps: tuple[LampChannel, ...]
    analog_unit: int = 1
    relay_unit: int = 2
    settle_s: float = 0.05
    relay_settle_s: float = 0.01
    spacing_s: float = 0.004

    def __post_init__(self) -> None:
        _all_different("lamp names", (lamp.name for lamp in self.lamps))
        _all_different("analog channels", (lamp.analog_channel for lamp in self.lamps))
        _all_different("relay channels", (lamp.relay_channel for lamp in self.lamps))


def _all_different(what: str, values: Iterable[object]) -> None:
    seen: set[object] = set()
    for value in values:
        if value in seen:
            raise ValueError(f"{what} must differ, {value!r} is there twice")
        seen.add(value)
