"""A part's inspection as a table for a person."""

from collections.abc import Sequence

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from controller.inspection import PartInspection, Verdict
from controller.inspection.characteristics import CharacteristicKind, Measured
from controller.stored import in_unit

from ..terminal.output import print_line, printable, stdout

TEXT_COLUMNS = 160
MAX_REASON_COUNT = 12
STYLES = {Verdict.PASS: "green", Verdict.FAIL: "bold red"}


def print_part(name: str, part: PartInspection) -> None:
    """Print the result of all views of a part."""
    if part.measured:
        _print(
            ("no.", "characteristic", "nominal", "measured", "U", "limits", "verdict", "reason"),
            [_row(measured) for measured in part.measured],
            numeric=(0, 2, 3, 4, 5),
        )
    if part.findings:
        rows = [
            (
                finding.kind,
                f"{finding.size_mm:.1f} mm",
                ", ".join(f"{x:.1f}" for x in finding.p_part_mm),
                f"{finding.view_id}, {finding.lamp}",
                " ".join(f"F{face}" for face in finding.faces),
                finding.verdict.value,
            )
            for finding in part.findings
        ]
        _print(("finding", "size", "at (CAD) [mm]", "picture", "faces", "verdict"), rows, (1,))
    style = STYLES.get(part.verdict, "bold yellow")
    share = f"{100 * part.ledger.compared_fraction:.1f} % of the surface compared"
    print_line(f"{name}: {part.verdict.value.upper()} ({share})", style=style)
    _print_sentences(part.reasons)
    if part.unproven:
        print_line("not verified:")
        _print_sentences(part.unproven)


def _print_sentences(sentences: Sequence[str]) -> None:
    for sentence in sentences[:MAX_REASON_COUNT]:
        print_line(f"  {sentence}")
    if (more := len(sentences) - MAX_REASON_COUNT) > 0:
        print_line(f"  and {more} more; --json has them all")


def _row(measured: Measured) -> tuple[str, ...]:
    asked = measured.characteristic
    unit = "deg" if asked.kind is CharacteristicKind.ANGLE else "mm"

    def shown(value: float | None) -> str:
        found = in_unit(measured, value)
        return "-" if found is None else f"{found:.3f}"

    return (
        str(asked.balloon),
        asked.label,
        f"{shown(asked.nominal_mm)} {unit}",
        shown(measured.measured_mm),
        shown(measured.U_mm),
        f"{shown(asked.lower_mm)} to {shown(asked.upper_mm)}",
        measured.verdict.value,
        measured.reason,
    )


def _print(columns: Sequence[str], rows: Sequence[Sequence[str]], numeric: Sequence[int]) -> None:
    """Print a table as wide as the terminal; without one, wide enough.

    Parameters
    ----------
    columns : headings
    rows : rows of the table
    numeric : columns set to the right
    """
    drawn = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for k, column in enumerate(columns):
        drawn.add_column(Text(column), justify="right" if k in numeric else "left", overflow="fold")
    for row in rows:
        # as Text: rich would read brackets as markup
        drawn.add_row(*(Text(printable(cell, stdout.encoding)) for cell in row))
    if stdout.is_terminal:
        stdout.print(drawn)
        return
    console = Console(width=TEXT_COLUMNS, color_system=None, highlight=False)
    with console.capture() as captured:
        console.print(drawn)
    for line in captured.get().splitlines():
        print_line(line.rstrip())
