"""Plans for every part from every way it can lie: what they show, what is proven, what they take.

python benchmarks/bench_planning.py [--parts NAME...] [--placements 3] [--poses N] [--judge]
                                    [--fresh] [--json FILE]

Seconds are CPU seconds of one process (set OPENBLAS_NUM_THREADS=1). Per part: preparation, full
and coarse, the latter with its first plan. Per start pose and place: the plan, the plan anew from
the hand half-way and from the table after a drop, its proof, what greedy search would have paid,
and whether a second run gives the same bytes. `--judge` has each plan judged by planning_judge:
every contact, every claim of every view, and a search of its own for what was left unseen.
"""

from __future__ import annotations

import argparse
import dataclasses
import hashlib
import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "unit"), str(ROOT / "benchmarks")]

from planning_cell import emulated_layout, read_cell  # noqa: E402  (path set above)
from planning_judge import Judge, Verdict  # noqa: E402
from planning_parts import planning_parts, read_part, start_poses  # noqa: E402

from controller.cad import StablePose  # noqa: E402
from controller.cad.compiled import CompiledPart  # noqa: E402
from controller.planning import (  # noqa: E402
    CellLayout,
    InArm,
    Look,
    NoPlanError,
    OnTable,
    Plan,
    PlanOptions,
    PreparedPart,
    Present,
    plan_from,
    prepare_part,
    resting_pose,
)
from controller.planning.planner import planner as _planner  # noqa: E402
from controller.planning.search import FULL, Effort, Problem, Solution, greedy  # noqa: E402

WRONG_MM, WRONG_RAD = 1.0, np.radians(2.0)  # what a measured grip is off the planned one
T = TypeVar("T")
Array = NDArray[np.float64]


def timed(work: Callable[[], T]) -> tuple[T, float]:
    begin = time.process_time()
    result = work()
    return result, time.process_time() - begin


def digest(thing: object) -> str:
    """Return a hash of every bit of a plan: fields in order, arrays as they are."""
    found = hashlib.sha256()

    def put(x: object) -> None:
        if dataclasses.is_dataclass(x):
            found.update(type(x).__name__.encode())
            for f in dataclasses.fields(x):
                put(getattr(x, f.name))
        elif isinstance(x, np.ndarray):
            found.update(f"{x.dtype}{x.shape}".encode() + np.ascontiguousarray(x).tobytes())
        elif isinstance(x, Mapping):
            for key, value in x.items():
                found.update(str(key).encode())
                put(value)
        elif isinstance(x, tuple | list):
            found.update(f"[{len(x)}".encode())
            for item in x:
                put(item)
        else:
            found.update(repr(x).encode())

    put(thing)
    return found.hexdigest()[:16]


@contextmanager
def asked() -> Iterator[list[tuple[Problem, Solution | None]]]:
    """Collect what the planner asks its search, with the answers."""
    calls: list[tuple[Problem, Solution | None]] = []
    search = _planner.solve

    def listening(
        problem: Problem, effort: Effort = FULL, incumbent: Solution | None = None
    ) -> Solution | None:
        answer = search(problem, effort=effort, incumbent=incumbent)
        calls.append((problem, answer))
        return answer

    _planner.solve = listening
    try:
        yield calls
    finally:
        _planner.solve = search


@dataclass
class Run:
    """One start."""

    part: str
    pose: int
    place: tuple[float, float, float]
    plan_s: float = float("nan")
    failure: str = ""
    covered: float = 0.0
    reachable: float = 0.0
    views: int = 0
    regrips: int = 0
    forecast_s: float = 0.0
    cost_s: float = 0.0
    gap: float = float("nan")
    greedy_s: float = float("nan")
    digest: str = ""
    is_same: bool | None = None
    replan_s: list[float] = field(default_factory=list)
    replan_failures: list[str] = field(default_factory=list)
    left_out: float = 0.0
    verdict: dict[str, Any] = field(default_factory=dict)


