"""`cellctl emulate`: the emulated cell for any client."""

import signal
import threading
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

from controller.cad.compiled import load_part
from controller.cell.devices.emulator import emulated_cell, emulator_args, emulator_command
from controller.config import load_cell

from ..inputs.cell_files import cell_of_this_folder
from ..inputs.checks import check_control, parse_place, require_files
from ..inputs.part_files import emulated_orientation, for_emulator
from ..terminal.output import emit, print_line
from .arguments import EmulateOptions


def serve(options: EmulateOptions) -> int:
    """Start the emulated cell, print its addresses, keep it until Ctrl-C; return the exit code.

    Raises
    ------
    ConfigError, CadError : a file or an option is wrong
    """
    cell_path = options.cell_path or cell_of_this_folder()
    parts = options.parts or []
    cell = load_cell(cell_path)
    check_control(options.control)
    if options.at is not None:
        parse_place(options.at, cell)
    require_files(parts)
    compiled = [load_part(part) for part in parts]
    orientation = emulated_orientation(compiled, options.pose)
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: ended.set())
    more = emulator_args(
        orientation,
        options.at,
        options.control,
        options.as_built,
        options.surfaces,
        is_on_wall_clock=options.is_on_wall_clock,
    )
    if options.lines is not None:
        more = (*more, "--lines", options.lines)
    with TemporaryDirectory(prefix="cellctl-emulate-") as folder, ExitStack() as stack:
        files = [
            for_emulator(path, part, Path(folder) / str(number))
            for number, (path, part) in enumerate(zip(parts, compiled, strict=True))
        ]
        command = emulator_command(
            cell_path, files, speed=options.speed, seed=options.seed, more=more
        )
        ready = stack.enter_context(emulated_cell(command))
        if options.as_json:
            emit(ready)
        else:
            print_line(f"emulated cell ready, {ready['speed']:g} x real time, seed {ready['seed']}")
            for name, where in ready["devices"].items():
                text = (
                    where
                    if isinstance(where, str)
                    else " ".join(f"{k} {v}" for k, v in where.items())
                )
                print_line(f"  {name:11} {text}")
            print_line(f"  {'clock':11} {ready['clock']}")
            print_line(
                "a cell file with all these addresses shares the clock by itself; Ctrl-C ends it"
            )
        ended.wait()
    return 0
