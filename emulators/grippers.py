"""The gripper of the emulated cell: the one that the cell file's driver speaks to."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from emulators.gripper_modbus import JawModel, JawScale, RobotiqConfig, RobotiqDevice
from emulators.gripper_onrobot import RG2, RG6, ComputeBoxDevice, RgDevice
from emulators.modbus import ModbusDevice
from emulators.world import DriverChoice, LayoutError

ROBOTIQ_UNIT: Final = 9
RG_UNIT: Final = 65


@dataclass(frozen=True, slots=True)
class FixedGripper:
    """A gripper, its jaws, and its connection.

    Attributes
    ----------
    jaws : the mechanism
    device : its firmware
    beside : other devices on its line
    has_network : True if it speaks Modbus TCP itself, with no serial line behind
    """

    jaws: JawModel
    device: RobotiqDevice | RgDevice
    beside: tuple[ModbusDevice, ...] = ()
    has_network: bool = False

    @property
    def on_line(self) -> list[ModbusDevice]:
        """All devices on its line."""
        return [self.device, *self.beside]


@dataclass(frozen=True, slots=True)
class JawErrors:
    """Difference of the fixed gripper's true opening from its reading: ``wider + stretch * it``."""

    wider_mm: float = 0.0
    stretch: float = 1.0


def _robotiq(_: Mapping[str, Any], errors: JawErrors) -> FixedGripper:
    jaws = JawModel()
    scale = JawScale(wider_mm=errors.wider_mm, stretch=errors.stretch)
    return FixedGripper(jaws, RobotiqDevice(jaws, ROBOTIQ_UNIT, RobotiqConfig(scale=scale)))


def _onrobot(settings: Mapping[str, Any], _: JawErrors) -> FixedGripper:
    kind = {"rg2": RG2, "rg6": RG6}[settings.get("model", "rg2")]
    widest_mm = kind.widest / 10.0
    jaws = JawModel(opening_mm=widest_mm, target_mm=widest_mm, stroke_mm=widest_mm)
    device = RgDevice(jaws, kind, RG_UNIT)
    return FixedGripper(jaws, device, (ComputeBoxDevice(device),), has_network=True)


DRIVERS: Final[Mapping[str, Callable[[Mapping[str, Any], JawErrors], FixedGripper]]] = {
    "robotiq_2f": _robotiq,
    "onrobot_rg": _onrobot,
}


def make_fixed_gripper(
    choice: DriverChoice | None,
    errors: JawErrors = JawErrors(),
) -> FixedGripper:
    """Return the gripper for a driver of the cell file.

    Parameters
    ----------
    choice : as the cell file has it; None if the cell's gripper is a real one
    errors : errors of its opening; an OnRobot RG, whose fingertips its own settings know, has none

    Raises
    ------
    LayoutError : there is no emulated one for this driver
    """
    chosen = DriverChoice() if choice is None else choice
    driver = chosen.driver or "robotiq_2f"
    if driver not in DRIVERS:
        known = ", ".join(sorted(DRIVERS))
        raise LayoutError(
            f"devices.gripper.driver `{driver}` cannot be emulated (emulated: {known}); give the "
            "address of a real one"
        )
    try:
        return DRIVERS[driver](chosen.settings, errors)
    except (KeyError, TypeError) as error:
        raise LayoutError(f"devices.gripper.settings: {error}") from error
