"""The command line of `cellctl recognise`."""

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from ..options import JobsOption, JsonOption, UnitOption


class Lighting(StrEnum):
    """The lighting of a stored picture."""

    AUTO = "auto"
    BACKLIT = "backlit"
    FRONT = "front"


@dataclass(frozen=True, slots=True, kw_only=True)
class RecogniseOptions:
    """The command line of `cellctl recognise`; what each option is stands in its help."""

    images: Annotated[
        list[Path],
        typer.Argument(metavar="IMAGE", help="picture of the table, or folder of pictures"),
    ]
    parts: Annotated[
        list[Path],
        typer.Option(
            "--parts", metavar="PART", help="CAD file, or folder of CAD files; may be repeated"
        ),
    ]
    calibration: Annotated[
        Path, typer.Option("--calibration", metavar="FILE", help="camera calibration (JSON)")
    ]
    lighting: Annotated[Lighting, typer.Option("--lighting", help="lighting of the pictures")] = (
        Lighting.AUTO
    )
    lamps: Annotated[
        int,
        typer.Option(
            "--lamps",
            min=1,
            metavar="N",
            help="pictures in a row that show one scene, each under another lamp, to judge as one; "
            "those of a folder are ordered by name (default: 1)",
            show_default=False,
        ),
    ] = 1
    explain: Annotated[
        Path | None,
        typer.Option(
            "--explain",
            metavar="FOLDER",
            help="write a drawing and tables there that explain each answer",
        ),
    ] = None
    unit: UnitOption = None
    jobs: JobsOption = None
    as_json: JsonOption = False
