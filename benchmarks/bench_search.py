"""The search for grips and views: how long, how often proven, how much better than greedy.

python benchmarks/bench_search.py [--json] [--random 2] [--parts NAME...] [--no-parts]

Random problems of real size (a lumpy body, directions round it, hands that hide and reach only
some of them), and the problems that the planner itself asks for parts of shared/parts from each
resting pose, as recorded while it plans. Each is solved in full, coarsely, and once more after the
first change of grip and the first view of the answer were refuted, with the old answer handed in.
Processor seconds, one thread.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_name] = "1"
ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "unit")]

import numpy as np  # noqa: E402  (threads and path come first)

from controller.planning.planner import planner as _planner  # noqa: E402
from controller.planning.search import (  # noqa: E402
    COARSE,
    Problem,
    best_order,
    greedy,
    refuted,
    solve,
)

PARTS = ROOT.parent / "shared" / "parts"
ALL_PARTS = ("featuretype", "flange_xy", "holder", "angle_block")
SHAPES: dict[str, dict[str, Any]] = {
    "80 grips, 1500 samples": {},
    "160 grips, 3000 samples": {"grasps": 160, "samples": 3000},
    "120 grips, steep views hidden": {"grasps": 120, "samples": 2500, "min_cos": 0.7},
    "120 grips, every hop possible": {"grasps": 120, "no_hop": 0.0},
}
SHOWN = (
    *("grips", "elements", "solve_s", "cost_s", "proven", "held_in_turn", "views", "covers"),
    *("greedy_cost_s", "coarse_s", "coarse_gap", "again_s"),
)
VIEW_S = 3.1
BODY_MM = 30.0


def sphere(count: int) -> np.ndarray:
    """Directions evenly round a point."""
    k = np.arange(count) + 0.5
    z, phi = 1.0 - 2.0 * k / count, np.pi * (1.0 + 5**0.5) * k
    r = np.sqrt(1.0 - z * z)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1)


def behind(
    points: np.ndarray, directions: np.ndarray, centre: np.ndarray, radius: float
) -> np.ndarray:
    """Which points (m, v) a ball hides in which directions."""
    away = (centre - points).astype(np.float32)
    along = away @ directions.T.astype(np.float32)
    off = (away**2).sum(axis=1)[:, None] - along**2
    return (along > -3.0) & (off < radius**2)


def random_problem(
    seed: int,
    grasps: int = 80,
    views: int = 200,
    samples: int = 1500,
    min_cos: float = 0.5,
    no_hop: float = 0.6,
) -> Problem:
    """A body of ten faces with lumps; each hand shows twice, with its flange on either side."""
    rng = np.random.default_rng([seed, grasps, samples])
    directions = sphere(views)
    normals = sphere(10) + rng.normal(0.0, 0.2, (10, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    face = rng.integers(10, size=samples)
    points = normals[face] * BODY_MM + rng.normal(0.0, 12.0, (samples, 3))
    visible = normals[face] @ directions.T > min_cos
    for _ in range(6):
        visible &= ~behind(points, directions, rng.normal(0.0, 25.0, 3), rng.uniform(4.0, 10.0))
    left, hands = [], []
    for _ in range(grasps // 2):
        approach = rng.normal(size=3)
        approach /= np.linalg.norm(approach)
        jaw = np.cross(approach, rng.normal(size=3))
        jaw /= np.linalg.norm(jaw)
        hidden = behind(points, directions, -approach * 60.0, 35.0)
        for side in (-1.0, 1.0):
            pad = side * jaw * BODY_MM
            hidden |= (np.linalg.norm(points - pad, axis=1) < 9.0)[:, None]
            for along in (0.0, 16.0, 32.0):
                hidden |= behind(points, directions, pad - approach * along, 9.0)
        left.append(np.ascontiguousarray((visible & ~hidden).T))
        hands.append(np.cross(approach, jaw))
    shows = []
    for g in range(grasps):
        table, up = left[g % len(left)], hands[g % len(left)] * (1 if g < len(left) else -1)
        reached = (directions @ up > -0.75) & (rng.random(views) > 0.05)
        shows.append(table[reached & (table.mean(axis=1) > 0.002)])

    def price(
        shape: int | tuple[int, int], least: float, most: float, missing: float
    ) -> np.ndarray:
        return np.where(rng.random(shape) < missing, np.inf, rng.uniform(least, most, shape))

    return Problem(
        shows=tuple(shows),
        weights=np.full(samples, 1.0 / samples),
        view_s=tuple(np.full(len(s), VIEW_S) for s in shows),
        first_s=price(grasps, 6.0, 12.0, 0.5),
        regrasp_s=price((grasps, grasps), 8.0, 16.0, no_hop),
        last_s=price(grasps, 4.0, 9.0, 0.4),
        seen=np.zeros(samples, dtype=bool),
    )


def asked_for(name: str) -> Iterator[tuple[int, Problem]]:
    """The problems the planner asks first for a part, per resting pose."""
    from planning_cell import emulated_layout, read_cell

    from controller.cad import load_solid, sample_surface, stable_poses
    from controller.planning import NoPlanError, plan_part, prepare_part, resting_pose

    layout, area = emulated_layout(), read_cell()["table"]["drop_area"]
    solid = load_solid(PARTS / f"{name}.stl")
    samples = sample_surface(solid, 4.0)
    prepared = prepare_part(solid, samples, layout)
    real: Callable[..., Any] = _planner.solve
    asked: list[Problem] = []

    def recorded(problem: Problem, **how: object) -> object:
        asked.append(problem)
        return real(problem, **how)

    for pose in stable_poses(solid):
        if pose.rolling or pose.probability <= 0.03:
            continue
        rng = np.random.default_rng([1, pose.index])
        at = rng.uniform(*area["x"]), rng.uniform(*area["y"])
        T = resting_pose(solid, pose, *at, rng.uniform(-np.pi, np.pi))
        asked.clear()
        _planner.solve = recorded
        try:
            plan_part(solid, samples, pose, T, layout, prepared=prepared)
        except NoPlanError as error:
            print(f"{name} {pose.index}: {error}", file=sys.stderr)
        finally:
            _planner.solve = real
        if asked:
            yield pose.index, asked[0]


def timed(work: Callable[[], Any]) -> tuple[Any, float]:
    """The answer and the processor seconds it took."""
    begin = time.process_time()
    answer = work()
    return answer, time.process_time() - begin


def row(label: str, problem: Problem) -> dict[str, Any] | None:
    """Figures of one problem."""
    best, full_s = timed(lambda: solve(problem))
    if best is None:
        return None
    quick, greedy_s = timed(lambda: greedy(problem))
    coarse, coarse_s = timed(lambda: solve(problem, effort=COARSE))
    regrasps = list(zip(best.grasps[:-1], best.grasps[1:], strict=True))[:1]
    views = [(g, v[0]) for g, v in zip(best.grasps, best.views, strict=True) if v][:1]
    less = refuted(problem, regrasps=regrasps, views=views)
    again, again_s = timed(lambda: solve(less, incumbent=best))
    return {
        "problem": label,
        "grips": problem.grasp_count,
        "views_each": round(float(np.mean([len(s) for s in problem.shows])), 1),
        "elements": len(problem.weights),
        "solve_s": round(full_s, 3),
        "cost_s": round(best.cost_s, 3),
        "gap": round(best.gap, 5),
        "proven": best.is_optimal,
        "complete": best.is_complete,
        "held_in_turn": len(best.grasps),
        "views": best.view_count,
        "covers": best.covers_count,
        "greedy_s": round(greedy_s, 3),
        "greedy_cost_s": round(quick.cost_s, 3) if quick and quick.is_complete else None,
        "coarse_s": round(coarse_s, 3),
        "coarse_gap": round(coarse.gap, 4),
        "coarse_excess": round(coarse.cost_s / best.cost_s - 1.0, 4),
        "again_s": round(again_s, 3),
        "again_proven": bool(again is not None and again.is_optimal),
    }


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Median, p95 and worst over problems; what is proven; what greedy pays more."""
    over = [
        1.0 - r["cost_s"] / r["greedy_cost_s"]
        for r in rows
        if r["greedy_cost_s"] is not None and r["complete"]
    ]
    result: dict[str, Any] = {"problems": len(rows)}
    for key in ("solve_s", "coarse_s", "again_s"):
        values = [r[key] for r in rows]
        result[key] = {
            "median": round(float(np.median(values)), 3),
            "p95": round(float(np.percentile(values, 95)), 3),
            "max": max(values),
        }
    result["proven"] = round(float(np.mean([r["proven"] for r in rows])), 4)
    result["saved_against_greedy"] = {
        "mean": round(float(np.mean(over)), 4) if over else None,
        "least": round(min(over), 4) if over else None,
        "most": round(max(over), 4) if over else None,
    }
    result["greedy_lost_its_way"] = sum(r["greedy_cost_s"] is None for r in rows)
    return result


