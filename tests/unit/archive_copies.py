"""An archive of many parts made from a stored run: its files linked, its rows journaled again."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

from controller.cell.journal import JOURNAL_NAME, Body, Journal, Row, read_row, read_rows, rows


def copy_run(
    source: Path,
    run: str,
    archive: Path,
    numbers: range,
    changed: Callable[[int, Body], Body] = lambda number, body: body,
) -> list[str]:
    """Write copies of a run into an archive, each with a serial number; return their ids.

    Parameters
    ----------
    source : folder of runs
    run : the run
    archive : folder of runs to write to
    numbers : of the copies; the serial number is `SN-` with it
    changed : the body of a row that is written instead, by copy and row
    """
    found = list(read_rows(source / JOURNAL_NAME, run))
    copies = []
    for number in numbers:
        copy = f"20260315-{number // 1000:06d}-{number % 1000:03d}-{run.rpartition('-')[2]}"
        _link(source / run, archive / copy)
        journal = Journal(archive / JOURNAL_NAME, copy)
        for row, body in _bodies(found):
            if isinstance(body, rows.RunBegan):
                body = body.model_copy(update={"serials": (f"SN-{number:05d}",), "lot": "L7"})
            journal.write(changed(number, body), row.part)
        journal.close()
        copies.append(copy)
    return copies


def _bodies(found: list[Row]) -> Iterator[tuple[Row, Body]]:
    for row in found:
        body = read_row(row.kind, row.name, row.body)
        if body is not None:
            yield row, body


def _link(source: Path, target: Path) -> None:
    """Give a folder's files another name each; on another disk, copy nothing and fail."""
    for file in source.rglob("*"):
        if file.is_file():
            there = target / file.relative_to(source)
            there.parent.mkdir(parents=True, exist_ok=True)
            os.link(file, there)
