"""How long kept plans take to read, against making them; how large their files are.

    python benchmarks/bench_kept_plans.py [PART ...] [--json]

Prints a table, or one JSON object with --json. Reading is the median of ten starts, each with the
key worked out anew; everything is kept in a folder of its own that is removed afterwards.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import tempfile
import time
from pathlib import Path

from controller.cad.compiled import CompileOptions, load_part, options_among
from controller.cell.plans import Planning
from controller.config import load_cell
from controller.setup.layout import build_layout

ROOT = Path(__file__).parents[1]
CELL = ROOT / "recipes/cells/emulated.yaml"
PARTS = [ROOT / f"recipes/parts/{name}" for name in ("widget.csg.yaml", "featuretype.stl")]
STARTS_N = 10


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", type=Path, default=PARTS)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder
        rows = [measure(path, Path(folder) / "cellctl") for path in args.parts]
    if args.json:
        print(json.dumps({"kept_plans": rows}))
        return
    print("part             plan made s   plan read ms   prepared read ms   plan kB   prepared MB")
    for row in rows:
        print(
            f"{row['part']:16} {row['plan_made_s']:11.2f} {row['plan_read_ms']:14.1f} "
            f"{row['prepared_read_ms']:18.1f} {row['plan_kb']:9.0f} {row['prepared_mb']:13.1f}"
        )


def measure(path: Path, cache: Path) -> dict[str, float | str]:
    layout = build_layout(load_cell(CELL))
    options: CompileOptions = options_among(path, "mm")
    part = load_part(path, options)
    pose = part.poses[0]
    started = time.perf_counter()
    Planning(part, layout).lying(pose, 360.0, 0.0, 0.0)
    made_s = time.perf_counter() - started
    plan_ms, prepared_ms = [], []
    for _ in range(STARTS_N):
        started = time.perf_counter()
        planning = Planning(part, layout)
        planning.lying(pose, 360.0, 0.0, 0.0)
        plan_ms.append(1e3 * (time.perf_counter() - started))
        started = time.perf_counter()
        planning.prepared()
        prepared_ms.append(1e3 * (time.perf_counter() - started))
        assert planning.is_from_cache
    (plan_file,) = cache.glob(f"plan-{part.solid.name}-*")
    (prepared_file,) = cache.glob(f"prepared-{part.solid.name}-*")
    return {
        "part": part.solid.name,
        "plan_made_s": made_s,
        "plan_read_ms": statistics.median(plan_ms),
        "prepared_read_ms": statistics.median(prepared_ms),
        "plan_kb": plan_file.stat().st_size / 1e3,
        "prepared_mb": prepared_file.stat().st_size / 1e6,
    }


if __name__ == "__main__":
    main()
