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
    """Positions that can be taught."""

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


def commission(
    cell: Annotated[
        Path,
        typer.Option("--cell", metavar="FILE", help="cell file (YAML) as drawn; it stays as it is"),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FOLDER",
            help="folder for the new cell file, calibrations and evidence (default: "
            "commissioning/NAME of the cell)",
        ),
    ] = None,
    step: Annotated[
        str | None,
        typer.Option("--step", metavar="NAME", help="repeat one step (default: all that are due)"),
    ] = None,
    status: Annotated[
        bool,
        typer.Option(
            "--status", help="print which steps are done and which calibrations are valid"
        ),
    ] = False,
    yes: Annotated[
        bool,
        typer.Option("--yes", help="answer for the person; emulated cells only"),
    ] = False,
    recipe: Annotated[
        list[Path] | None,
        typer.Option(
            "--recipe",
            metavar="FILE",
            help="recipe whose poses the step `reach` plans; may be repeated (default: the recipes "
            "beside the cell file)",
        ),
    ] = None,
    operator: Annotated[
        str, typer.Option("--operator", metavar="NAME", help="your name (default: the user)")
    ] = "",
    as_built: AsBuiltOption = None,
    seed: SeedOption = None,
    speed: SpeedOption = 1.0,
    control: ControlOption = None,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Commission the cell step by step, with evidence for each.

    Finds the true poses of arm, cameras, grippers and trays, step by step: devices, light, arm and
    cameras, grippers, trays, reach, verification. Finished steps are kept; the next start continues
    with the rest.
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
        help="file of orders, one per line; `-` for standard input (default: keys of this "
        "terminal)",
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
        typer.Option("--yes", help="with --commands: answer for the person; emulated cells only"),
    ] = False,
    operator: Annotated[
        str, typer.Option("--operator", metavar="NAME", help="your name (default: the user)")
    ] = "",
    as_built: AsBuiltOption = None,
    seed: SeedOption = None,
    speed: SpeedOption = 1.0,
    control: ControlOption = None,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Move the arm by keys, slowly.

    Joint by joint, or along the axes of the world and of the tool; also before calibration. Before
    homing it only tries single motors and homes. Space and Esc halt it.
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
        typer.Argument(
            metavar="WHAT", help="accept, reject or quarantine (the trays), park or station"
        ),
    ],
    cell: Annotated[
        Path,
        typer.Option("--cell", metavar="FILE", help="cell file (YAML) to write the position to"),
    ],
    commands: CommandsOption = None,
    yes: Annotated[
        bool,
        typer.Option(
            "--yes",
            help="with --commands: answer for the person, and write; emulated cells only",
        ),
    ] = False,
    operator: Annotated[
        str, typer.Option("--operator", metavar="NAME", help="your name (default: the user)")
    ] = "",
    as_built: AsBuiltOption = None,
    seed: SeedOption = None,
    speed: SpeedOption = 1.0,
    control: ControlOption = None,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Teach the position of a tray, the park or the station.

    Jog there and take the position. Nothing is written before you have seen the difference.
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
