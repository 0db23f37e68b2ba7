"""Arguments and help of `cellctl init`."""

from pathlib import Path
from typing import Annotated

import typer

from ..options import JsonOption


def init(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="new or empty folder")],
    json: JsonOption = False,
) -> None:
    """Lay out a new project: recipe, cell file, part, script.

    It runs as it stands, in the emulated cell.
    """
    from .starter_project import lay_out_project

    raise typer.Exit(lay_out_project(folder, as_json=json))
