"""The output of `cellctl recognise --explain`: a picture and tables of the stages."""

import json
from collections.abc import Sequence
from io import StringIO
from pathlib import Path

import cv2
from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from controller.recognition.explain import Explanation, StageTable

from ..inputs.checks import writing
from ..terminal.output import stdout

TEXT_COLUMNS = 200  # width of a line in a file


class ExplainFolder:
    """A folder of explanations: at most three files per picture.

    Raises
    ------
    ConfigError : the folder cannot be made
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._taken: set[str] = set()
        with writing("--explain", folder):
            folder.mkdir(parents=True, exist_ok=True)

    def write(self, image: Path, explanation: Explanation, *, with_json: bool) -> Path:
        """Write the explanation of an answer; return the path of the drawing.

        Parameters
        ----------
        image : the picture that was recognised; its name names the files
        explanation : a drawing, and a table for each stage
        with_json : write the tables as JSON, too

        Raises
        ------
        ConfigError : a file cannot be written
        """
        name = self._name(image)
        drawing = self._folder / f"{name}.explain.png"
        _, data = cv2.imencode(".png", explanation.picture)
        with writing("--explain", self._folder):
            drawing.write_bytes(data.tobytes())
            text = self._folder / f"{name}.explain.txt"
            text.write_text(tables_text(explanation.tables), encoding="utf-8")
            if with_json:
                stages = [
                    {"title": t.title, "columns": t.columns, "rows": t.rows}
                    for t in explanation.tables
                ]
                body = json.dumps({"image": image.name, "stages": stages}, ensure_ascii=False)
                (self._folder / f"{name}.explain.json").write_text(body + "\n", encoding="utf-8")
        return drawing

    def _name(self, image: Path) -> str:
        """Return a name not given to another picture of this call."""
        name, count = image.stem, 1
        while name in self._taken:
            count += 1
            name = f"{image.stem}-{count}"
        self._taken.add(name)
        return name


def show_tables(tables: Sequence[StageTable]) -> None:
    """Print tables as wide as the terminal; without one, at their full width."""
    if not stdout.is_terminal:
        stdout.print(tables_text(tables), end="", markup=False)
        return
    _print(stdout, tables)


def tables_text(tables: Sequence[StageTable]) -> str:
    """Return tables as plain text."""
    out = StringIO()
    console = Console(file=out, width=TEXT_COLUMNS, color_system=None, highlight=False)
    _print(console, tables)
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines()) + "\n"


def _print(console: Console, tables: Sequence[StageTable]) -> None:
    for table in tables:
        console.print(Text(table.title, style="bold"))
        console.print(_drawn(table))


def _drawn(table: StageTable) -> Table:
    drawn = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    is_number = [
        any(isinstance(row[k], int | float) for row in table.rows)
        for k in range(len(table.columns))
    ]
    for heading, numeric in zip(table.columns, is_number, strict=True):
        drawn.add_column(Text(heading), justify="right" if numeric else "left", overflow="fold")
    for row in table.text_rows():
        drawn.add_row(*(Text(cell) for cell in row))  # as Text: rich would read brackets as markup
    if not table.rows:
        drawn.add_row(*("-" for _ in table.columns))
    return drawn
