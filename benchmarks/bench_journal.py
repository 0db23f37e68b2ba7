"""How long a start takes to check the cell's journal, by its length.

    python benchmarks/bench_journal.py [--rows N ...] [--json]

Rows are those of a run (views with outlines among them), so that their bodies are as long as they
really are.
"""

import argparse
import asyncio
import json
import sqlite3
import sys
import tempfile
import time
from pathlib import Path

from controller.cell.journal import (
    Journal,
    first_flaw,
    open_cell_journal,
    read_rows_of_kinds,
)

RUN_ROWS = 240  # of one inspected part
VIEWS = 14
OUTLINE = [[400 + i, 300 + i // 2] for i in range(250)]


def fill(path: Path, row_count: int) -> None:
    """Write runs one after the other, as fast as SQLite does it."""
    journal = Journal(path, "run-0")
    db: sqlite3.Connection = journal._db
    db.execute("BEGIN")
    for i in range(row_count):
        journal.run = f"run-{i // RUN_ROWS}"
        kind, name, body = "outcome", "step", {"label": "view", "seconds": 2.5}
        if i % RUN_ROWS < VIEWS:
            kind, name, body = "observation", "view", {"outline_px": OUTLINE}
        elif i % RUN_ROWS < VIEWS + 8:
            kind, name, body = "custody", "in_arm", {"detail": "jaws at 20.0 mm"}
        journal._append(kind, name, json.dumps(body), 1)
    db.execute("COMMIT")
    asyncio.run(journal.secure("custody", "placed", {}, 1))
    journal.close()


def measure(row_count: int, folder: Path) -> dict[str, float]:
    path = folder / f"{row_count}" / "journal.sqlite"
    fill(path, row_count)
    started = time.perf_counter()
    assert first_flaw(path) is None
    checked = time.perf_counter()
    list(read_rows_of_kinds(path, ("custody", "intent"), ()))
    read = time.perf_counter()
    open_cell_journal(path, "next").journal.close()
    opened = time.perf_counter()
    return {
        "rows": row_count,
        "megabytes": round(path.stat().st_size / 1e6, 1),
        "check_s": round(checked - started, 3),
        "custody_s": round(read - checked, 3),
        "open_s": round(opened - read, 3),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, nargs="+", default=[1_000, 10_000, 100_000])
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        measured = [measure(count, Path(folder)) for count in args.rows]
    if args.json:
        print(json.dumps({"bench": "journal", "journals": measured}))
        return 0
    print(f"{'rows':>8} {'MB':>8} {'check s':>8} {'custody s':>9} {'open s':>8}")
    for one in measured:
        print(
            f"{one['rows']:8} {one['megabytes']:8.1f} {one['check_s']:8.3f} "
            f"{one['custody_s']:9.3f} {one['open_s']:8.3f}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
