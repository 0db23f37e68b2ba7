"""Hundreds of parts through the running cell, with noise, slips and drops: does it help itself?

Two forms. By default the real dispatcher, actions, drivers and wires run against the emulated arm,
grippers and world with its physics; recognition answers with the world's truth and noise, and
inspection with what the camera would see of the part where it truly is, so that no picture is made
(`runs_stand_ins.py`). With --whole, every run is a `cellctl run` with pictures and everything.

Slips, drops, missed grips and slips in the fixed gripper are caused at random moments of random
steps over the tests' control port. What is counted comes from the journal and from the world's own
record of contacts and of who held what.

    python benchmarks/bench_runs.py --count 200 --out runs.jsonl     go on where the file ends
    python benchmarks/bench_runs.py --count 20 --parts holder featuretype --fault-rate 0.2
    python benchmarks/bench_runs.py --whole --count 6
    python benchmarks/bench_runs.py --out runs.jsonl --tell          the summary only
"""

import argparse
import asyncio
import itertools
import json
import logging
import os
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from runs_cell import Bench
from runs_record import Job, Ran, line_of, load
from runs_whole import run_whole

from controller.cell.devices.emulator import emulated_cell, emulator_command
from controller.processes import make_pool

ROOT = Path(__file__).parents[1]
SHARED = ROOT.parent / "shared" / "parts"
RECIPES = ("featuretype", "flange_xy", "holder", "idler_riser", "widget")
SHARED_PARTS = (
    "angle_block", "cycloidal_gear", "cycloidal_gear_mirror", "disc_cam_a", "disc_cam_b",
    "nist_ftc06",
)  # fmt: skip
log = logging.getLogger("bench_runs")


# --- many runs ----------------------------------------------------------------------------------


def part_file(name: str, scratch: Path) -> tuple[Path, Path]:
    """Return a recipe for a part, of the project's or a made one, and its cell."""
    cell = ROOT / "recipes/cells/emulated.yaml"
    if name in RECIPES:
        return ROOT / f"recipes/{name}.yaml", cell
    path = scratch / f"{name}.yaml"
    shutil.copyfile(SHARED / f"{name}.stl", scratch / f"{name}.stl")
    path.write_text(f"name: {name}\npart: {name}.stl\nunit: mm\n")
    return path, cell


def schedule(benches: dict[str, list[int]], args: argparse.Namespace) -> list[Job]:
    """Return the runs to make: every part and way to lie in turn, until there are enough."""
    kinds = [(name, pose) for name, poses in benches.items() for pose in poses]
    # likely poses of every part first, so that a short bench sees every part
    kinds.sort(key=lambda k: (benches[k[0]].index(k[1]), list(benches).index(k[0])))
    jobs = []
    for number, (name, pose) in zip(range(args.count), itertools.cycle(kinds), strict=False):
        seed = args.seed + number // len(kinds)
        jobs.append(Job(name, pose, seed, args.fault_rate, args.fault_per))
    return jobs


def run_jobs(args: argparse.Namespace, scratch: Path) -> None:
    """Make the runs that the file does not hold yet."""
    done = {ran.key for ran in load(args.out)}
    names = [n for n in args.parts if n in RECIPES or (SHARED / f"{n}.stl").is_file()]
    for name in set(args.parts) - set(names):
        print(f"{name}: left out, its file is not here", file=sys.stderr)
    with make_pool("controller.cell.compute") as pool:
        benches = {}
        for name in names:
            recipe, cell = part_file(name, scratch)
            benches[name] = Bench(name, recipe, cell, args.speed, scratch)
        jobs = [j for j in schedule({n: b.poses() for n, b in benches.items()}, args)
                if j.key not in done]  # fmt: skip
        for name, bench in benches.items():
            mine = [j for j in jobs if j.part == name]
            while mine:
                taken = mine[: args.per_start]
                rans = _with_cell(bench, taken, pool, args, scratch)
                for ran in rans:
                    args.out.parent.mkdir(parents=True, exist_ok=True)
                    with args.out.open("a") as file:
                        file.write(json.dumps(asdict(ran)) + "\n")
                    print(line_of(ran), flush=True)
                mine = mine[max(1, len(rans)) :]


