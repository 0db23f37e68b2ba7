"""`cellctl recover`: what it takes."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from .options import CellOption, JsonOption, RunsOption

EXAMPLE = "cellctl recover --cell cell.yaml --open arm"


class Gripper(StrEnum):
    """Which gripper."""

    ARM = "arm"
    FIXED = "fixed"


def recover(
    cell: CellOption = None,
    open_: Annotated[
        Gripper | None,
        typer.Option(
            "--open", help="gripper to open while you hold the part; the arm does not move"
        ),
    ] = None,
    yes: Annotated[
        bool, typer.Option("--yes", help="state that you hold the part; do not ask")
    ] = False,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Report what the grippers may hold after a crash; open one of them."""
    from controller.cell.custody import GripperName

    from ..inputs.part_files import cell_of_this_folder
    from ..running.release import recover_cell

    gripper = None if open_ is None else GripperName[open_.name]
    code = recover_cell(
        cell or cell_of_this_folder(), runs, gripper, is_confirmed=yes, as_json=json
    )
    raise typer.Exit(code)
