"""What wrong inputs of every command cost: exit code, seconds, and memory at most.

    python benchmarks/bench_inputs.py [--only WORDS] [--json]

Each row of `tests/unit/wrong_inputs.py` is asked in a process of its own, from the start of Python,
with an empty cache. Prints a table, or one JSON object with --json; exit code 1 where a row is
answered with another code, a traceback, or past the limits: 5 s and 200 MB. The seconds that count
are those of computing, which other processes do not lengthen; the clock's stand beside them.
"""

from __future__ import annotations

import os
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

from bench import Arguments, note, show
from wrong_inputs import ROWS, Row, cost_of, lay_out

MAX_S = 5.0
MAX_MB = 200.0


def main() -> int:
    parser = Arguments(__doc__, only="empty")
    parser.add_argument("--only", default="", help="rows whose name holds this")
    args = parser.parse_args()
    rows = []
    for row in ROWS:
        if args.only in row.name:
            rows.append(measure(row))
            note(rows[-1])
    failed = [row["name"] for row in rows if row["wrong"]]
    worst = {
        f"most {key}": max(row[key] for row in rows) for key in ("seconds", "cpu_s", "peak_mb")
    }
    show(args, rows, {**worst, "inputs": len(rows), "wrong": failed})
    return 1 if failed else 0


def measure(row: Row) -> dict[str, Any]:
    with tempfile.TemporaryDirectory(prefix="bench-inputs-") as scratch:
        folder = Path(scratch) / "here"
        folder.mkdir()
        os.environ["XDG_CACHE_HOME"] = str(Path(scratch) / "cache")
        lay_out(folder)
        row.prepare(folder)
        cost = cost_of(row, folder)
    body = {"name": row.name, "command": " ".join(row.command)[:200], **asdict(cost)}
    body["peak_mb"] = body.pop("peak_bytes") / 2**20
    wrong = []
    if cost.code != row.code:
        wrong.append(f"code {cost.code}, {row.code} required")
    if "Traceback" in cost.said or "this is a bug" in cost.said:
        wrong.append("a traceback")
    if row.says not in cost.said:
        wrong.append(f"{row.says!r} is not said")
    if row.code == 2 and (cost.cpu_s > MAX_S or body["peak_mb"] > MAX_MB):
        wrong.append("past the limits")
    return body | {"wrong": "; ".join(wrong)}


if __name__ == "__main__":
    sys.exit(main())
