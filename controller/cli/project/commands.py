"""Arguments and help of `cellctl init`."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from ..options import JsonOption


class DriverKind(StrEnum):
    """Kinds of devices for which a driver is laid out."""

    ARM = "arm"
    CAMERA = "camera"
    GRIPPER = "gripper"
    LIGHTS = "lights"


def init(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="new or empty folder")],
    driver: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="lay out a package with a driver of your own instead, its emulator and tests; "
            "cell files name it so",
        ),
    ] = None,
    kind: Annotated[
        DriverKind | None,
        typer.Option(
            help="device of that driver (default: gripper); gripper and lights are on Modbus"
        ),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Create a project folder: recipe, cell file, part, script.

    `check`, `plan` and `run` work in it at once, in the emulated cell. With
    `--driver`, create a Python package for a device that cellctl does not know.
    """
    if driver is not None:
        from .starter_driver import lay_out_driver

        of = kind or DriverKind.GRIPPER
        raise typer.Exit(lay_out_driver(folder, driver, of.value, as_json=json))
    if kind is not None:
        raise typer.BadParameter("--kind requires --driver")
    from .starter_project import lay_out_project

    raise typer.Exit(lay_out_project(folder, as_json=json))
