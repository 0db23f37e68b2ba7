"""Driver of the ACME lamp unit over Modbus: levels 0 to 1 in, registers out.

The unit is invented. Put the register map of your device's manual in place of the first block, with
its sections, and keep the verbs: they are what the cell calls.
"""

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from drivers.errors import RefusedError, WrongDeviceError
from drivers.kinds import Driver, Lamp, LampUnit, Site
from drivers.modbus_link import FunctionCode, ModbusLink, Request, always

# ---- register map; holding registers, zero based: manual, section 3 -----------------------------
LEVEL: Final = 0  # 3.1: one register a channel, from here on
PRODUCT: Final = 200  # 3.4
PRODUCT_NUMBER: Final = 0xAC11  # 3.4
FULL: Final = 1000  # 3.1
CHANNEL_COUNT: Final = 8  # 2.1


@dataclass(frozen=True, slots=True)
class Settings:
    """The keys that `settings:` of the cell file may have.

    Attributes
    ----------
    settle_s : until a lamp's light is steady, where the lamp itself says nothing [s]
    """

    settle_s: float = 0.05


class AcmeLights:
    """All lamps of the cell.

    Parameters
    ----------
    link : the unit's line, shared with other devices; the cell closes it
    unit : its Modbus unit
    lamps : of the cell file
    settings : of the cell file

    Raises
    ------
    ValueError : a lamp is on a channel that the unit does not have
    """

    model = "ACME lamp unit"

    def __init__(
        self, link: ModbusLink, unit: int, lamps: tuple[Lamp, ...], settings: Settings
    ) -> None:
        if beyond := [lamp.name for lamp in lamps if not 0 <= lamp.analog < CHANNEL_COUNT]:
            raise ValueError(f"lights: {', '.join(beyond)}: channels 0 to {CHANNEL_COUNT - 1}")
        # harmless reads whose answers differ in length: after a late answer on a serial line, the
        # link reads them until question and answer are in step again
        probes = tuple(
            Request(FunctionCode.READ_HOLDING_REGISTERS, LEVEL, count) for count in (1, 2)
        )
        self._unit = link.unit(unit, "lights", probes=probes)
        self._lamps = {lamp.name: lamp for lamp in lamps}
        self._settings = settings
        self._clock = link.clock
        self._changing = asyncio.Lock()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all lamps."""
        return tuple(self._lamps)

    async def connect(self) -> int:
        """Check the identity, switch nothing; return the product number.

        Raises
        ------
        WrongDeviceError : another device answers
        """
        try:
            (product,) = await self._unit.read_holding_registers(PRODUCT, 1)
        except RefusedError as error:
            raise WrongDeviceError(f"{self._unit}: expected an {self.model}, {error}") from error
        if product != PRODUCT_NUMBER:
            raise WrongDeviceError(
                f"{self._unit}: expected an {self.model}, found product {product:04X}; check "
                "address and unit"
            )
        return product

    async def set(self, levels: Mapping[str, float], *, settle: bool = False) -> float:
        """Set lamps by name to levels 0 to 1; return the instant from which the light is so [s].

        Raises
        ------
        ValueError : no such lamp, or no such level; nothing has been sent
        """
        if unknown := [name for name in levels if name not in self._lamps]:
            raise ValueError(f"lights: no lamp {', '.join(unknown)}")
        if wrong := [name for name, level in levels.items() if not 0.0 <= level <= 1.0]:
            raise ValueError(f"lights: {', '.join(wrong)}: a level is 0 to 1")
        async with self._changing:
            for name, level in levels.items():
                lamp = self._lamps[name]
                # sets a state: after the answer "later", it may be sent again
                await self._unit.write_register(
                    LEVEL + lamp.analog, round(FULL * level * lamp.drive), again=always
                )
        if settle:
            await self._clock.sleep(max(map(self._settle_s, levels), default=0.0))
        return self._clock.now_s()

    async def all_off(self) -> float:
        """Switch every lamp off; return what `set` returns."""
        return await self.set(dict.fromkeys(self._lamps, 0.0))

    def _settle_s(self, name: str) -> float:
        own_s = self._lamps[name].settle_s
        return self._settings.settle_s if own_s is None else own_s


def _build(site: Site, settings: Settings) -> AcmeLights:
    """Return the lamp unit of a cell file; opens nothing yet."""
    return AcmeLights(site.open_link(), site.section["analog_unit"], site.lamps, settings)


DRIVER: Driver[LampUnit, Settings] = Driver(Settings, _build)
