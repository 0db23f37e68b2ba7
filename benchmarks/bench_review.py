"""What a running cell notices of persons' verdicts: how long its own rows take meanwhile.

    python benchmarks/bench_review.py [--rows N] [--verdicts N] [--json]

A process writes rows as a run does, one a millisecond. Beside it another one adds verdicts, by
`append_beside` and, for comparison, as a secured row of a writer that then closes the journal. Each
way has a journal of its own; the first figure is without anybody beside it.
"""

import argparse
import json
import multiprocessing
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from controller.cell.journal import Journal, append_beside, first_flaw, rows

RUN = "20260105-060000-000-bench"
BESIDE_S = 0.02  # between two verdicts


def verdict() -> rows.PartReviewed:
    return rows.PartReviewed(verdict="accept", who="Ann", why="dust", machine="indeterminate")


def beside(path: Path) -> None:
    append_beside(path, RUN, verdict(), 1)


def secured(path: Path) -> None:
    journal = Journal(path, RUN)
    journal.write_synced(verdict())
    journal.close()


WAYS: dict[str, Callable[[Path], None] | None] = {
    "nobody": None,
    "append_beside": beside,
    "secured, closed": secured,
}


def add(path: Path, way: str, count: int) -> None:
    do = WAYS[way]
    assert do is not None
    for _ in range(count):
        do(path)
        time.sleep(BESIDE_S)


def measured(way: str, row_count: int, verdict_count: int) -> dict[str, float]:
    """Return what rows of the run took [ms], and whether the journal is whole."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "journal.sqlite"
        journal = Journal(path, RUN)
        journal.write(rows.RunBegan(recipe={"name": "bench"}))
        other = None
        if WAYS[way] is not None:
            apart = multiprocessing.get_context("spawn")
            other = apart.Process(target=add, args=(path, way, verdict_count))
            other.start()
            own_count = 1
            while journal.write(rows.PathEnded(), 1) == own_count + 1:  # the other has not begun
                own_count += 1
                time.sleep(0.01)
        took = []
        for _ in range(row_count):
            began = time.perf_counter()
            journal.write(rows.PathEnded(), 1)
            took.append(1000 * (time.perf_counter() - began))
            time.sleep(0.001)
        if other is not None:
            other.join()
        journal.close()
        assert first_flaw(path) is None
    took.sort()
    return {
        "median_ms": statistics.median(took),
        "p99_ms": took[int(0.99 * len(took))],
        "longest_ms": took[-1],
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, default=3000)
    parser.add_argument("--verdicts", type=int, default=300)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    found = {way: measured(way, args.rows, args.verdicts) for way in WAYS}
    if args.json:
        print(json.dumps(found))
        return 0
    for way, one in found.items():
        print(f"{way:18}" + "".join(f"  {name} {ms:8.2f}" for name, ms in one.items()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
