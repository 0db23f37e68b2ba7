"""The I/O block of the emulated cell: the one that the cell file's driver speaks to."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from emulators.io_modbus import E1212, CellSignals, E1214Config, E1214Device
from emulators.world import DriverChoice, LayoutError

CONFIGS: Final[Mapping[str, E1214Config]] = {"moxa_e1212": E1212, "moxa_e1214": E1214Config()}
WATCHDOG_S: Final = 1.0  # the shortest that the web console takes; modbus_devices.md 7.1
# Names of the contacts in a cell file, in the order of modbus_devices.md 7.4; some have two names.
CONTACTS: Final = (
    ("emergency_stop",),
    ("door",),
    ("part_in_nest",),
    ("part_in_fixed_gripper", "part_in_fixture"),
    ("supply",),
    ("acknowledge",),
)


def make_io_block(
    choice: DriverChoice | None,
    signals: CellSignals,
    unit: int,
    inputs: Mapping[str, int],
    outputs: Mapping[str, int],
) -> E1214Device:
    """Return the I/O block that a driver of the cell file speaks to.

    Parameters
    ----------
    choice : as the cell file has it; None if the cell's block is a real one
    signals : the contacts behind its inputs
    unit : Modbus unit id
    inputs : inputs of the block by contact, as in the cell file; the others are on the usual ones

    outputs : outputs of the block by 24 V signal, as in the cell file

    The settings ``motor_relay`` and ``watchdog_s`` of the cell file are those that an installer has
    wired and set in the block's web console. Where the cell file relies on no output, its watchdog
    is off, as delivered.

    Raises
    ------
    LayoutError : there is no emulated one for this driver, or the block has no such relay
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
    config = replace(config, wired=wired)
    settings = {} if choice is None else choice.settings
    relay = settings.get("motor_relay")
    relied_on = {f"outputs.{name}": channel for name, channel in outputs.items()}
    if relay is not None:
        relied_on["devices.io.settings.motor_relay"] = int(relay)
        config = replace(config, motor_relay=int(relay))
    for key, channel in relied_on.items():
        if not 0 <= channel < len(config.safe_state):
            raise LayoutError(f"{key}: 0 to {len(config.safe_state) - 1}, not {channel}")
    if relied_on:
        config = replace(config, watchdog_s=float(settings.get("watchdog_s", WATCHDOG_S)))
    return E1214Device(signals, unit, config)