def _with_cell(
    bench: Bench,
    jobs: Sequence[Job],
    pool: ProcessPoolExecutor,
    args: argparse.Namespace,
    scratch: Path,
) -> list[Ran]:
    control = scratch / "control.sock"
    control.unlink(missing_ok=True)
    part = scratch / f"{bench.part}.stl"
    bench.context.solid.mesh.export(part)
    command = emulator_command(
        bench.job.cell_path, [part], speed=args.speed, seed=jobs[0].seed,
        more=("--empty", "--control", str(control), "--camera-transport", "socket"),
    )  # fmt: skip
    with emulated_cell(command, scratch / "emulator.log") as ready:
        return asyncio.run(bench.run_group(jobs, pool, ready, control))


def tell(rans: Sequence[Ran]) -> dict[str, Any]:
    """Return what the runs come to."""
    refused = [r for r in rans if r.has_no_plan]
    tried = [r for r in rans if not r.has_no_plan]
    hit = [r for r in tried if r.faults]
    ratios = np.array(
        [r.took_s / r.forecast_s for r in tried if r.forecast_s > 0 and r.is_complete]
    )
    plans = np.array([s for r in tried for s in r.plan_wall_s[1:]])
    return {
        "runs": len(rans),
        "refused_before_anything_moved": len(refused),
        "tried": len(tried),
        "complete": sum(r.is_complete for r in tried),
        "complete_share": round(sum(r.is_complete for r in tried) / max(1, len(tried)), 4),
        "with_faults": len(hit),
        "faults": sum(len(r.faults) for r in tried),
        "complete_with_faults": sum(r.is_complete for r in hit),
        "recoveries": dict(Counter(t for r in tried for t in r.recoveries)),
        "collisions": sum(len(r.collisions) for r in rans),
        "put_down_touches": sum(r.put_down_touches for r in rans),
        "inspected_twice": sum(r.twice for r in rans),
        "views_that_showed_nothing_new": sum(r.nothing_new for r in rans),
        "double_open": sum(r.double_open for r in rans),
        "forecast_ratio_median": None if not len(ratios) else round(float(np.median(ratios)), 3),
        "forecast_ratio_5_95": [round(float(v), 3) for v in np.quantile(ratios, [0.05, 0.95])]
        if len(ratios)
        else None,
        "replan_wall_s_median": None if not len(plans) else round(float(np.median(plans)), 2),
        "replan_wall_s_max": None if not len(plans) else round(float(plans.max()), 2),
        "speed_reached_median": round(float(np.median([r.speed_reached for r in rans])), 2)
        if rans
        else None,
        "not_complete": dict(Counter(r.code or r.end for r in tried if not r.is_complete)),
        "wall_s": round(sum(r.wall_s for r in rans), 0),
        "cores": os.cpu_count(),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--parts", nargs="+", default=[*RECIPES, *SHARED_PARTS])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--speed", type=float, default=15.0)
    parser.add_argument("--fault-rate", type=float, default=0.05)
    parser.add_argument(
        "--fault-per", choices=("hold", "step"), default="hold", help="what the rate is of"
    )
    parser.add_argument("--per-start", type=int, default=25, help="runs per emulated cell")
    parser.add_argument("--out", type=Path, default=None, help="JSON lines; gone on with")
    parser.add_argument("--whole", action="store_true", help="`cellctl run`, with pictures")
    parser.add_argument("--tell", action="store_true", help="only sum up what --out holds")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    logging.basicConfig(level=logging.ERROR)
    with tempfile.TemporaryDirectory(prefix="cellruns") as folder:
        scratch = Path(folder)
        args.out = args.out or scratch / "runs.jsonl"
        if args.whole:
            run_whole(args, scratch)
        elif not args.tell:
            run_jobs(args, scratch)
        summary = tell(load(args.out))
    if args.json:
        print(json.dumps(summary))
    else:
        for name, value in summary.items():
            print(f"{name:32} {value}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
