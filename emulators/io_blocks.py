"""Which I/O block the emulated cell has: the one that the cell file's driver speaks to."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from emulators.io_modbus import E1212, CellSignals, E1214Config, E1214Device
from emulators.world import DriverChoice, LayoutError

CONFIGS: Final[Mapping[str, E1214Config]] = {"moxa_e1212": E1212, "moxa_e1214": E1214Config()}
# What a cell file calls the contacts, in the order of modbus_devices.md 7.4; some have two names.
CONTACTS: Final = (
    ("emergency_stop",),
    ("door",),
    ("part_in_nest",),
    ("part_in_fixed_gripper", "part_in_fixture"),
    ("supply",),
    ("acknowledge",),
)


def make_io_block(
    choice: DriverChoice | None, signals: CellSignals, unit: int, inputs: Mapping[str, int]
) -> E1214Device:
    """Return the I/O block that a driver of the cell file speaks to.

    Parameters
    ----------
    choice : as the cell file has it; None if the cell's block is a real one
    signals : the contacts behind its inputs
    unit : Modbus unit id
    inputs : of the block by contact, as the cell file has them; the others are on the usual ones

    Raises
    ------
    LayoutError : there is no emulated one for this driver
    """
    driver = (choice.driver if choice is not None else "") or "moxa_e1214"
    if driver not in CONFIGS:
        raise LayoutError(
            f"devices.io.driver `{driver}` cannot be emulated (emulated: "
            f"{', '.join(sorted(CONFIGS))}); give the address of a real one"
        )
    config = CONFIGS[driver]
    wired = tuple(
        next((inputs[name] for name in names if name in inputs), usual)
        for names, usual in zip(CONTACTS, config.wired, strict=True)
    )
    return E1214Device(signals, unit, replace(config, wired=wired))
