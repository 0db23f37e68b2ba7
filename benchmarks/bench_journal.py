"""How long a start takes to check the cell's journal, and what writing costs of a cycle.

    python benchmarks/bench_journal.py [--rows N ...] [--json]
    python benchmarks/bench_journal.py --overhead RUNS [--folder DISK]

Rows are those of a run (views with outlines among them), so that their bodies are as long as they
really are. With --overhead, the rows of every run of a folder of runs that came to its end are
written once more, each as safely as it was, into a new journal on the disk of --folder; what that
takes is set against the forecast of the parts that were done.
"""

import asyncio
import sqlite3
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from bench import Arguments, show

from controller.cell.custody import read_folded
from controller.cell.journal import (
    Journal,
    Row,
    first_flaw,
    open_cell_journal,
    read_rows,
)

RUN_ROWS = 240  # of one inspected part
VIEWS = 14
PATHS = 29  # of the arm
WAYPOINTS = [[round(0.1 * axis + 0.001 * i, 6) for axis in range(6)] for i in range(2)]
CELL = {"name": "bench", "figures": list(range(1500))}  # as long as a cell file
OUTLINE = [[400 + i, 300 + i // 2] for i in range(250)]


def fill(path: Path, row_count: int) -> None:
    """Write runs one after the other, as fast as SQLite does it."""
    journal = Journal(path, "run-0")
    db: sqlite3.Connection = journal._db
    db.execute("BEGIN")
    for i in range(row_count):
        journal.run = f"run-{i // RUN_ROWS}"
        kind, name, body = "outcome", "step", {"label": "view", "seconds": 2.5}
        place = i % RUN_ROWS
        if place == 0:
            kind, name, body = "event", "run_began", {"cell": CELL}
        elif place == 1:
            kind, name, body = "event", "reset", {"answer": "handled", "from": "a", "to": "b"}
        elif place == RUN_ROWS - 1:
            kind, name, body = "event", "run_ended", {"end": "complete"}
        elif place < 2 + PATHS:
            body = {"effect_class": "absolute", "waypoints": WAYPOINTS}
            kind, name = "intent", "follow_path"
        elif place < 2 + PATHS + VIEWS:
            kind, name, body = "observation", "view", {"outline_px": OUTLINE}
        elif place < 2 + PATHS + VIEWS + 8:
            kind, name, body = "custody", "in_arm", {"detail": "jaws at 20.0 mm"}
        journal._insert(journal._entry(kind, name, body, 1, full=False))
    db.execute("COMMIT")
    asyncio.run(journal.secure("custody", "placed", {}, 1))
    journal.close()


def measure(row_count: int, folder: Path) -> dict[str, float]:
    path = folder / f"{row_count}" / "journal.sqlite"
    fill(path, row_count)
    started = time.perf_counter()
    assert first_flaw(path) is None
    checked = time.perf_counter()
    list(read_folded(path))
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


def overheads(runs: Path, folder: Path) -> list[dict[str, Any]]:
    """Return for each run with a part done: rows, seconds to write them, share of the cycle."""
    by_run: dict[str, list[Row]] = {}
    for row in read_rows(runs / "journal.sqlite"):
        by_run.setdefault(row.run, []).append(row)
    found = []
    for run, of_run in by_run.items():
        parts = {row.part for row in of_run if row.name == "part_done"}
        # the first plan of each part: motions alone, so that the share is rather too high
        plans = {row.part: row for row in reversed(of_run) if row.name == "plan"}
        took_s = sum(row.body["forecast_s"] for part, row in plans.items() if part in parts)
        if not took_s:
            continue
        with tempfile.TemporaryDirectory(dir=folder) as scratch:
            times = asyncio.run(_write_again(Path(scratch) / "journal.sqlite", of_run))
        secured = [s for s, is_secured in times if is_secured]
        total_s = sum(s for s, _ in times)
        found.append(
            {
                "run": run,
                "rows": len(of_run),
                "secured": len(secured),
                "secured_ms_median": round(1e3 * float(np.median(secured)), 2),
                "secured_ms_max": round(1e3 * max(secured), 2),
                "write_s": round(total_s, 3),
                "cycle_s": round(took_s, 1),
                "share": round(total_s / took_s, 5),
            }
        )
    return found


async def _write_again(path: Path, of_run: Sequence[Row]) -> list[tuple[float, bool]]:
    """Write rows into a new journal; return the seconds of each, and whether it was secured."""
    journal = Journal(path, "again")
    times = []
    for row in of_run:
        is_secured = row.kind in ("intent", "custody")
        begun = time.perf_counter()
        if is_secured:
            await journal.secure(row.kind, row.name, row.body, row.part)
        else:
            journal.record(row.kind, row.name, row.body, row.part)
        times.append((time.perf_counter() - begun, is_secured))
    journal.close()
    return times


def main() -> int:
    parser = Arguments(__doc__, rows=[1_000])
    parser.add_argument("--rows", type=int, nargs="+", default=[1_000, 10_000, 100_000])
    parser.add_argument("--overhead", type=Path, metavar="RUNS", help="folder of runs")
    parser.add_argument("--folder", type=Path, help="disk to write on (default: that of RUNS)")
    args = parser.parse_args()
    if args.overhead is not None:
        found = overheads(args.overhead, args.folder or args.overhead)
        show(args, found, {"runs": len(found)})
        return 0 if found else 1
    with tempfile.TemporaryDirectory() as folder:
        measured = [measure(count, Path(folder)) for count in args.rows]
    show(args, measured, {"a start checks rows in s": measured[-1]["check_s"]})
    return 0


if __name__ == "__main__":
    sys.exit(main())