def order_rows() -> list[dict[str, Any]]:
    """Milliseconds to order stops of four configurations each."""

    def slowest(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.abs(a - b).max(axis=-1)

    rows = []
    for count in (4, 8, 12, 16, 22):
        rng = np.random.default_rng(count)
        options = [rng.normal(size=(4, 6)) for _ in range(count)]
        order = partial(best_order, np.zeros(6), options, np.zeros(6), slowest)
        times = [timed(order)[1] for _ in range(5)]
        rows.append({"stops": count, "ms": round(1e3 * float(np.median(times)), 1)})
    return rows


def problems(random_count: int, parts: list[str]) -> Iterator[tuple[str, str, Problem]]:
    """Group, label and problem, one after the other."""
    for name, shape in SHAPES.items():
        for seed in range(random_count):
            yield name, f"{name} #{seed}", random_problem(seed, **shape)
    if not PARTS.is_dir():
        print("no parts: only random problems", file=sys.stderr)
        return
    for name in parts:
        for pose, problem in asked_for(name):
            yield name, f"{name}, pose {pose}", problem


def main() -> int:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--random", type=int, default=2, help="problems of each shape")
    parser.add_argument("--parts", nargs="*", default=list(ALL_PARTS))
    parser.add_argument("--no-parts", action="store_true")
    args = parser.parse_args()
    if not args.json:
        print(f"{'problem':34}" + "".join(f"{h[:12]:>13}" for h in SHOWN))
    groups: dict[str, list[dict[str, Any]]] = {}
    for group, label, problem in problems(args.random, [] if args.no_parts else args.parts):
        found = row(label, problem)
        if found is None:
            continue
        groups.setdefault(group, []).append(found)
        if not args.json:
            print(f"{label:34}" + "".join(f"{found[h]!s:>13}" for h in SHOWN), flush=True)
    every = [r for rows in groups.values() for r in rows]
    result = {
        "problems": every,
        "groups": {name: summary(rows) for name, rows in groups.items()},
        "all": summary(every),
        "order": order_rows(),
    }
    if args.json:
        print(json.dumps(result, indent=1))
        return 0
    for name, figures in (*result["groups"].items(), ("all", result["all"])):
        print(f"{name}: {json.dumps(figures)}")
    print("order of views:", ", ".join(f"{r['stops']} stops {r['ms']} ms" for r in result["order"]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
