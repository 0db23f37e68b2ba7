"""How near the forecast of a whole part is to the cell's clock, from pictures to the tray.

    python benchmarks/bench_forecast.py RUNS [--json]
    python benchmarks/bench_forecast.py --make 6 [--recipes holder featuretype] [--seed N]

The forecast is the one shown when the first plan of the part is made. What it is held against lasts
from the first picture of the table to the tray, judging included, in cell seconds: the journal's
instants times the speed that the run reached. Computing takes wall time, so that only runs at
--speed 1 are a fair judge. Parts with recovery actions are counted apart, since
no forecast knows of them. With --make, runs are made first, one after the other.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from controller.cell.journal import Row, read_rows

ROOT = Path(__file__).parents[1]
RECIPES = ("holder", "featuretype", "flange_xy", "idler_riser", "widget")


def parts_of(runs: Path) -> list[dict[str, Any]]:
    """Return for each part that was done: forecast, time taken, recoveries."""
    by_run: dict[str, list[Row]] = {}
    for row in read_rows(runs / "journal.sqlite"):
        by_run.setdefault(row.run, []).append(row)
    found = []
    for run, of_run in by_run.items():
        ends = [row for row in of_run if row.name == "run_ended"]
        if not ends:
            continue
        reached = ends[-1].body.get("speed", {}).get("reached") or 1.0
        for part in sorted({row.part for row in of_run if row.name == "part_done" and row.part}):
            # the events that lead to the pictures of this part, and out of placing it
            mine = [row for row in of_run if row.part == part]
            plan = next(row for row in mine if row.name == "plan")
            started = [
                row
                for row in of_run
                if row.kind == "event"
                and row.body.get("to") == "execute_acquiring"
                and row.seq < plan.seq
            ][-1]
            placed = next(row for row in of_run if row.name == "placed" and row.seq > plan.seq)
            took_s = (placed.t_mono_s - started.t_mono_s) * reached
            found.append(
                {
                    "run": run,
                    "part": part,
                    "forecast_s": plan.body["forecast_s"],
                    "took_s": round(took_s, 1),
                    "ratio": round(took_s / plan.body["forecast_s"], 3),
                    "recoveries": sum(row.name == "recovery" for row in mine),
                    "speed_reached": reached,
                }
            )
    return found


def make_runs(runs: Path, args: argparse.Namespace) -> None:
    """Run the recipes in turn."""
    for number in range(args.make):
        recipe = args.recipes[number % len(args.recipes)]
        command = [
            sys.executable, "-m", "controller.cli", "run", f"recipes/{recipe}.yaml", "--json",
            "--speed", f"{args.speed:g}", "--seed", str(args.seed + number), "--runs", str(runs),
        ]  # fmt: skip
        subprocess.run(
            command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False
        )


def summary(parts: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return what the ratios come to, of parts without a recovery action."""
    ratios = np.array([one["ratio"] for one in parts if not one["recoveries"]])
    if not len(ratios):
        return {"parts": len(parts), "without_recovery": 0}
    low, middle, high = (round(float(v), 3) for v in np.quantile(ratios, [0.05, 0.5, 0.95]))
    return {
        "parts": len(parts),
        "without_recovery": len(ratios),
        "ratio_5": low,
        "ratio_median": middle,
        "ratio_95": high,
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", type=Path, nargs="?", help="folder of runs")
    parser.add_argument("--make", type=int, default=0, metavar="N", help="make so many runs first")
    parser.add_argument("--recipes", nargs="+", default=RECIPES)
    parser.add_argument("--seed", type=int, default=5001)
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        runs = args.runs or Path(scratch)
        make_runs(runs, args)
        parts = parts_of(runs)
    total = summary(parts)
    if args.json:
        print(json.dumps({"bench": "forecast", "parts": parts, "summary": total}))
        return 0
    for one in parts:
        print(
            f"{one['run'][-30:]:30} part {one['part']}: forecast {one['forecast_s']:6.1f} s, took "
            f"{one['took_s']:6.1f} s, {one['ratio']:.2f}, {one['recoveries']} recoveries, "
            f"{one['speed_reached']:.1f}x"
        )
    for name, value in total.items():
        print(f"{name:20} {value}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
