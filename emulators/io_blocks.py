"""Which I/O block the emulated cell has: the one that the cell file's driver speaks to."""

from collections.abc import Mapping
from typing import Final

from emulators.io_modbus import E1212, CellSignals, E1214Config, E1214Device
from emulators.world import DriverChoice, LayoutError

CONFIGS: Final[Mapping[str, E1214Config]] = {"moxa_e1212": E1212, "moxa_e1214": E1214Config()}


def make_io_block(choice: DriverChoice | None, signals: CellSignals, unit: int) -> E1214Device:
    """Return the I/O block that a driver of the cell file speaks to.

    Parameters
    ----------
    choice : as the cell file has it; None if the cell's block is a real one
    signals : the contacts behind its inputs
    unit : Modbus unit id

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
    return E1214Device(signals, unit, CONFIGS[driver])
