"""How near the forecast of a whole part is to the cell's clock, from pictures to the tray.

    python benchmarks/bench_forecast.py RUNS [--json]
    python benchmarks/bench_forecast.py --simulate 20 [--recipes featuretype flange_xy] [--seed N]

The forecast of a whole part is what has passed from the first picture of the table until its first
plan is made, and the forecast that is shown then. It is held against the time from that picture
until the part is in its tray and the arm in its park, judging included, in cell seconds: the
journal's instants times the speed that the run reached. Computing takes wall time, so that only
runs at --speed 1 are a fair judge. Parts with recovery actions are counted apart, since no forecast
knows of them. With --simulate parts are made in one process
on a virtual clock (ADR 36), where no picture is made and the worker takes a drawn time. Below stand
the steps by their kind.
"""

import argparse
import logging
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from bench import Arguments, show

from controller.cell.journal import Row, read_rows
from simulation.case import Case, run_case
from simulation.cell import PLACES, Scene

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
            placed = next(
                row
                for row in of_run
                if row.kind == "event" and row.name == "placed" and row.seq > plan.seq
            )
            took_s = (placed.t_mono_s - started.t_mono_s) * reached
            forecast_s = (plan.t_mono_s - started.t_mono_s) * reached + plan.body["forecast_s"]
            found.append(
                {
                    "run": run,
                    "part": part,
                    "forecast_s": round(forecast_s, 1),
                    "took_s": round(took_s, 1),
                    "ratio": round(took_s / forecast_s, 3),
                    "recoveries": sum(row.name == "recovery" for row in mine),
                    "speed_reached": reached,
                    "steps": [
                        (kind_of(r.body["label"]), r.body["forecast_s"], r.body["seconds"])
                        for r in mine
                        if r.name == "step" and r.body.get("forecast_s")
                    ],
                }
            )
    return found


def kind_of(label: str) -> str:
    """Return what kind of step a label names: its first words."""
    return " ".join(label.split()[:2])


def steps_by_kind(parts: Sequence[dict[str, Any]]) -> list[tuple[str, int, float, float]]:
    """Return for each kind of step: how many, mean forecast, mean excess over it [s]."""
    found: dict[str, list[tuple[float, float]]] = {}
    for kind, forecast_s, took_s in (step for one in parts for step in one["steps"]):
        found.setdefault(kind, []).append((forecast_s, took_s - forecast_s))
    return [
        (kind, len(rows), *(round(float(v), 2) for v in np.mean(rows, axis=0)))
        for kind, rows in found.items()
    ]


def simulate(runs: Path, args: argparse.Namespace) -> list[dict[str, Any]]:
    """Simulate one part after another, of the recipes in turn; return what became of them."""
    logging.disable(logging.CRITICAL)
    found = []
    for number in range(args.simulate):
        turn, which = divmod(number, len(args.recipes))
        scene = Scene(args.recipes[which], place=turn % len(PLACES))
        folder = runs.resolve() / f"{args.seed + number}"
        run_case(Case(args.seed + number, scene), folder)
        found += parts_of(folder)
    return found


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
    parser = Arguments(__doc__, simulate=1, recipes=["holder"])
    parser.add_argument("runs", type=Path, nargs="?", help="folder of runs")
    parser.add_argument("--simulate", type=int, default=0, metavar="N", help="simulate so many")
    parser.add_argument("--recipes", nargs="+", default=RECIPES)
    parser.add_argument("--seed", type=int, default=5001)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        runs = args.runs or Path(scratch)
        parts = simulate(runs, args) if args.simulate else parts_of(runs)
    steps = {
        f"{kind} ({count})": f"forecast {forecast_s:.2f} s, took {excess_s:+.2f} s"
        for kind, count, forecast_s, excess_s in steps_by_kind(parts)
    }
    show(args, [{k: v for k, v in one.items() if k != "steps"} for one in parts],
         steps | summary(parts))  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
