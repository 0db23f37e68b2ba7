"""Arguments and help of `cellctl init`."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from ..options import DensityOption, JsonOption, UnitOption


class DriverKind(StrEnum):
    """Kinds of devices for which a driver is laid out."""

    ARM = "arm"
    CAMERA = "camera"
    GRIPPER = "gripper"
    LIGHTS = "lights"


def init(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="new or empty folder")],
    part: Annotated[
        Path | None,
        typer.Option(
            metavar="CAD",
            help="CAD file to inspect, copied into the project; FILE.step#NAME is one body of "
            "several (default: a part that comes with cellctl)",
        ),
    ] = None,
    unit: UnitOption = None,
    density_g_cm3: DensityOption = None,
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
    `--part`, the part is yours. With `--driver`, create a Python package for a
    device that cellctl does not know.
    """
    if part is None and (unit is not None or density_g_cm3 is not None):
        raise typer.BadParameter("--unit and --density require --part")
    if driver is not None:
        if part is not None:
            raise typer.BadParameter("--driver and --part exclude each other")
        from .starter_driver import lay_out_driver

        of = kind or DriverKind.GRIPPER
        raise typer.Exit(lay_out_driver(folder, driver, of.value, as_json=json))
    if kind is not None:
        raise typer.BadParameter("--kind requires --driver")
    from .starter_project import StarterPart, lay_out_project

    own = None if part is None else StarterPart(part, unit and unit.value, density_g_cm3)
    raise typer.Exit(lay_out_project(folder, own, as_json=json))
