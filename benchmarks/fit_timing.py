"""How long the emulated arm takes for a move, and how far from the joint line it strays meanwhile.

python benchmarks/fit_timing.py [--json] [--speed 5] [--moves 90] [--seed 1] [--keep moves.json]

Drives the arm over its wire through random moves of all sizes, fits the arm's `UmiTiming` to two
thirds of them and prints the errors of the forecast on the others, by size of the move. The table
below it says how far joints and tip were from the straight joint line: what the planner's tube has
to hold. `--keep` writes the timed moves down; `--load` fits moves that were kept.
"""

import argparse
import asyncio
import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "cross"), str(ROOT / "tests" / "unit")]

from planning_cell import emulated_layout  # noqa: E402  (path set above)
from umi_bench import EMULATED, ArmBench, arm_bench  # noqa: E402

from controller.planning.motion import segment_tube  # noqa: E402
from drivers.umi_scara import Axis, UmiTiming, kinematics  # noqa: E402

Floats = NDArray[np.float64]
Move = dict[str, Any]
ORDER = [Axis.ELBOW, Axis.SHOULDER, Axis.ZED, Axis.WRIST1, Axis.WRIST2, Axis.YAW]
LOW = np.array([*np.radians([-88.0, -150.0, -120.0]), -880.0, *np.radians([-95.0, -125.0])])
HIGH = np.array([*np.radians([88.0, 140.0, 120.0]), -15.0, *np.radians([3.0, 175.0])])
SIZES_S = (0.0, 0.3, 1.0, 2.5, np.inf)


def legal(rng: np.random.Generator) -> Floats:
    while True:
        q = LOW + rng.random(6) * (HIGH - LOW)
        if kinematics.within_limits(q):
            return np.asarray(q)


def next_target(rng: np.random.Generator, q: Floats, k: int) -> Floats:
    """Return where move `k` goes: anywhere, part of the way there, with few joints, with one."""
    while True:
        goal = legal(rng)
        step = goal - q
        if k % 4 == 1:
            step *= 10.0 ** rng.uniform(-2.0, 0.0)
        elif k % 4 >= 2:
            step[rng.permutation(6)[: 5 if k % 4 == 3 else rng.integers(2, 5)]] = 0.0
            step *= 10.0 ** rng.uniform(-1.0, 0.0)
        counts = kinematics.q_to_counts(q + step)
        target = kinematics.counts_to_q(counts)
        if kinematics.within_limits(target) and (counts != kinematics.q_to_counts(q)).any():
            return target


def strays(bench: ArmBench, start: Floats, goal: Floats, trace: Sequence[Floats]) -> Move:
    """Return how far the true joints were from the line at worst, each joint and the tip [mm]."""
    q = kinematics.counts_to_q(np.array(trace))
    far = goal - start
    scale = np.array([*np.radians([23.0, 44.0, 110.0]), 110.0, *np.radians([100.0, 100.0])])
    share = ((q - start) / scale) @ (far / scale) / ((far / scale) @ (far / scale))
    share = np.clip(share, 0.0, 1.0)[:, None]
    off = np.abs(q - (start + share * far))
    tip = kinematics.forward(q)[:, :3, 3]
    line = kinematics.forward(start + np.linspace(0, 1, 400)[:, None] * far)[:, :3, 3]
    near = np.linalg.norm(tip[:, None] - line[None], axis=2).min(axis=1)
    return {"off": off.max(axis=0).tolist(), "tip_mm": float(near.max())}


async def timed_moves(speed: float, count: int, seed: int) -> list[Move]:
    rng = np.random.default_rng(seed)
    moves: list[Move] = []
    trace: list[Floats] = []
    async with arm_bench(speed=speed, seed=3) as bench:
        await bench.as_if_homed()
        q = legal(rng)
        await bench.arm.move_joints(q)
        q = kinematics.counts_to_q(kinematics.q_to_counts(q))
        advance = bench.model.advance
        started: dict[Axis, float] = {}

        def watched(dt_s: float) -> None:
            advance(dt_s)
            trace.append(np.array([bench.true_counts()[axis] for axis in ORDER]))
            for axis in ORDER:
                if axis not in started and bench.model.axes[EMULATED[axis]].is_busy:
                    started[axis] = bench.lived_s

        bench.model.advance = watched  # type: ignore[method-assign]  # to look on
        for k in range(count):
            goal = next_target(rng, q, k)
            trace.clear()
            started.clear()
            begin_s, world_s = bench.clock.now_s(), bench.lived_s
            await bench.arm.move_joints(goal)
            # the time that the arm has lived: a busy host holds it back, which is not its slowness
            seconds = bench.lived_s - world_s
            moves.append(
                {
                    "from": q.tolist(),
                    "to": goal.tolist(),
                    "seconds": seconds,
                    "host_s": bench.clock.now_s() - begin_s - seconds,
                    "go_s": min(started.values(), default=world_s) - world_s,
                    "skew_s": max(started.values(), default=0) - min(started.values(), default=0),
                    **strays(bench, q, goal, trace),
                }
            )
            q = goal
    return moves


FITTED = ("ramp_s", "command_s", "motor_s", "switch_s")


