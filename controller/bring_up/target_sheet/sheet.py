"""Draw a board's sheets as areas, so that no edge is made of pixels, and print them as PDF."""

from datetime import UTC, datetime
from typing import Final

from controller.arrays import FloatArray
from controller.calibration.target import BoardSection
from controller.results.pages import make_environment
from controller.results.pdf import pdf_bytes

from .areas import RULER_MM, Area, SheetPage, lay_out

TEMPLATE: Final = "sheet.html.j2"
# The same board gives the same bytes: a sheet reports on nothing that happened at a time.
NO_TIME: Final = datetime(2000, 1, 1, tzinfo=UTC)


def sheet_html(board: BoardSection, name: str, paper: str) -> tuple[str, tuple[SheetPage, ...]]:
    """Return the page to print, and the content of each of its sheets.

    Parameters
    ----------
    board : as its file describes it
    name : name of the board, for people
    paper : a key of `PAPERS_MM`

    Raises
    ------
    SheetError : the plate is larger than the paper allows
    """
    pages = lay_out(board, paper)
    template = make_environment(__package__, [TEMPLATE]).get_template(TEMPLATE)
    html = template.render(
        pages=pages,
        name=name,
        paper=paper.upper(),
        board=board,
        plate_mm=board.plate_mm,
        print_mm=board.print_mm,
        ruler=[(mm, _tick_mm(mm)) for mm in range(int(RULER_MM) + 1)],
        ruler_mm=RULER_MM,
        path=_path,
    )
    return html, pages


def sheet_pdf(board: BoardSection, name: str, paper: str) -> bytes:
    """Return a board's sheets as a PDF document, true to scale.

    Parameters
    ----------
    board : as its file describes it
    name : name of the board, for people
    paper : a key of `PAPERS_MM`

    Raises
    ------
    SheetError : the plate is larger than the paper allows
    PdfError : the engine or every font is missing
    """
    html, pages = sheet_html(board, name, paper)
    return pdf_bytes(html, f"Board {name}", NO_TIME, pages[0].paper_mm)


def _tick_mm(mm: int) -> float:
    return 5.0 if mm % 10 == 0 else 3.5 if mm % 5 == 0 else 2.0


def _path(area: Area, at_mm: tuple[float, float]) -> str:
    """Return an area as an SVG path; its holes count by the even-odd rule."""
    return "".join(_ring(ring, at_mm) for ring in area)


def _ring(ring: FloatArray, at_mm: tuple[float, float]) -> str:
    points = (f"{x + at_mm[0]:.6g} {y + at_mm[1]:.6g}" for x, y in ring)
    return f"M{'L'.join(points)}Z"
