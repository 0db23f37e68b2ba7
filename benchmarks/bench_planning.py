"""Plans for the recipe parts from random resting places: how many, how good, how long it takes.

python benchmarks/bench_planning.py [--json] [--parts NAME...] [--placements 5]
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "unit")]

from planning_cell import PARTS, emulated_layout, read_cell  # noqa: E402  (path set above)

from controller.cad import load_solid, sample_surface, stable_poses  # noqa: E402
from controller.planning import NoPlanError, plan_part, prepare_part, resting_pose  # noqa: E402

ALL_PARTS = ("featuretype", "flange_xy", "idler_riser", "holder")


def bench(names: list[str], placements: int, seed: int) -> list[dict[str, Any]]:
    layout = emulated_layout()
    area = read_cell()["table"]["drop_area"]
    rows = []
    for name in names:
        solid = load_solid(PARTS / f"{name}.stl")
        samples = sample_surface(solid, 4.0)
        begin = time.perf_counter()
        prepared = prepare_part(solid, samples, layout)
        prepare_s = time.perf_counter() - begin
        for pose in stable_poses(solid):
            if pose.rolling or pose.probability <= 0.03:
                continue
            rng = np.random.default_rng([seed, pose.index])
            runs, failures = [], []
            for _ in range(placements):
                x, y = rng.uniform(*area["x"]), rng.uniform(*area["y"])
                theta = rng.uniform(-np.pi, np.pi)
                T = resting_pose(solid, pose, x, y, theta)
                begin = time.perf_counter()
                try:
                    plan = plan_part(solid, samples, pose, T, layout, prepared=prepared)
                except NoPlanError as error:
                    failures.append(f"({x:.0f}, {y:.0f}, {np.degrees(theta):.0f}): {error}")
                    continue
                runs.append((plan, time.perf_counter() - begin))
            plans = [p for p, _ in runs]
            rows.append(
                {
                    "part": name,
                    "pose": pose.index,
                    "probability": round(pose.probability, 3),
                    "planned": len(plans) / placements,
                    "views": [len(p.presents) for p in plans],
                    "regrips": [p.regrip_count for p in plans],
                    "forecast_s": [round(p.forecast_s, 1) for p in plans],
                    "covered": [round(p.covered_fraction, 4) for p in plans],
                    "reachable": round(plans[0].reachable_fraction, 4) if plans else None,
                    "tilt_deg": [
                        round(float(np.degrees(max(s.tilt_rad for s in p.place.values()))))
                        for p in plans
                    ],
                    "prepare_s": round(prepare_s, 2),
                    "plan_s": [round(s, 2) for _, s in runs],
                    "failures": failures,
                }
            )
    return rows


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--parts", nargs="*", default=list(ALL_PARTS))
    parser.add_argument("--placements", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    rows = bench(args.parts, args.placements, args.seed)
    if args.json:
        for row in rows:
            print(json.dumps(row))
        return 0
    print("part         pose  planned views   regrips forecast s      covered %      prep s plan s")
    for r in rows:

        def span(key: str, row: dict[str, Any] = r, scale: float = 1.0) -> str:
            v = [x * scale for x in row[key]]
            return f"{min(v):g}-{max(v):g}" if v else "-"

        covered = [100 * c for c in r["covered"]] or [0.0]
        print(
            f"{r['part']:12} {r['pose']:4} {100 * r['planned']:7.0f}% {span('views'):7} "
            f"{span('regrips'):7} {span('forecast_s'):15} {min(covered):.1f}-{max(covered):.1f}"
            f"      {r['prepare_s']:6} {span('plan_s')}"
        )
        for failure in r["failures"]:
            print("    no plan:", failure)
    return 0


if __name__ == "__main__":
    sys.exit(main())
