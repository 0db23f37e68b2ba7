"""Arguments and help of `cellctl commission` and `print-target`."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from controller.loading import loading

from ..options import (
    AsBuiltOption,
    ControlOption,
    JsonOption,
    RunsOption,
    SeedOption,
    SpeedOption,
    finite,
)


class Teachable(StrEnum):
    """What can be taught."""

    ACCEPT = "accept"
    REJECT = "reject"
    QUARANTINE = "quarantine"
    PARK = "park"
    STATION = "station"


class Paper(StrEnum):
    """A size of paper."""

    A4 = "a4"
    A3 = "a3"
    LETTER = "letter"


def print_target(
    board: Annotated[
        Path,
        typer.Argument(
            metavar="[BOARD]",
            help="board file (JSON), or the name of a board that comes with cellctl: charuco, "
            "chessboard, paddle or gauge (default: charuco)",
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
    paper: Annotated[
        Paper, typer.Option("--paper", help="size of the paper (default: a4)")
    ] = Paper.A4,
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
            help="length of all squares across as measured on the glued board; writes the board "
            "file with the true size and no PDF",
        ),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Write a board to print, true to scale with a ruler, and its board file.

    Measure the glued board, then give its true length by --measured-mm.
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


def commission(
    cell: Annotated[
        Path,
        typer.Option("--cell", metavar="FILE", help="cell file as drawn (YAML); it is not changed"),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FOLDER",
            help="folder of what is found: cell file, calibrations, evidence (default: "
            "commissioning/NAME of the cell)",
        ),
    ] = None,
    step: Annotated[
        str | None,
        typer.Option("--step", metavar="NAME", help="repeat one step (default: all that are due)"),
    ] = None,
    status: Annotated[
        bool,
        typer.Option("--status", help="print which steps are done and which calibrations count"),
    ] = False,
    yes: Annotated[
        bool,
        typer.Option("--yes", help="answer for the person, on an emulated cell alone"),
    ] = False,
    recipe: Annotated[
        list[Path] | None,
        typer.Option(
            "--recipe",
            metavar="FILE",
            help="recipe whose poses the step `reach` plans; may be given again (default: the "
            "recipes beside the cell file)",
        ),
    ] = None,
    operator: Annotated[
        str, typer.Option("--operator", metavar="NAME", help="who commissions (default: the user)")
    ] = "",
    as_built: AsBuiltOption = None,
    seed: SeedOption = None,
    speed: SpeedOption = 1.0,
    control: ControlOption = None,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Find out how the cell really stands: step by step, each with its own evidence.

    What is done stays; the next start goes on with what is not.
    """
    with loading():
        from ..running.entering import EmulatedOptions
        from .guided import GuidedOptions, guide

    code = guide(
        GuidedOptions(
            cell_path=cell,
            out=out,
            step=step,
            operator=operator,
            recipes=tuple(recipe or ()),
            emulated=EmulatedOptions(
                as_built=as_built, seed=seed, speed=speed, control=control, answers=yes
            ),
            runs=runs,
            as_json=json,
        ),
        status_only=status,
    )
    raise typer.Exit(code)


CommandsOption = Annotated[
    Path | None,
    typer.Option(
        "--commands",
        metavar="FILE",
        help="file of orders, one a line; `-` for standard input (default: keys in this terminal)",
    ),
]


def jog(
    cell: Annotated[
        Path,
        typer.Option("--cell", metavar="FILE", help="cell file (YAML), calibrated or not"),
    ],
    commands: CommandsOption = None,
    yes: Annotated[
        bool,
        typer.Option(
            "--yes", help="with --commands: answer for the person, on an emulated cell alone"
        ),
    ] = False,
    operator: Annotated[
        str, typer.Option("--operator", metavar="NAME", help="who jogs (default: the user)")
    ] = "",
    as_built: AsBuiltOption = None,
    seed: SeedOption = None,
    speed: SpeedOption = 1.0,
    control: ControlOption = None,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Move the arm by keys, slowly: joint by joint, or along the axes of the world and the tool.

    Before homing it only tries single motors and homes. Space and Esc halt it.
    """
    with loading():
        from ..running.entering import EmulatedOptions
        from .jogging import JogOptions, jog_cell

    code = jog_cell(
        JogOptions(
            cell_path=cell,
            runs_dir=runs,
            commands=commands,
            operator=operator,
            emulated=EmulatedOptions(
                as_built=as_built, seed=seed, speed=speed, control=control, answers=yes
            ),
            as_json=json,
        )
    )
    raise typer.Exit(code)


def teach(
    what: Annotated[
        Teachable,
        typer.Argument(metavar="WHAT", help="tray accept, reject or quarantine; park; or station"),
    ],
    cell: Annotated[
        Path,
        typer.Option("--cell", metavar="FILE", help="cell file (YAML) that gets what was taught"),
    ],
    commands: CommandsOption = None,
    yes: Annotated[
        bool,
        typer.Option(
            "--yes",
            help="with --commands: answer for the person, on an emulated cell alone, and write",
        ),
    ] = False,
    operator: Annotated[
        str, typer.Option("--operator", metavar="NAME", help="who teaches (default: the user)")
    ] = "",
    as_built: AsBuiltOption = None,
    seed: SeedOption = None,
    speed: SpeedOption = 1.0,
    control: ControlOption = None,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Jog to where a tray, the park or the station is, and take it.

    Nothing is written before you have seen the difference.
    """
    with loading():
        from ..running.entering import EmulatedOptions
        from .jogging import JogOptions
        from .teaching import teach as teach_cell

    code = teach_cell(
        JogOptions(
            cell_path=cell,
            runs_dir=runs,
            commands=commands,
            operator=operator,
            emulated=EmulatedOptions(
                as_built=as_built, seed=seed, speed=speed, control=control, answers=yes
            ),
            as_json=json,
            name="teach",
        ),
        what.value,
        writes=yes,
    )
    raise typer.Exit(code)