@dataclass
class PartRow:
    """One part: its preparation, and its runs."""

    name: str
    triangles: int
    samples: int
    prepare_s: float = float("nan")
    coarse_s: float = float("nan")
    coarse_covered: float = float("nan")
    grasps: tuple[int, int] = (0, 0)
    refusal: str = ""
    is_same: bool | None = None
    runs: list[Run] = field(default_factory=list)


def bench_part(
    name: str, part: CompiledPart, layout: CellLayout, args: argparse.Namespace
) -> PartRow:
    options = PlanOptions()
    row = PartRow(name, len(part.solid.mesh.faces), len(part.samples.points_mm))
    try:
        prepared, row.prepare_s = timed(
            lambda: prepare_part(part.solid, part.chosen_by, layout, options, part.samples)
        )
    except NoPlanError as error:
        row.refusal = str(error)
        return row
    row.grasps = len(prepared.arm_grasps), len(prepared.fixed_grasps)
    if args.fresh:
        again = prepare_part(part.solid, part.chosen_by, layout, options, part.samples)
        row.is_same = digest(again) == digest(prepared)
    poses = start_poses(part)[: args.poses]
    if poses:
        _coarse(row, part, layout, options, poses[0])
    judge = Judge(part.solid, part.samples, layout, options) if args.judge else None
    area = read_cell()["table"]["drop_area"]
    for pose in poses:
        rng = np.random.default_rng([args.seed, pose.index])
        for k in range(args.placements):
            place = (*(rng.uniform(*area[axis]) for axis in "xy"), rng.uniform(-np.pi, np.pi))
            other = (*(rng.uniform(*area[axis]) for axis in "xy"), rng.uniform(-np.pi, np.pi))
            run = Run(name, pose.index, place)
            row.runs.append(run)
            _run(run, prepared, layout, pose, other, judge, is_twice=k == 0)
            report(run)
    return row


def _coarse(
    row: PartRow, part: CompiledPart, layout: CellLayout, options: PlanOptions, pose: StablePose
) -> None:
    start = OnTable(pose.index, resting_pose(part.solid, pose, 350.0, 0.0, 0.3))
    try:
        plan, row.coarse_s = timed(
            lambda: plan_from(
                prepare_part(part.solid, part.chosen_by, layout, options.coarse(), part.samples),
                layout,
                start,
            )
        )
    except NoPlanError as error:
        print(f"{row.name}: no coarse plan: {error}", file=sys.stderr)
        return
    row.coarse_covered = plan.covered_fraction


def _run(
    run: Run,
    prepared: PreparedPart,
    layout: CellLayout,
    pose: StablePose,
    other: tuple[float, float, float],
    judge: Judge | None,
    is_twice: bool,
) -> None:
    start = OnTable(pose.index, resting_pose(prepared.solid, pose, *run.place))
    with asked() as calls:
        try:
            plan, run.plan_s = timed(lambda: plan_from(prepared, layout, start))
        except NoPlanError as error:
            run.failure = str(error)
            return
    run.covered, run.reachable = plan.covered_fraction, plan.reachable_fraction
    run.views, run.regrips = len(plan.presents), plan.regrasp_count
    run.forecast_s = plan.forecast_s
    run.cost_s, run.gap = plan.proof.cost_s, plan.proof.gap
    run.left_out = sum(u.area_fraction for u in plan.unseen if u.kind.name == "LEFT_OUT")
    run.greedy_s = _greedy_cost(calls, plan)
    run.digest = digest(plan)
    if is_twice:
        run.is_same = digest(plan_from(prepared, layout, start)) == run.digest
    _replans(run, plan, prepared, layout, pose, other)
    if judge is not None:
        verdict = judge.judge(plan, start, prepared.arm_grasps)
        run.verdict = told(verdict)


def _greedy_cost(calls: list[tuple[Problem, Solution | None]], plan: Plan) -> float:
    """Return what greedy search pays on the problem whose answer became the plan."""
    for problem, answer in reversed(calls):
        if answer is not None and answer.cost_s == plan.proof.cost_s and answer.is_complete:
            rival = greedy(problem)
            is_rival = rival is not None and rival.is_complete
            return rival.cost_s if rival is not None and is_rival else float("nan")
    return float("nan")


