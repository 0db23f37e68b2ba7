"""`cellctl doctor`: what it takes."""

import typer

from .options import CellOption, JsonOption

EXAMPLE = "cellctl doctor --cell cell.yaml"


def doctor(cell: CellOption = None, json: JsonOption = False) -> None:
    """Check devices, versions and permissions; nothing moves."""
    from ..devices.doctor_checks import examine
    from ..inputs.part_files import cell_of_this_folder

    raise typer.Exit(examine(cell or cell_of_this_folder(), as_json=json))
