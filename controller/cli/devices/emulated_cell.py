"""`cellctl emulate`: the emulated cell for any client."""

import signal
import threading
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

from controller.cad.compiled import load_part
from controller.cell.devices.emulator import emulated_cell, emulator_args, emulator_command
from controller.config import load_cell

from ..inputs.checks import check_control, parse_place, require_files
from ..inputs.part_files import emulated_orientation, for_emulator
from ..terminal.output import emit, print_line


def serve(
    cell_path: Path,
    parts: tuple[Path, ...],
    *,
    speed: float,
    is_on_wall_clock: bool,
    seed: int | None,
    as_built: int | None,
    surfaces: str | None,
    pose: int | None,
    at: str | None,
    control: Path | None,
    lines: str | None,
    as_json: bool,
) -> int:
    """Start the emulated cell, print its addresses, keep it until Ctrl-C; return the exit code.

    Parameters
    ----------
    cell_path : cell file
    parts : CAD files of the parts on the emulated table
    speed : times real time
    is_on_wall_clock : its time runs on while clients or pictures are late
    seed : seed of the emulated world, None to draw one
    as_built : seed of how the emulated cell differs from its file, None for not at all
    surfaces : surfaces of the parts, "plain" or "machined"; None: as `as_built` has it
    pose : stable pose of the first part by index, None to draw it by the seed
    at : planar pose of the first part, "X,Y,THETA_DEG"; None to draw it by the seed
    control : unix socket on which tests inject faults, None for none
    lines : transport of the Modbus lines, None for tcp
    as_json : print addresses as one JSON object

    Raises
    ------
    ConfigError, CadError : a file or an option is wrong
    """
    cell = load_cell(cell_path)
    check_control(control)
    if at is not None:
        parse_place(at, cell)
    require_files(parts)
    compiled = [load_part(part) for part in parts]
    orientation = emulated_orientation(compiled, pose)
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: ended.set())
    more = emulator_args(
        orientation, at, control, as_built, surfaces, is_on_wall_clock=is_on_wall_clock
    )
    if lines is not None:
        more = (*more, "--lines", lines)
    with TemporaryDirectory(prefix="cellctl-emulate-") as folder, ExitStack() as stack:
        files = [
            for_emulator(path, part, Path(folder) / str(number))
            for number, (path, part) in enumerate(zip(parts, compiled, strict=True))
        ]
        command = emulator_command(cell_path, files, speed=speed, seed=seed, more=more)
        ready = stack.enter_context(emulated_cell(command))
        if as_json:
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
