"""The common base of the statistics commands: their table, and the check of their page."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from controller.config import ConfigError

from ..inputs.checks import check_writable_folder
from ..terminal.output import printable, stdout


def check_page(report: Path | None) -> None:
    """Check the path of a page to write.

    Raises
    ------
    ConfigError : it cannot have that name, or be written there
    """
    if report is not None:
        if report.suffix.lower() != ".html" or report.is_dir():
            raise ConfigError(f"--report {report}: name a file that ends in .html")
        check_writable_folder(report.parent, "--report in")


def print_table(
    table: Table, columns: Sequence[str], rows: Iterable[Sequence[str]], text_columns: int
) -> None:
    """Print a table of numbers between a name and a note, wide if there is no terminal.

    Parameters
    ----------
    table : empty, with its style
    columns : headings
    rows : rows of the table
    text_columns : width where there is no terminal
    """
    for i, name in enumerate(columns):
        is_number = 0 < i < len(columns) - 1
        table.add_column(Text(name), justify="right" if is_number else "left", no_wrap=is_number)
    for row in rows:
        # as Text: rich would read brackets as markup
        table.add_row(*(Text(printable(cell, stdout.encoding)) for cell in row))
    console = stdout
    if not stdout.is_terminal:
        console = Console(file=stdout.file, width=text_columns, highlight=False)
    console.print(table)
