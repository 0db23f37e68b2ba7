"""What it costs to promise plans: preparation of a part, and a certificate for each distinct pose.

python benchmarks/bench_certificates.py [--parts NAME...] [--cell FILE] [--json]

CPU seconds of one process a part, without the cache, compiling left out. Poses that a symmetry of
the part makes one are certified once, as `cellctl plan` and `compile --cell` do.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_name] = "1"

from bench import EMULATED, Arguments, note, show  # noqa: E402  (threads come first)
from known_parts import planning_parts  # noqa: E402

from controller.cad.compiled import load_part  # noqa: E402
from controller.cell.plans import PlanCache  # noqa: E402
from controller.config import load_cell  # noqa: E402
from controller.setup.planner import planner_setup  # noqa: E402

ASKED_PREPARATION_S = 10.0
ASKED_POSE_S = 5.0


def cost(path: Path, cell_file: Path) -> dict[str, Any]:
    """Return the CPU seconds of a part: preparation, and each distinct pose by its index."""
    part = load_part(path)
    setup = planner_setup(None, load_cell(cell_file), part)
    planning = PlanCache(part, setup.layout, setup.options, use_cache=False)
    began = time.process_time()
    planning.prepared()
    preparation_s = time.process_time() - began
    poses: dict[int, float] = {}
    planned = 0
    for pose in part.poses:
        if pose.is_distinct:
            began = time.process_time()
            planned += planning.certified(pose).certificate.plan is not None
            poses[pose.index] = time.process_time() - began
    return {
        "poses": len(part.poses),
        "distinct": len(poses),
        "planned": planned,
        "preparation_s": preparation_s,
        "pose_s": poses,
    }


def main() -> int:
    """Print the table, or JSON."""
    parser = Arguments(__doc__, parts=["cover_plate"])
    parser.add_argument("--parts", nargs="*", default=[], help="names, or CAD files")
    parser.add_argument("--cell", type=Path, default=EMULATED)
    parser.add_argument("--one", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one is not None:
        print(json.dumps(cost(given.one, given.cell)))
        return 0
    files = {Path(p).stem: Path(p) for p in given.parts if Path(p).is_file()}
    names = [p for p in given.parts if not Path(p).is_file()]
    if names or not files:
        files |= planning_parts(names)
    rows: list[dict[str, Any]] = []
    for name, file in files.items():
        command = [sys.executable, __file__, "--one", str(file), "--cell", str(given.cell)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            rows.append({"part": name, "error": done.stderr.strip().splitlines()[-1]})
        else:
            rows.append({"part": name, **json.loads(done.stdout)})
        note(rows[-1])
    good = [one for one in rows if "error" not in one]
    within = [
        one["preparation_s"] <= ASKED_PREPARATION_S
        and all(s <= ASKED_POSE_S for s in one["pose_s"].values())
        for one in good
    ]
    show(given, rows, {"parts": len(good), "within": sum(within), "refused": len(rows) - len(good)})
    return 0


if __name__ == "__main__":
    sys.exit(main())
