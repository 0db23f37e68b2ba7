"""Arguments and help of `cellctl commission`, `jog`, `teach` and `print-target`."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from controller.loading import loading

from ..options import JsonOption, finite, from_fields
from .arguments import GuidedOptions, JogOptions, TeachOptions


class Paper(StrEnum):
    """A size of paper."""

    A4 = "a4"
    A3 = "a3"
    LETTER = "letter"


def print_target(
    board: Annotated[
        Path,
        typer.Argument(
            metavar="BOARD",
            help="board file (JSON), or the name of a board that comes with cellctl: charuco, "
            "chessboard, paddle or gauge",
        ),
    ] = Path("charuco"),
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="PDF to write, its board file beside it (default: BOARD.pdf in this folder)",
        ),
    ] = None,
    paper: Annotated[Paper, typer.Option("--paper", help="size of the paper")] = Paper.A4,
    squares: Annotated[
        str | None,
        typer.Option(
            "--squares", metavar="CxR", help="squares across and down (default: as in BOARD)"
        ),
    ] = None,
    square_mm: Annotated[
        float | None,
        typer.Option(
            "--square-mm",
            metavar="MM",
            callback=finite,
            help="side of a square; its marker grows with it (default: as in BOARD)",
        ),
    ] = None,
    measured_mm: Annotated[
        float | None,
        typer.Option(
            "--measured-mm",
            metavar="MM",
            callback=finite,
            help="measured length of all squares across, on the glued board; writes the board file "
            "with the true size, and no PDF",
        ),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Write a calibration board as PDF, true to scale.

    The PDF has a ruler, and the board file beside it describes the board. Print the PDF, glue it,
    and give the measured length by --measured-mm.
    """
    with loading():
        from .board_sheet import write_sheet

    code = write_sheet(
        board,
        output,
        paper=paper.value,
        squares=squares,
        square_mm=square_mm,
        measured_mm=measured_mm,
        as_json=json,
    )
    raise typer.Exit(code)


@from_fields
def commission(options: GuidedOptions) -> None:
    """Commission the cell step by step, with evidence for each.

    Finds the true poses of arm, cameras, grippers and trays, step by step: devices, light, arm and
    cameras, grippers, trays, reach, verification. Finished steps are kept; the next start continues
    with the rest.
    """
    with loading():
        from .guided import guide

    raise typer.Exit(guide(options))


@from_fields
def jog(options: JogOptions) -> None:
    """Move the arm by keys, slowly.

    Joint by joint, or along the axes of the world and of the tool; also before calibration. Before
    homing it only tries single motors and homes. Space and Esc halt it.
    """
    with loading():
        from .jogging import jog_cell

    raise typer.Exit(jog_cell(options))


@from_fields
def teach(options: TeachOptions) -> None:
    """Teach the position of a tray, the park or the station.

    Jog there and take the position. Nothing is written before you have seen the difference.
    """
    with loading():
        from .teaching import teach as teach_cell

    raise typer.Exit(teach_cell(options))
