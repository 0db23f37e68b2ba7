"""Arguments and help of `cellctl doctor` and `emulate`."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from controller.loading import loading

from ..options import (
    AsBuiltOption,
    CellOption,
    ControlOption,
    EmulatedAtOption,
    EmulatedPoseOption,
    JsonOption,
    SeedOption,
    SpeedOption,
    SurfacesOption,
    WallClockOption,
    finite,
)


def doctor(
    cell: CellOption = None,
    runs: Annotated[
        Path | None,
        typer.Option(
            "--runs",
            metavar="FOLDER",
            help="folder of runs whose lock to hold meanwhile, so that no run starts (default: "
            "none)",
        ),
    ] = None,
    pictures: Annotated[
        Path | None,
        typer.Option(
            "--pictures",
            metavar="FOLDER",
            help="write a picture of each camera under two lamps there; goes with --runs",
        ),
    ] = None,
    watch: Annotated[
        float,
        typer.Option(
            "--watch",
            metavar="SECONDS",
            min=0,
            max=3600,
            callback=finite,
            help="repeat the pictures for this long; the last ones are kept",
        ),
    ] = 0.0,
    json: JsonOption = False,
) -> None:
    """Check devices, versions and permissions; nothing moves.

    Each device has to be reachable and the right one. `pytest --cell FILE` also tests the duties of
    a driver (docs/drivers.md).
    """
    with loading():
        from ..inputs.cell_files import cell_of_this_folder
        from .doctor_checks import Looking, examine

    looking = Looking(runs, pictures, watch)
    raise typer.Exit(examine(cell or cell_of_this_folder(), looking, as_json=json))


class Lines(StrEnum):
    """Transport of the emulated Modbus lines."""

    TCP = "tcp"
    RTU_PTY = "rtu-pty"
    RTU_TCP = "rtu-tcp"


def emulate(
    cell: CellOption = None,
    part: Annotated[
        list[Path] | None,
        typer.Option(
            "--part",
            metavar="PART",
            help="CAD file of a part to put on the table; may be repeated (default: none)",
        ),
    ] = None,
    speed: SpeedOption = 1.0,
    wall_clock: WallClockOption = False,
    seed: SeedOption = None,
    as_built: AsBuiltOption = None,
    surfaces: SurfacesOption = None,
    pose: EmulatedPoseOption = None,
    at: EmulatedAtOption = None,
    control: ControlOption = None,
    lines: Annotated[
        Lines | None, typer.Option("--lines", help="transport of the Modbus lines (default: tcp)")
    ] = None,
    json: JsonOption = False,
) -> None:
    """Start the emulated cell for any client; Ctrl-C ends it.

    Prints the address of every device.
    """
    with loading():
        from ..inputs.cell_files import cell_of_this_folder
        from .emulated_cell import serve

    code = serve(
        cell or cell_of_this_folder(),
        tuple(part or ()),
        speed=speed,
        is_on_wall_clock=wall_clock,
        seed=seed,
        as_built=as_built,
        surfaces=surfaces and surfaces.value,
        pose=pose,
        at=at,
        control=control,
        lines=lines and lines.value,
        as_json=json,
    )
    raise typer.Exit(code)
