"""How long an archive takes to be judged anew, and whether a cluster that is killed finds the same.

    python benchmarks/bench_rejudge.py [--parts N] [--growth N N N] [--source RUNS/RUN] [--json]

The archive is made from one stored run: its files get another name for each part, its rows are
journaled again. By default that run is the small block of the tests, three views under three lamps,
judged from pictures that are drawn here; --source names a run of a cell.

All parts are judged on one process, for the hours that 100,000 of them take a core, and on two Dask
workers of which two are killed and whose scheduler is killed, then again by the same command: both
tables must be the same, byte for byte. What store, journal and hand-out take beside the judging is
measured apart, by archives of growing size whose parts are judged by nothing.

Exit code 1: the tables differ, or a command did not end as it should.
"""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_name] = "1"

from bench import Arguments, need_module, note, show  # noqa: E402  (threads come first)

WHOLE = 100_000
RECIPE = """
name: shown
part: shown.stl
inspection:
  min_coverage: 0.1
  characteristics:
    - {id: length 30 mm F0 to F10, lower: 25, upper: 29}
"""


def source_of(folder: Path, named: Path | None) -> tuple[Path, str, Path]:
    """Return the run that is copied, as its folder of runs and its name, and the recipe."""
    import stored_run

    if named is not None:
        return named.parent, named.name, next((named / "inputs").glob("*.yaml"))
    stored_run.write(folder / "first")
    shutil.copy(folder / "first" / stored_run.RUN / "inputs/shown.stl", folder)
    (folder / "new.yaml").write_text(RECIPE, encoding="utf-8")
    return folder / "first", stored_run.RUN, folder / "new.yaml"


def children_s() -> float:
    """Return the CPU time of processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def beside_judging(source: Path, run: str, recipe: Path, runs: Path, count: int) -> dict[str, Any]:
    """Return what an archive of some parts takes beside the judging [CPU ms a part]."""
    import archive_copies

    from controller.catalogue import results_of
    from controller.history import Filters, fill, open_store
    from controller.history.rejudging import (
        Archive,
        Rejudged,
        compared,
        judging_by_recipe,
        keep,
        parts_left,
    )

    def judged(_: object) -> Rejudged:
        return Rejudged(verdict="pass", reasons=("free",), lines_sha256="0" * 64)

    archive_copies.copy_run(source, run, runs, range(count))
    store = open_store(f"sqlite:///{runs}/history.sqlite")
    began = time.process_time()
    fill(store, runs)
    filled_s, began = time.process_time() - began, time.process_time()
    archive = Archive(store, runs, judging_by_recipe(recipe), Filters())
    found = 0
    for part, result in results_of(None, judged, parts_left(archive)):
        assert isinstance(result, Rejudged)
        keep(archive, [(part, result)])
        found += 1
    kept_s, began = time.process_time() - began, time.process_time()
    turned = sum(one.is_turned for one in compared(archive, {}))
    store.close()
    return {
        "parts": found,
        "fill ms": 1000 * filled_s / found,
        "choose, keep ms": 1000 * kept_s / found,
        "table ms": 1000 * (time.process_time() - began) / found,
        "turned": turned,
    }


def main() -> int:
    parser = Arguments(__doc__, parts=6, growth=[10, 20, 40])
    parser.add_argument("--parts", type=int, default=200)
    parser.add_argument("--growth", type=int, nargs="+", default=[100, 200, 400])
    parser.add_argument("--source", type=Path)
    args = parser.parse_args()
    need_module("distributed")
    import archive_copies
    import dask_processes

    with tempfile.TemporaryDirectory(dir=args.source and args.source.parent) as name:
        folder = Path(name)
        source, run, recipe = source_of(folder, args.source)
        rows = []
        for count in args.growth:
            rows.append(beside_judging(source, run, recipe, folder / f"grown{count}", count))
            note(rows[-1])
        runs = folder / "runs"
        archive_copies.copy_run(source, run, runs, range(args.parts))
        words = ["rejudge", "--recipe", str(recipe), "--runs", str(runs), "-o"]
        one, many = folder / "one.csv", folder / "many.csv"
        began, whole = children_s(), time.perf_counter()
        alone = subprocess.run(
            [sys.executable, "-m", "controller.cli", *words, str(one), "--store",
             f"sqlite:///{folder}/one.sqlite"],
            stdout=subprocess.DEVNULL, check=False,
        ).returncode  # fmt: skip
        cpu_s, wall_s = children_s() - began, time.perf_counter() - whole
        kills = [max(1, args.parts * k // 8) for k in (1, 3, 5)]
        killed = dask_processes.rejudge_with_kills(
            [*words, str(many)], runs / "history.sqlite", kills
        )
        ends = (alone, killed.first_code, killed.second_code)
        is_same = many.is_file() and many.read_bytes() == one.read_bytes()
    show(
        args,
        rows,
        {
            "parts judged": args.parts,
            "CPU s a part": cpu_s / args.parts,
            "wall s a part": wall_s / args.parts,
            f"core hours for {WHOLE:,}": WHOLE * cpu_s / args.parts / 3600,
            "exit codes": ends,
            "same table": is_same,
        },
    )
    return 0 if is_same and ends == (0, 1, 0) else 1


if __name__ == "__main__":
    sys.exit(main())
