"""One wrong byte at every place of whole sessions of the arm: what moved, what was said.

python benchmarks/bench_wire_faults.py [--json] [--sample N] [--seed S] [--flips N] [--jobs N]
    [--minutes M] | --noise [--sessions N] [--seed S] [--rate R]

Two sessions: cold open, moves of every axis, gripper, grip with a part, stops, park; and warm open,
homing, a move. At every byte of both directions: bits flipped (by default one, by the seed; 8 for
all), the byte lost, doubled, late by two amounts. Judged by the emulated motors. With --sample, so
many faults drawn at random; with --minutes, as many as fit, in an order that the seed draws.
With --noise, bursts of 1 to 5 random bytes in R of the gaps between exchanges, N sessions of each
kind and direction with the seeds from S on; told apart by how many bursts a session had. One step
of an axis (STEP_COUNTS) cannot be prevented, for the noise itself is the command: farther is bad.
Exit code 1 when an axis moved that was not asked to, when something was said to be done that is
not, or when a session did not end.
"""

import argparse
import random
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from typing import Any

from bench import Arguments, show
from umi_line_faults import (
    LineFault,
    Noise,
    Result,
    SessionName,
    Way,
    faults_at,
    quiet,
    run_session,
)

# Largest way of one interpolation command, which moves without an order to go: umi_rtx.md 2.7.
STEP_COUNTS = 8.0
WAYS: tuple[Way, ...] = ("to the arm", "from the arm")
SESSIONS: tuple[SessionName, ...] = ("moves", "homing")
Case = tuple[SessionName, LineFault]


def every_place(clean: dict[SessionName, Result], flip_count: int, seed: int) -> Iterator[Case]:
    """All faults at all places; which bits are flipped where follows from the seed."""
    rng = random.Random(seed)
    for name, result in clean.items():
        for way, count in result.place_counts.items():
            for place in range(count):
                for fault in faults_at(way, place, rng.sample(range(8), flip_count)):
                    yield name, fault


def run(case: Case) -> tuple[Case, Result]:
    with quiet():
        return case, run_session(*case)


def run_all(cases: list[Case], jobs: int, limit_s: float) -> Iterator[tuple[Case, Result]]:
    """Run cases in order until time is up."""
    until_s = time.perf_counter() + limit_s
    if jobs == 1:
        for case in cases:
            if time.perf_counter() > until_s:
                return
            yield run(case)
        return
    with ProcessPoolExecutor(jobs) as pool:
        step = 20 * jobs
        for first in range(0, len(cases), step):
            if time.perf_counter() > until_s:
                return
            yield from pool.map(run, cases[first : first + step], chunksize=5)


def tally(found: Iterable[tuple[Case, Result]]) -> tuple[list[dict[str, Any]], list[Any]]:
    """Return a row per session, direction and kind, and the cases that are bad."""
    rows: dict[tuple[str, ...], Counter[str]] = defaultdict(Counter)
    largest: dict[tuple[str, ...], float] = defaultdict(float)
    bad = []
    for (name, fault), result in found:
        key = (name, fault.way, fault.kind)
        row = rows[key]
        row["runs"] += 1
        row[result.end] += 1
        row["moved_unasked"] += bool(result.moved)
        row["false_done"] += bool(result.false_done)
        row["runs_on"] += bool(result.runs_on)
        largest[key] = max(largest[key], result.largest_counts)
        if result.is_bad:
            bad.append({"session": name, "fault": asdict(fault), "result": asdict(result)})
    columns = ("runs", "recovered", "went on after a fault", "fault", "clean", "bug", "hangs")
    return [
        {"session": key[0], "way": key[1], "kind": key[2]}
        | {column: rows[key][column] for column in columns}
        | {column: rows[key][column] for column in ("moved_unasked", "false_done", "runs_on")}
        | {"largest_unasked_counts": largest[key]}
        for key in sorted(rows)
    ], bad


NoisyCase = tuple[SessionName, Way, int, float]


def run_noisy(case: NoisyCase) -> tuple[NoisyCase, Result]:
    name, way, seed, rate = case
    with quiet():
        return case, run_session(name, noise=Noise(seed, rate, (way,)))


