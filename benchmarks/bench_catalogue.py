"""A catalogue on one worker and on two, and once more after an interruption half-way.

python benchmarks/bench_catalogue.py [--count 200] [--planned 8] [--jobs 1 2] [--json]

Distinct plates with bores from a seed, compiled by `cellctl compile --jobs N` into an empty cache:
all from their CAD alone, and the first few (--planned) with certificates in the emulated cell.
Interrupted: the command is killed when half of the parts are printed, and begun again. Seconds are
those of the clock, since it is they that two workers save: nothing else should run beside it.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_name] = "1"
ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import manifold3d  # noqa: E402  (threads and path come first)
import numpy as np  # noqa: E402
import trimesh  # noqa: E402

CELL = ROOT / "recipes" / "cells" / "emulated.yaml"


def make_parts(folder: Path, count: int, seed: int) -> list[Path]:
    """Write plates with bores and a boss, each of its own sizes."""
    rng = np.random.default_rng(seed)
    files = []
    for number in range(count):
        x, y, z = rng.uniform((40, 25, 6), (70, 45, 14))
        body = manifold3d.Manifold.cube((x, y, z), center=True)
        for corner in rng.permutation(4)[: rng.integers(2, 5)]:
            side = np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)][corner]) * (x / 3, y / 3)
            radius = rng.uniform(1.5, 3.0)
            bore = manifold3d.Manifold.cylinder(3 * z, radius, circular_segments=48, center=True)
            body -= bore.translate((*side, 0.0))
        boss = manifold3d.Manifold.cylinder(
            rng.uniform(4, 10), rng.uniform(4, 7), circular_segments=64
        )
        body += boss.translate((0.0, 0.0, z / 2 - 1.0))
        mesh = body.to_mesh()
        file = folder / f"plate{number:03}.stl"
        trimesh.Trimesh(mesh.vert_properties[:, :3], mesh.tri_verts).export(file)
        files.append(file)
    return files


def command_of(files: Sequence[Path], jobs: int, cell: Path | None) -> list[str]:
    """Return the command line."""
    with_cell = [] if cell is None else ["--cell", str(cell)]
    code = "from controller.cli import main; import sys; sys.exit(main())"
    return [
        *(sys.executable, "-c", code, "compile", "--json", "--jobs", str(jobs)),
        *with_cell,
        *map(str, files),
    ]


def run(command: Sequence[str], cache: Path, stop_at: int | None = None) -> dict[str, Any]:
    """Run a command to its end, or kill it when so many parts are printed."""
    environment = os.environ | {"XDG_CACHE_HOME": str(cache), "PYTHONPATH": str(ROOT)}
    began = time.perf_counter()
    printed = kept = 0
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout is not None
        for line in process.stdout:
            printed += 1
            kept += json.loads(line)["from_cache"]
            if printed == stop_at:
                process.kill()
                break
    return {"seconds": time.perf_counter() - began, "parts": printed, "from_cache": kept}


def main() -> None:
    """Print the table, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--planned", type=int, default=8)
    parser.add_argument("--jobs", type=int, nargs="*", default=[1, 2])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    results: list[dict[str, Any]] = []

    def note(what: str, jobs: int, found: dict[str, Any]) -> None:
        results.append({"what": what, "jobs": jobs, **found})
        if not given.json:
            print(
                f"{what:28} {jobs:4} {found['parts']:6} {found['from_cache']:10} "
                f"{found['seconds']:9.1f}",
                flush=True,
            )

    if not given.json:
        print(f"{'':28} jobs  parts from cache  seconds")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = make_parts(folder, given.count, given.seed)
        some = files[: given.planned]
        for jobs in given.jobs:
            note("compiled", jobs, run(command_of(files, jobs, None), folder / f"c{jobs}"))
            note("again", jobs, run(command_of(files, jobs, None), folder / f"c{jobs}"))
            if some:
                note(
                    "compiled and certified",
                    jobs,
                    run(command_of(some, jobs, CELL), folder / f"p{jobs}"),
                )
        half = run(command_of(files, 2, None), folder / "half", stop_at=len(files) // 2)
        note("killed half-way", 2, half)
        note("begun again", 2, run(command_of(files, 2, None), folder / "half"))
    if given.json:
        print(json.dumps({"results": results, "cores": os.cpu_count()}))


if __name__ == "__main__":
    main()
