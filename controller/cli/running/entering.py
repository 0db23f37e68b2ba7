"""Entering and leaving a cell: signals heard, lock held, the emulated cell beside it if any.

Code shared by `commission`, `jog`, `teach` and `run --dry`.
"""

import getpass
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from controller.cell.control import socket_path
from controller.cell.devices.clocks import FoundClock, find_clock
from controller.cell.devices.emulator import emulated_cell, emulator_args, emulator_command
from controller.cell.lock import Holder, hold_cell, require_free_cell
from controller.config import Cell, ConfigError

from ..devices.doctor_checks import machine_checks
from ..inputs.checks import MIN_FREE_BYTES, check_control, check_writable_folder
from ..options import EmulatedOptions
from ..terminal.output import warn
from .ends import CommandEnds


@dataclass(frozen=True, slots=True, kw_only=True)
class Entered:
    """The resources of a command in the cell.

    Attributes
    ----------
    ends : signals, to be turned into a stop
    holder : holder of the lock
    ready : report of the emulator about itself; empty without one
    clock : clock of the cell
    control : unix socket of the emulated cell's control port
    """

    ends: CommandEnds
    holder: Holder
    ready: dict[str, Any]
    clock: FoundClock
    control: Path


def user_name() -> str:
    """Return the name of the user who started this process; empty if the system has none."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a container may have no name for its user
        return ""


def is_all_emulated(cell: Cell) -> bool:
    """Return whether no device of a cell is real, as far as its file and clocks show."""
    return find_clock(cell, {}).path is not None or (
        len(cell.emulated_devices) == len(type(cell.devices).model_fields)
    )


def check_entering(
    options: EmulatedOptions, cell: Cell, folder: Path, folder_option: str, *, answers: bool
) -> None:
    """Check everything that can be checked before the start.

    Parameters
    ----------
    options : options of the command line
    cell : cell to enter
    folder : folder of the journal
    folder_option : option by which it was given
    answers : a helper answers for the person

    Raises
    ------
    ConfigError : an option is wrong, or the machine lacks something
    CellError : another process has the cell
    """
    check_writable_folder(folder, folder_option, MIN_FREE_BYTES)
    require_free_cell(folder, cell)
    check_control(options.control)
    if answers and not is_all_emulated(cell):
        raise ConfigError(
            "--yes answers for a person, and this cell has real devices: somebody has to stand "
            "at the emergency stop. Start the command in a terminal, without --yes"
        )
    if not cell.emulated_devices:
        given = {
            "--as-built": options.as_built,
            "--seed": options.seed,
            "--speed": None if options.speed == 1.0 else options.speed,
        }
        for option, value in given.items():
            if value is not None:
                raise ConfigError(
                    f"{option}: none of this cell's devices is `emulated`; leave it out"
                )
    for check in machine_checks(cell, folder):
        if not check["ok"]:
            raise ConfigError(f"{check['check']}: {check['found']}: {check['remedy']}")


@contextmanager
def entered(
    options: EmulatedOptions, cell_path: Path, cell: Cell, folder: Path, run_name: str
) -> Iterator[Entered]:
    """Hear signals, take the cell's lock, start the emulated cell, and yield all three.

    Parameters
    ----------
    options : options of the command line
    cell_path, cell : its file, and what it describes
    folder : folder of the journal
    run_name : name for a caller who is refused the lock meanwhile

    Raises
    ------
    CellError : another process has the cell, or the emulated cell does not start
    """
    folder.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        ends = stack.enter_context(CommandEnds().heard())
        holder = stack.enter_context(hold_cell(folder, cell, run_name, socket_path(folder)))
        control = options.control
        if control is None:
            # short, whatever the folder is called: the name of a socket has 107 bytes at most
            place = stack.enter_context(tempfile.TemporaryDirectory(prefix="cellctl-"))
            control = Path(place) / "control"
        begun: Any = nullcontext({})
        if cell.emulated_devices:
            more = emulator_args(None, None, control, options.as_built)
            command = emulator_command(
                cell_path, (), speed=options.speed, seed=options.seed, more=more
            )
            begun = emulated_cell(command, folder / "emulator.log")
            warn(f"EMULATED: {', '.join(cell.emulated_devices)} ({options.speed:g} x real time)")
        ready = stack.enter_context(begun)
        clock = find_clock(cell, ready)
        if cell.emulated_devices and clock.path is not None:
            clock = replace(clock, speed=options.speed)
        yield Entered(ends=ends, holder=holder, ready=ready, clock=clock, control=control)