def noise_rows(found: Iterable[tuple[NoisyCase, Result]]) -> tuple[list[dict[str, Any]], list[Any]]:
    """Return a row per session, direction and number of bursts (3: more), and what is bad."""
    rows: dict[tuple[str, str, int], Counter[str]] = defaultdict(Counter)
    farthest: dict[tuple[str, str, int], float] = defaultdict(float)
    bad = []
    for (name, way, seed, _), result in found:
        key = (name, way, min(result.burst_count, 3))
        row = rows[key]
        far = result.largest_counts > STEP_COUNTS
        is_bad = far or result.false_done or result.runs_on or result.end in ("bug", "hangs")
        row["sessions"] += 1
        row["fault" if result.end == "fault" else "done"] += 1
        row["bad"] += bool(is_bad)
        farthest[key] = max(farthest[key], result.largest_counts)
        if is_bad:
            bad.append({"session": name, "way": way, "seed": seed, "result": asdict(result)})
    return [
        {"session": name, "way": way, "bursts": bursts}
        | {
            column: rows[name, way, bursts][column]
            for column in ("sessions", "done", "fault", "bad")
        }
        | {"largest_unasked_counts": farthest[name, way, bursts]}
        for name, way, bursts in sorted(rows)
    ], bad


def noise(args: argparse.Namespace) -> int:
    cases: list[NoisyCase] = [
        (name, way, seed, args.rate)
        for name in SESSIONS
        for way in WAYS
        for seed in range(args.seed, args.seed + args.sessions)
    ]
    if args.jobs == 1:
        rows, bad = noise_rows(map(run_noisy, cases))
    else:
        with ProcessPoolExecutor(args.jobs) as pool:
            rows, bad = noise_rows(pool.map(run_noisy, cases, chunksize=5))
    noisy = [row for row in rows if row["bursts"]]
    whole = {name: sum(row[name] for row in noisy) for name in ("sessions", "done", "fault", "bad")}
    show(args, rows, whole | {"bad ones": bad[:20]})
    return 1 if bad else 0


def main() -> int:
    parser = Arguments(__doc__, sample=40)
    parser.add_argument("--sample", type=int, help="number of faults, drawn at random")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--flips", type=int, default=1, help="bits flipped per byte (default: 1)")
    parser.add_argument("--jobs", type=int, default=1, help="processes (default: 1)")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="time to stop after")
    parser.add_argument("--noise", action="store_true", help="random bytes between exchanges")
    parser.add_argument("--sessions", type=int, default=50, help="with --noise (default: 50)")
    parser.add_argument("--rate", type=float, default=0.0003, help="of gaps with noise")
    args = parser.parse_args()
    if args.noise:
        return noise(args)
    began_s = time.perf_counter()
    with quiet():
        clean = {name: run_session(name) for name in SESSIONS}
    cases = list(every_place(clean, args.flips, args.seed))
    total_count = len(cases)
    random.Random(args.seed).shuffle(cases)
    cases = cases[: args.sample]
    rows, bad = tally(run_all(cases, args.jobs, 60 * args.minutes))
    whole = {
        "places": sum(sum(one.place_counts.values()) for one in clean.values()),
        "faults_in_all": total_count,
        "faults_run": sum(row["runs"] for row in rows),
        "recovered": sum(row["recovered"] + row["clean"] for row in rows),
        "went_on_after_a_fault": sum(row["went on after a fault"] for row in rows),
        "ended_with_a_fault": sum(row["fault"] for row in rows),
        "bugs_or_hangs": sum(row["bug"] + row["hangs"] for row in rows),
        "moved_unasked": sum(row["moved_unasked"] for row in rows),
        "false_done": sum(row["false_done"] for row in rows),
        "runs_on": sum(row["runs_on"] for row in rows),
        "largest_unasked_counts": max((row["largest_unasked_counts"] for row in rows), default=0.0),
        "seconds": round(time.perf_counter() - began_s, 1),
    }
    show(args, rows, {"bad ones": bad[:20], "seed": args.seed, **whole})
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
