"""What it costs to promise plans: preparation of a part, and a certificate for each distinct pose.

python benchmarks/bench_certificates.py [--parts NAME...] [--cell FILE] [--profile FOLDER] [--json]

CPU seconds of one process a part, without the cache, compiling left out. Poses that a symmetry of
the part makes one are certified once, as `cellctl plan` and `compile --cell` do.
"""

from __future__ import annotations

import argparse
import cProfile
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_name] = "1"
ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "unit"), str(ROOT / "benchmarks")]

import numpy as np  # noqa: E402  (threads and path come first)
from planning_parts import planning_parts, read_part  # noqa: E402

from controller.cell.plans import PlanCache  # noqa: E402
from controller.config import load_cell  # noqa: E402
from controller.setup.planner import planner_setup  # noqa: E402

EMULATED = ROOT / "recipes" / "cells" / "emulated.yaml"
ASKED_PREPARATION_S = 10.0
ASKED_POSE_S = 5.0


def cost(path: Path, cell_file: Path) -> dict[str, Any]:
    """Return the CPU seconds of a part: preparation, and each distinct pose by its index."""
    part = read_part(path)
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


def main() -> None:
    """Print the table, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--parts", nargs="*", default=[], help="names, or CAD files")
    parser.add_argument("--cell", type=Path, default=EMULATED)
    parser.add_argument("--profile", type=Path, help="folder for a profile of each part")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--one", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one is not None:
        profile = cProfile.Profile()
        if given.profile is not None:
            profile.enable()
        found = cost(given.one, given.cell)
        if given.profile is not None:
            profile.dump_stats(given.profile / f"{given.one.stem}.prof")
        print(json.dumps(found))
        return
    files = {Path(p).stem: Path(p) for p in given.parts if Path(p).is_file()}
    names = [p for p in given.parts if not Path(p).is_file()]
    if names or not files:
        files |= planning_parts(names)
    results: dict[str, Any] = {}
    if not given.json:
        print(f"{'part':24} poses distinct planned  prepare s   a pose s: mean  most")
    for name, file in files.items():
        command = [sys.executable, __file__, "--one", str(file), "--cell", str(given.cell)]
        if given.profile is not None:
            command += ["--profile", str(given.profile)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            results[name] = {"error": done.stderr.strip().splitlines()[-1]}
            print(f"{name:24} {results[name]['error'][:90]}", file=sys.stderr)
            continue
        one = results[name] = json.loads(done.stdout)
        poses = list(one["pose_s"].values()) or [0.0]
        if not given.json:
            print(
                f"{name:24} {one['poses']:5} {one['distinct']:8} {one['planned']:7} "
                f"{one['preparation_s']:10.1f} {np.mean(poses):16.1f} {max(poses):5.1f}",
                flush=True,
            )
    good = [one for one in results.values() if "error" not in one]
    within = [
        one["preparation_s"] <= ASKED_PREPARATION_S
        and all(s <= ASKED_POSE_S for s in one["pose_s"].values())
        for one in good
    ]
    summary = {"parts": len(good), "within": sum(within), "refused": len(results) - len(good)}
    if given.json:
        print(json.dumps(summary | {"results": results}))
    else:
        print(
            f"{summary['within']} of {summary['parts']} parts within "
            f"{ASKED_PREPARATION_S:.0f} s preparation and {ASKED_POSE_S:.0f} s for every pose"
        )


if __name__ == "__main__":
    main()
