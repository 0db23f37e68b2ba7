"""IK, contacts, ways between configurations and their forecast, each against its number.

python benchmarks/bench_motion.py [--json] [--parts NAME...] [--pairs 60] [--moves 40]

Ways are asked for between configurations that plans have: from one view to another, from above a
pick to a view, from a view to the way into the fixed gripper. The crowded cell has six more posts.
Numbers to reach (planning-facts.md 8): IK 2 us a pose, a state 0.1 ms, 95 % of the ways within 50
ms, all found that exist.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: threads only add noise

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "unit")]

from planning_cell import PARTS, emulated_layout  # noqa: E402  (path set above)

from controller.cad import load_solid, sample_surface  # noqa: E402
from controller.imaging import inverse_pose  # noqa: E402
from controller.planning import (  # noqa: E402
    Box,
    CellLayout,
    NoPlanError,
    prepare_part,
    resting_pose,
)
from controller.planning.geometry import PartShape, PlacedShape  # noqa: E402
from controller.planning.model import PreparedPart  # noqa: E402
from controller.planning.motion import (  # noqa: E402
    Scene,
    connect,
    inverse_rows,
    move_seconds,
    path_free,
    tcp_pose,
)
from controller.planning.regrasps import pick_paths  # noqa: E402
from drivers.umi_scara import UmiTiming  # noqa: E402
from drivers.umi_scara.model.kinematics import inverse_legal, within_limits  # noqa: E402

ALL_PARTS = ("featuretype", "flange_xy", "idler_riser", "holder")
POSTS = (  # [mm] where they are in the way, and yet leave one
    (250.0, 275.0, 150.0, 175.0, 0.0, 420.0),
    (430.0, 455.0, 120.0, 145.0, 0.0, 380.0),
    (520.0, 545.0, -140.0, -115.0, 0.0, 640.0),
    (230.0, 255.0, -215.0, -190.0, 0.0, 300.0),
    (470.0, 495.0, -330.0, -305.0, 0.0, 560.0),
    (60.0, 85.0, 300.0, 325.0, 0.0, 500.0),
)
Row = dict[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class Asked:
    """One way that a plan might ask for."""

    kind: str
    scene: Scene
    start: np.ndarray
    goal: np.ndarray


def crowded(layout: CellLayout) -> CellLayout:
    posts = {f"post {k}": Box.from_bounds(*bounds) for k, bounds in enumerate(POSTS)}
    return replace(layout, obstacles={**layout.obstacles, **posts})


def least_s(work: Callable[[], object], repeats: int = 5) -> float:
    times = []
    for _ in range(repeats):
        begin = time.process_time()
        work()
        times.append(time.process_time() - begin)
    return min(times)


def legal_rows(rng: np.random.Generator, n: int) -> np.ndarray:
    low = np.array([*np.radians([-90.0, -179.0, -170.0]), -940.0, *np.radians([-97.5, -131.0])])
    high = np.array([*np.radians([90.0, 150.0, 160.0]), -1.0, *np.radians([3.5, 180.0])])
    q = low + rng.random((n, 6)) * (high - low)
    return np.asarray(q[within_limits(q)])


def bench_ik(layout: CellLayout, seed: int) -> list[Row]:
    q = legal_rows(np.random.default_rng(seed), 40000)
    down = q.copy()
    down[:, 4] = -np.pi / 2
    rows = []
    for what, joints in (("any pose", q), ("straight down", down)):
        T = tcp_pose(layout, joints)
        T_arm = layout.arm.forward(joints)
        _, _, found = inverse_rows(layout, T)
        index, _, q_legal = inverse_legal(T_arm, layout.arm.geometry)
        error = np.abs(layout.arm.forward(q_legal) - T_arm[index]).max()
        rows.append(
            {
                "what": f"IK, {what}",
                "rows_us_a_pose": 1e6 * least_s(lambda T=T: inverse_rows(layout, T)) / len(T),
                "answers": len(found) / len(T),
                "missed": int(len(T) - len(np.unique(index))),
                "round_trip_error": float(error),
            }
        )
    return rows


def ms_a_state(scene: Scene, q: np.ndarray, repeats: int = 3) -> float:
    return 1e3 * least_s(lambda: scene.free(q, 5.0), repeats) / len(q)


def bench_contacts(layout: CellLayout, parts: list[PreparedPart], seed: int) -> list[Row]:
    rows = []
    for part in parts:
        shape = PartShape.of(part.solid)
        shape.model  # noqa: B018  -- builds the tree, once a part
        grasp = part.arm_grasps[0]
        T = inverse_pose(grasp.T_part_tcp)
        boxes = Scene(layout, grasp.opening_mm, layout.fixed_open_mm, part.carried_box(grasp))
        exact = replace(boxes, carried_mesh=PlacedShape(shape, T))
        q = legal_rows(np.random.default_rng(seed), 8000)
        undecided = boxes.contacts(q, 5.0) != exact.contacts(q, 5.0)
        # near what holds it the part's box touches something at every state
        near = np.concatenate([h.entry for table in part.hand_offs for h in table.values()][:40])
        near = near if len(near) else q[:100]
        rows.append(
            {
                "what": f"contacts, {part.solid.name}, {len(part.solid.mesh.faces)} triangles",
                "boxes_ms_a_state": ms_a_state(boxes, q),
                "exact_ms_a_state": ms_a_state(exact, q),
                "by_the_fixture_ms_a_state": ms_a_state(exact, near),
                "exact_20_states_ms_a_state": ms_a_state(exact, q[:20], 50),
                "freed_by_triangles": float(undecided.mean()),
            }
        )
    return rows


def asked_ways(
    layout: CellLayout, part: PreparedPart, pairs: int, rng: np.random.Generator
) -> list[Asked]:
    shape = PartShape.of(part.solid)
    asked: list[Asked] = []

    def views(g: int) -> np.ndarray:
        rows = list(part.view_q[g].values())
        return np.concatenate(rows) if rows else np.zeros((0, 6))

    def carrying(g: int) -> Scene:
        grasp = part.arm_grasps[g]
        mesh = PlacedShape(shape, inverse_pose(grasp.T_part_tcp))
        return Scene(layout, grasp.opening_mm, layout.fixed_open_mm, carried_mesh=mesh)

    usable = [g for g in range(len(part.arm_grasps)) if len(views(g)) > 1]
    for _ in range(pairs):
        g = usable[rng.integers(len(usable))]
        a, b = rng.choice(len(views(g)), 2, replace=False)
        asked.append(Asked("view to view", carrying(g), views(g)[a], views(g)[b]))
    resting = [p for p in part.poses if p.probability > 0.03]
    while sum(a.kind == "pick to view" for a in asked) < pairs:
        pose = resting[rng.integers(len(resting))]
        x, y, turn = rng.uniform(270, 450), rng.uniform(-100, 100), rng.uniform(-np.pi, np.pi)
        try:
            paths = pick_paths(part, layout, resting_pose(part.solid, pose, x, y, turn))
        except NoPlanError:
            continue
        paths = [w for w in paths if w.grasp in usable]
        for k in rng.permutation(len(paths))[:10]:
            g = paths[k].grasp
            goal = views(g)[rng.integers(len(views(g)))]
            asked.append(Asked("pick to view", carrying(g), paths[k].up[-1], goal))
    passing = [(g, h) for table in part.hand_offs for g, h in table.items() if g in usable]
    for k in rng.permutation(len(passing))[:pairs]:
        g, hand_off = passing[k]
        start = views(g)[rng.integers(len(views(g)))]
        asked.append(Asked("view to hand-off", carrying(g), start, hand_off.entry[0]))
    return asked


def bench_ways(cell: str, asked: list[Asked]) -> list[Row]:
    rows = []
    for kind in dict.fromkeys(a.kind for a in asked):
        times, slower, solved, straight, shut = [], [], 0, 0, 0
        for a in (a for a in asked if a.kind == kind):
            ends = np.stack([a.start, a.goal])
            if not a.scene.free(ends, 2.0).all():
                shut += 1  # in the crowded cell an end itself may stand in a post
                continue
            way: tuple[np.ndarray, ...] = ()
            took_s = np.inf
            for _ in range(2):  # the same work twice: the machine is shared
                begin = time.process_time()
                try:
                    way = connect(a.start, a.goal, replace(a.scene), kind)
                except NoPlanError:
                    way = ()
                took_s = min(took_s, time.process_time() - begin)
            times.append(1e3 * took_s)
            solved += bool(way)
            straight += len(way) == 1
            if way:
                slower.append(
                    move_seconds(a.scene.layout, [a.start, *way])
                    / move_seconds(a.scene.layout, [a.start, a.goal])
                )
            assert not way or path_free(a.scene, [a.start, *way])
        rows.append(
            {
                "what": f"{cell}: {kind}",
                "asked": len(times),
                "ends_shut": shut,
                "solved": solved / max(1, len(times)),
                "straight": straight / max(1, len(times)),
                "slower_than_line": float(np.mean(slower)) if slower else 0.0,
                "ms_median": float(np.median(times)) if times else 0.0,
                "ms_p95": float(np.percentile(times, 95)) if times else 0.0,
                "ms_max": max(times, default=0.0),
            }
        )
    return rows


def bench_forecast(count: int, speed: float, seed: int) -> list[Row]:
    """Drive the emulated arm over its wire; `fit_timing.py` says more."""
    from fit_timing import errors_by_size, timed_moves, tube_row

    moves = asyncio.run(timed_moves(speed, count, seed))
    every = errors_by_size(UmiTiming(), moves)[0]
    tube = tube_row(UmiTiming(), moves)
    return [
        {
            "what": f"forecast of {count} moves, speed {speed:g}",
            **{k: v for k, v in every.items() if k.endswith(("error", "sum"))},
            "tip_off_line_mm_p95": tube["tip_off_mm"][1],
            "tube_mm_p95": tube["tube_mm"][1],
            "outside_the_tube_mm": tube["outside_the_tube_mm"],
        }
    ]


def show(rows: list[Row], *, as_json: bool) -> None:
    for row in rows:
        if as_json:
            print(json.dumps(row), flush=True)
            continue
        figures = "  ".join(
            f"{k} {v:.3g}" if isinstance(v, float) else f"{k} {v}"
            for k, v in row.items()
            if k != "what"
        )
        print(f"{row['what']:40} {figures}", flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="one object a row")
    parser.add_argument("--parts", nargs="*", default=list(ALL_PARTS))
    parser.add_argument("--pairs", type=int, default=60, help="ways of each kind and part")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--moves", type=int, default=0, help="of the emulated arm, in real time")
    args = parser.parse_args()
    layout = emulated_layout()
    show(bench_ik(layout, args.seed), as_json=args.json)
    if args.moves:
        show(bench_forecast(args.moves, 1.0, args.seed), as_json=args.json)
    solids = [load_solid(PARTS / f"{name}.stl") for name in args.parts]
    parts = [prepare_part(s, sample_surface(s, 4.0), layout) for s in solids]
    show(bench_contacts(layout, parts, args.seed), as_json=args.json)
    asked = []
    for k, part in enumerate(parts):
        asked += asked_ways(layout, part, args.pairs, np.random.default_rng([args.seed, k]))
    show(bench_ways("cell", asked), as_json=args.json)
    more = crowded(layout)
    asked = [replace(a, scene=replace(a.scene, layout=more)) for a in asked]
    show(bench_ways("crowded", asked), as_json=args.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
