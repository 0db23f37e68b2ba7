"""The lamp unit of the emulated cell: the one that the cell file's driver speaks to."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol

from emulators.lighting_ledsc import LedscDevice, LedscSupply
from emulators.lighting_modbus import (
    AnalogOutput8Device,
    LampSupply,
    Relay8Device,
    WaveshareSupply,
)
from emulators.modbus import ModbusDevice, Steppable
from emulators.world import DriverChoice, LayoutError

ANALOG_UNIT: Final = 1
RELAY_UNIT: Final = 2


class LampModule(ModbusDevice, Protocol):
    """One module of a lamp unit."""

    @property
    def is_powered(self) -> bool:
        """Whether its supply is on."""
        ...

    @is_powered.setter
    def is_powered(self, is_powered: bool) -> None: ...


@dataclass(frozen=True, slots=True)
class LampUnit:
    """The modules of a lamp unit, and the lamps' drive by them.

    Attributes
    ----------
    modules : by the names that faults know them by
    supply : supply of the lamps
    steppable : those in which time passes
    """

    modules: Mapping[str, LampModule]
    supply: LampSupply
    steppable: tuple[Steppable, ...]


def _waveshare(_: Mapping[str, Any]) -> LampUnit:
    analog, relays = AnalogOutput8Device(ANALOG_UNIT), Relay8Device(RELAY_UNIT)
    supply = WaveshareSupply(analog, relays)
    return LampUnit({"dimmer": analog, "relays": relays}, supply, (relays,))


def _ledsc(settings: Mapping[str, Any]) -> LampUnit:
    units = [int(unit) for unit in settings.get("units", (1, 2))]
    devices = tuple(LedscDevice(unit) for unit in units)
    names = ("dimmer", *(f"dimmer{number}" for number in range(2, len(devices) + 1)))
    modules = dict(zip(names, devices, strict=True))
    return LampUnit(modules, LedscSupply(devices), devices)


DRIVERS: Final[Mapping[str, Callable[[Mapping[str, Any]], LampUnit]]] = {
    "ledsc": _ledsc,
    "waveshare": _waveshare,
}


def make_lamp_unit(choice: DriverChoice | None) -> LampUnit:
    """Return the lamp unit that a driver of the cell file speaks to.

    Parameters
    ----------
    choice : as the cell file has it; None if the cell's unit is a real one

    Raises
    ------
    LayoutError : there is no emulated one for this driver
    """
    chosen = DriverChoice() if choice is None else choice
    driver = chosen.driver or "waveshare"
    if driver not in DRIVERS:
        raise LayoutError(
            f"devices.lights.driver `{driver}` cannot be emulated (emulated: "
            f"{', '.join(sorted(DRIVERS))}); give the address of a real one"
        )
    try:
        return DRIVERS[driver](chosen.settings)
    except (TypeError, ValueError) as error:
        raise LayoutError(f"devices.lights.settings: {error}") from error
