"""Arguments and help of `cellctl init`."""

from pathlib import Path
from typing import Annotated

import typer

from ..options import JsonOption


def init(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="new or empty folder")],
    json: JsonOption = False,
) -> None:
    """Create a project folder: recipe, cell file, part, script.

    `check`, `plan` and `run` work in it at once, in the emulated cell.
    """
    from .starter_project import lay_out_project

    raise typer.Exit(lay_out_project(folder, as_json=json))
