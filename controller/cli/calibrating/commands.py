"""Arguments and help of `cellctl calibrate camera`."""

from pathlib import Path
from typing import Annotated

import typer

from controller.loading import loading

from ..options import JsonOption


def camera(
    images: Annotated[
        list[Path], typer.Argument(metavar="IMAGE", help="picture of the board, flat or tilted")
    ],
    target: Annotated[
        Path,
        typer.Option(
            "--target", metavar="FILE", help="board, and its position in each picture (JSON)"
        ),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="calibration file to write")
    ],
    json: JsonOption = False,
) -> None:
    """Calibrate a camera from pictures of a board.

    Writes intrinsics, distortion, pose over the table, and the uncertainty of each.
    """
    with loading():
        from .camera_calibration import calibrate_camera

    raise typer.Exit(calibrate_camera(images, target, output, as_json=json))