def _replans(
    run: Run,
    plan: Plan,
    prepared: PreparedPart,
    layout: CellLayout,
    pose: StablePose,
    other: tuple[float, float, float],
) -> None:
    """Plan anew half-way: from the hand that holds it a little wrongly, and after a drop."""
    middle = plan.presents[: max(1, len(plan.presents) // 2)]
    if not middle:
        return
    last = middle[-1]
    until = next(k for k, s in enumerate(plan.steps) if s is last) + 1
    views = [s for s in plan.steps[:until] if isinstance(s, Present | Look)]
    seen = np.any([v.seen for v in views], axis=0)
    grasp = replace(last.grasp, T_part_tcp=_wrongly(last.grasp.T_part_tcp, run))
    dropped = OnTable(pose.index, resting_pose(prepared.solid, pose, *other))
    for start in (InArm(grasp, last.q), dropped):
        try:
            anew, seconds = timed(
                lambda start=start: plan_from(prepared, layout, start, seen=seen)  # type: ignore[misc]
            )
        except NoPlanError as error:
            run.replan_failures.append(str(error))
            continue
        run.replan_s.append(seconds)
        # a face seen from aside before may still want its square view
        square = {v.square_to for v in middle}
        again = [
            v
            for v in anew.presents
            if not (v.seen & ~seen).any() and (v.square_to < 0 or v.square_to in square)
        ]
        if again:
            run.replan_failures.append(f"{len(again)} views show nothing that was not seen before")


def _wrongly(T_part_tcp: Array, run: Run) -> Array:
    """Return the grip a millimetre and two degrees off, in directions of the run's own."""
    rng = np.random.default_rng([run.pose, int(run.place[0])])
    axis, shift = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    c, s = np.cos(WRONG_RAD), np.sin(WRONG_RAD)
    across = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    out = T_part_tcp.copy()
    out[:3, :3] = out[:3, :3] @ (np.eye(3) + s * across + (1 - c) * across @ across)
    out[:3, 3] += WRONG_MM * shift
    return out


def told(verdict: Verdict) -> dict[str, Any]:
    """Return a verdict in plain values."""
    kept = {
        f.name: getattr(verdict, f.name)
        for f in dataclasses.fields(verdict)
        if f.name not in {"evidence"}
    }
    return {
        **{k: float(v) if isinstance(v, float) else v for k, v in kept.items()},
        "of_showable": verdict.of_showable,
        "evidence": [(e.sample, e.grip_id) for e in verdict.evidence],
    }


def report(run: Run) -> None:
    x, y, turn = run.place
    where = f"{run.part:20.20} {run.pose:2d} ({x:3.0f},{y:4.0f},{np.degrees(turn):4.0f})"
    if run.failure:
        print(f"{where} no plan: {run.failure}", flush=True)
        return
    saved = 1 - run.cost_s / run.greedy_s
    same = {None: " ", True: "=", False: "DIFFERS"}[run.is_same]
    again = "/".join(f"{s:.2f}" for s in run.replan_s) or "-"
    line = (
        f"{where} {run.plan_s:5.2f} s  again {again:>11}  views {run.views:2d} regrips "
        f"{run.regrips}  {100 * run.covered:6.2f} of {100 * run.reachable:6.2f} %  forecast "
        f"{run.forecast_s:5.0f} s  gap {100 * run.gap:4.1f} %  greedy {100 * saved:+5.1f} % {same}"
    )
    if run.verdict:
        v = run.verdict
        line += (
            f"  judge: {100 * v['of_showable']:6.2f} % of showable, floor {v['floor_regrips']}, "
            f"{v['false_claims']} false of {v['claims']}, wrong reasons "
            f"{100 * v['wrong_kinds']:.2f} % in {v['cpu_s']:.1f} s"
        )
    print(line, flush=True)
    said = [run.verdict.get(key, []) for key in ("trouble", "notes")]
    for text in [*run.replan_failures, *said[0], *said[1]]:
        print("    ", text, flush=True)


def summary(rows: list[PartRow]) -> None:
    runs = [r for row in rows for r in row.runs]
    good = [r for r in runs if not r.failure]
    print(f"\n{len(rows)} parts, {len(runs)} starts, {len(good)} planned")
    for row in rows:
        if row.refusal:
            print(f"  refused: {row.refusal}")
    if not good:
        return

    def line(what: str, values: list[float], unit: str, limit: str) -> None:
        v = np.array([x for x in values if np.isfinite(x)])
        if len(v):
            print(
                f"  {what:34} median {np.median(v):8.2f}  p95 {np.percentile(v, 95):8.2f}  worst "
                f"{v.max():8.2f} {unit:3} ({limit})"
            )

    line("preparation", [r.prepare_s for r in rows], "s", "<= 10 up to 20k triangles")
    line("coarse: preparation and plan", [r.coarse_s for r in rows], "s", "<= 2.5")
    line("plan", [r.plan_s for r in good], "s", "<= 5")
    line("plan anew", [s for r in good for s in r.replan_s], "s", "<= 1 median")
    line("proof gap", [100 * r.gap for r in good], "%", "0 on >= 95 %")
    optimal = np.mean([r.gap < 1e-9 for r in good])
    print(f"  proven optimal: {100 * optimal:.1f} % of plans (>= 95)")
    saved = np.array([100 * (1 - r.cost_s / r.greedy_s) for r in good if np.isfinite(r.greedy_s)])
    if len(saved):
        print(
            f"  cheaper than greedy: mean {saved.mean():.1f} %, worst {saved.min():.1f} %, best "
            f"{saved.max():.1f} % (mean >= 5, worst >= 0)"
        )
    same = [r.is_same for r in good if r.is_same is not None]
    print(f"  same bytes twice: {sum(map(bool, same))} of {len(same)}")
    fresh = [r.is_same for r in rows if r.is_same is not None]
    if fresh:
        print(f"  same preparation twice: {sum(map(bool, fresh))} of {len(fresh)}")
    counts = dict(zip(*np.unique([r.regrips for r in good], return_counts=True), strict=True))
    print("  regrips: " + ", ".join(f"{n} x {k}" for k, n in counts.items()))
    line("plan less than reachable", [100 * (r.reachable - r.covered) for r in good], "%", "0")
    judged = [r for r in good if r.verdict]
    if judged:
        v = [r.verdict for r in judged]
        print(f"  judged: {len(judged)} plans")
        line("  of what can be shown, missing", [100 * (1 - x["of_showable"]) for x in v], "%", "0")
        line("  unseen with a wrong reason", [100 * x["wrong_kinds"] for x in v], "%", "0")
        line("  judging", [x["cpu_s"] for x in v], "s", "<= 10")
        claims, false = sum(x["claims"] for x in v), sum(x["false_claims"] for x in v)
        print(f"    false claims of views: {false} of {claims}")
        print(f"    plans with contacts or custody at fault: {sum(bool(x['trouble']) for x in v)}")
        over = sum(r.regrips > r.verdict["floor_regrips"] for r in judged)
        one = sum(r.verdict["floor_regrips"] == 1 for r in judged)
        print(f"    opaque-pad floor 1 on {one} plans; more re-grips than the floor on {over}")


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--parts", nargs="*", default=[], metavar="NAME")
    parser.add_argument("--placements", type=int, default=3)
    parser.add_argument("--poses", type=int, default=None, help="at most so many, likeliest first")
    parser.add_argument("--judge", action="store_true")
    parser.add_argument("--fresh", action="store_true", help="prepare twice and compare")
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    layout = emulated_layout()
    rows = []
    for name, file in planning_parts(args.parts).items():
        row = bench_part(name, read_part(file), layout, args)
        rows.append(row)
        print(
            f"{name}: {row.triangles} triangles, {row.samples} samples, {row.grasps[0]} + "
            f"{row.grasps[1]} grips, prepared in {row.prepare_s:.1f} s; coarse plan in "
            f"{row.coarse_s:.1f} s shows {100 * row.coarse_covered:.1f} %{row.refusal}",
            flush=True,
        )
    summary(rows)
    if args.json:
        args.json.write_text(
            json.dumps([dataclasses.asdict(r) for r in rows], indent=1, default=float)
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
