"""`cellctl print-target`: a board as PDF, and the board file that describes the print."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from controller.bring_up.target_sheet import sheet_pdf
from controller.bring_up.target_sheet.areas import SheetError
from controller.calibration.target import BoardSection, load_board
from controller.config import ConfigError
from controller.config.shipped import SHIPPED
from controller.results.pages import write_file

from ..inputs.checks import check_writable_folder
from ..terminal.output import emit, print_line

BOARDS: Final = SHIPPED / "boards"
# A printer is off by some tenths of a percent; a board off by more was fitted to the page.
SCALE_LIMIT: Final = 0.03


def write_sheet(
    board_file: Path,
    output: Path | None,
    *,
    paper: str,
    squares: str | None,
    square_mm: float | None,
    measured_mm: float | None,
    as_json: bool,
) -> int:
    """Write PDF and board file, or with `measured_mm` the board file alone; return the exit code.

    Parameters
    ----------
    board_file : board file, or the name of a board that comes with cellctl
    output : the PDF; the board file has its name with the suffix .json
    paper : a key of `PAPERS_MM`
    squares : "CxR", squares across and down; None for those of the file
    square_mm : side of a square; None for that of the file
    measured_mm : true length of all squares across; None if nobody has measured it
    as_json : print the result as one JSON object

    Raises
    ------
    ConfigError : a file or an option is wrong, or the board is larger than the paper
    PdfError : this machine can make no PDF
    """
    source = find_board_file(board_file)
    board = _changed(load_board(source), squares, square_mm)
    pdf = output or Path(f"{source.stem}.pdf")
    if pdf.suffix.lower() != ".pdf":
        raise ConfigError(f"--output {pdf}: the sheet is a PDF; name a file that ends in .pdf")
    target = pdf.with_suffix(".json")
    check_writable_folder(pdf.parent, "--output in")
    written = {"board": str(target)}
    if measured_mm is None:
        try:
            data = sheet_pdf(board, source.stem, paper)
        except SheetError as error:
            raise ConfigError(f"{error}; give --paper a3, --squares or --square-mm") from error
        written["sheet"] = str(write_file(data, pdf))
    else:
        board = _measured(board, measured_mm)
    write_file((json.dumps(_body(board), ensure_ascii=False) + "\n").encode(), target)
    width_mm, height_mm = board.print_mm
    if as_json:
        emit({**written, "squares_mm": [width_mm, height_mm], "square_mm": board.square_mm})
        return 0
    if measured_mm is None:
        print_line(f"{pdf}: print it at 100 %, measure its ruler, glue it on a flat plate")
        print_line(
            f"then measure all squares across, {width_mm:g} mm if the printer is accurate, "
            "and give the measured length by --measured-mm"
        )
    print_line(f"{target}: {width_mm:g} x {height_mm:g} mm over all squares")
    return 0


def find_board_file(name: Path) -> Path:
    """Return the board file that a command line means: a file, or a shipped board by its name.

    Raises
    ------
    ConfigError : a bare name of neither
    """
    if name.suffix or len(name.parts) != 1:
        return name
    shipped = BOARDS / f"{name}.json"
    if not shipped.is_file():
        known = ", ".join(sorted(path.stem for path in BOARDS.glob("*.json")))
        raise ConfigError(f"{name}: no board of this name comes with cellctl; these do: {known}")
    return shipped


def _changed(board: BoardSection, squares: str | None, square_mm: float | None) -> BoardSection:
    """Return a board with other squares."""
    changes: dict[str, Any] = {}
    if squares is not None:
        counts = squares.lower().split("x")
        if len(counts) != 2 or not all(count.isascii() and count.isdigit() for count in counts):
            raise ConfigError(
                f"--squares {squares:.40}: squares across and down are required, as in 12x9"
            )
        across, down = (int(count[:9]) for count in counts)
        if board.inner_corners is not None:
            changes["inner_corners"] = (across - 1, down - 1)
        else:
            changes["squares"] = (across, down)
    if square_mm is not None:
        changes["square_mm"] = square_mm
        if board.marker_mm is not None:
            changes["marker_mm"] = board.marker_mm * square_mm / board.square_mm
    if not changes:
        return board
    changes["note"] = ""  # it names the size of the plate as it was
    return _remade(board, changes, "--squares and --square-mm")


def _measured(board: BoardSection, measured_mm: float) -> BoardSection:
    """Return a board with its printed size."""
    nominal_mm = board.print_mm[0]
    scale = measured_mm / nominal_mm
    if not abs(scale - 1) <= SCALE_LIMIT:
        raise ConfigError(
            f"--measured-mm {measured_mm:g}: {100 * abs(scale - 1):.3g} % off the nominal "
            f"{nominal_mm:g} mm. Print it at 100 %, without fitting to the page, "
            "and measure all squares across"
        )
    changes: dict[str, Any] = {"square_mm": board.square_mm * scale}
    if board.marker_mm is not None:
        changes["marker_mm"] = board.marker_mm * scale
    changes["note"] = f"{board.note}; measured {measured_mm:g} mm over all squares across"
    return _remade(board, changes, "--measured-mm")


def _remade(board: BoardSection, changes: Mapping[str, Any], options: str) -> BoardSection:
    try:
        return BoardSection.model_validate(board.model_dump() | dict(changes))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(word) for word in first["loc"])
        why = str(first["msg"]).removeprefix("Value error, ")
        raise ConfigError(f"{options}: {where + ': ' if where else ''}{why}") from error


def _body(board: BoardSection) -> dict[str, Any]:
    return board.model_dump(mode="json", exclude_defaults=True)
