"""Arguments and help of `cellctl doctor` and `emulate`."""

from pathlib import Path
from typing import Annotated

import typer

from controller.loading import loading

from ..options import (
    CellOption,
    JsonOption,
    finite,
    from_fields,
)
from .arguments import EmulateOptions


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


@from_fields
def emulate(options: EmulateOptions) -> None:
    """Start the emulated cell for any client; Ctrl-C ends it.

    Prints the address of every device.
    """
    with loading():
        from .emulated_cell import serve

    raise typer.Exit(serve(options))