def fitted(moves: Sequence[Move]) -> UmiTiming:
    """Return the timing with the least relative errors over moves: joint speeds and fixed times."""
    timing = UmiTiming()
    start, goal = (np.array([m[k] for m in moves]) for k in ("from", "to"))
    took_s = np.array([m["seconds"] for m in moves])
    # pitch and roll are one pair of like motors, hence five speeds
    speeds = np.array(timing.joint_per_s)[:5]

    def of(x: Floats) -> UmiTiming:
        joints = speeds * x[:5]
        times = dict(zip(FITTED, np.maximum(x[5:], 1e-3).tolist(), strict=True))
        return replace(timing, joint_per_s=(*joints.tolist(), float(joints[4])), **times)

    def errors(x: Floats) -> Floats:
        return of(x).move_seconds(start, goal) / took_s - 1.0

    first = np.array([1.0] * 5 + [getattr(timing, name) for name in FITTED])
    return of(least_squares(errors, first, x_scale=np.maximum(first, 0.05), loss="soft_l1").x)


def errors_by_size(timing: UmiTiming, moves: Sequence[Move]) -> list[Move]:
    """Return how far the forecast is off, for all moves and for moves of each size."""
    start, goal = (np.array([m[k] for m in moves]) for k in ("from", "to"))
    took_s = np.array([m["seconds"] for m in moves])
    off = timing.move_seconds(start, goal) / took_s - 1.0
    sizes = [(0.0, np.inf), *pairwise(SIZES_S)]
    rows = []
    for low, high in sizes:
        if (of := (took_s >= low) & (took_s < high)).any():
            rows.append(
                {
                    "took_s": [low, high if np.isfinite(high) else None],
                    "moves": int(of.sum()),
                    "mean_error": float(off[of].mean()),
                    "median_abs_error": float(np.median(np.abs(off[of]))),
                    "p95_abs_error": float(np.percentile(np.abs(off[of]), 95)),
                    "max_abs_error": float(np.abs(off[of]).max()),
                    "error_of_the_sum": float((off[of] * took_s[of]).sum() / took_s[of].sum()),
                }
            )
    return rows


def tube_row(timing: UmiTiming, moves: Sequence[Move]) -> Move:
    """Return how far the tip was off the joint line, and how far the planner expects it to be."""
    layout = emulated_layout()
    layout = replace(layout, arm=replace(layout.arm, timing=timing))
    at = np.linspace(0.0, 1.0, 101)
    tube = np.array(
        [segment_tube(layout, np.array(m["from"]), np.array(m["to"]), at).max() for m in moves]
    )
    tip = np.array([m["tip_mm"] for m in moves])
    skew = np.array([m["skew_s"] for m in moves])
    host = np.array([m["host_s"] for m in moves]) if "host_s" in moves[0] else np.zeros(1)
    return {
        "held_back_by_host_s": np.percentile(host, [50, 95, 100]).tolist(),
        "tip_off_mm": np.percentile(tip, [50, 95, 100]).tolist(),
        "tube_mm": np.percentile(tube, [50, 95, 100]).tolist(),
        "outside_the_tube_mm": float(np.maximum(tip - tube, 0.0).max()),
        "skew_s": np.percentile(skew, [50, 95, 100]).tolist(),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="one object a row")
    parser.add_argument("--speed", type=float, default=5.0, help="cell seconds a second")
    parser.add_argument("--moves", type=int, default=90)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="write the timed moves to this file")
    parser.add_argument("--load", type=Path, nargs="*", help="moves kept earlier; drives nothing")
    args = parser.parse_args()
    moves: list[Move] = []
    if args.load:
        for path in args.load:
            moves += json.loads(path.read_text())
    else:
        moves = asyncio.run(timed_moves(args.speed, args.moves, args.seed))
    if args.keep:
        args.keep.write_text(json.dumps(moves))
    used = [m for k, m in enumerate(moves) if k % 3]  # moves come in fours, so both have all kinds
    others = moves[::3]
    timing = fitted(used)
    tables = {
        "fitted": (timing, errors_by_size(timing, others)),
        "default": (UmiTiming(), errors_by_size(UmiTiming(), others)),
    }
    if args.json:
        for name, (which, rows) in tables.items():
            times = {n: getattr(which, n) for n in FITTED}
            print(json.dumps({"timing": name, "joint_per_s": which.joint_per_s, **times}))
            for row in rows:
                print(json.dumps({"timing": name, **row}))
        print(json.dumps(tube_row(UmiTiming(), moves)))
        return 0
    for name, (which, rows) in tables.items():
        degrees = [*np.degrees(which.joint_per_s[:3]), which.joint_per_s[3]]
        degrees.append(float(np.degrees(which.joint_per_s[4])))
        shown = ", ".join(f"{v:.1f}" for v in degrees)
        times = ", ".join(f"{n} {getattr(which, n):.3f}" for n in FITTED)
        print(
            f"{name} timing: shoulder, elbow, yaw [deg/s], zed [mm/s], wrist [deg/s] {shown}; "
            f"{times}"
        )
        print("  took s        moves   mean  |median|  |p95|   |max|  of the sum")
        for row in rows:
            low, high = row["took_s"]
            figures = "  ".join(
                f"{100 * row[k]:6.1f}%"
                for k in ("mean_error", "median_abs_error", "p95_abs_error", "max_abs_error")
            )
            what = f"{low:g} to {high if high else 'any'}"
            total = 100 * row["error_of_the_sum"]
            print(f"  {what:13} {row['moves']:5d} {figures}  {total:6.1f}%")
    tube = tube_row(UmiTiming(), moves)
    for key, value in tube.items():
        shown = ", ".join(f"{v:.2f}" for v in value) if isinstance(value, list) else f"{value:.2f}"
        print(f"{key}: {shown}" + (" (median, 95 %, most)" if isinstance(value, list) else ""))
    return 0


if __name__ == "__main__":
    sys.exit(main())
