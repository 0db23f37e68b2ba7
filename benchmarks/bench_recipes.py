"""The shipped recipes on perfect parts: planned views, pictures, verdict, without the wires.

For every stable pose that a part is likely to take, the plan is made as in a run, each view is
pictured by the emulated world with errors of grip and arm, and judged. Told: verdict, coverage, and
which faces were compared too little and would have to be named by the recipe (`not_inspected`).

    python benchmarks/bench_recipes.py [--recipes holder ...] [--seeds 1] [--json]
"""

import sys
from collections import Counter
from typing import Any

import numpy as np
from bench import ROOT, Arguments, note, show
from inspection_scenes import (
    CELL,
    HOLD_DEG,
    HOLD_MM,
    VIEW_DEG,
    VIEW_MM,
    Held,
    Station,
    disturbed,
    rotation,
)

from controller.cell import compute
from controller.cell.actions import lamps_for
from controller.cell.compute import answers
from controller.cell.devices.lamps import TABLE_LAMPS
from controller.imaging import inverse_pose
from controller.inspection import (
    Verdict,
    ViewResult,
    ViewTask,
    inspect_view,
    judge,
)
from controller.planning import Look, NoPlanError, OnTable, Plan, Present, shown_pose
from controller.setup.holder import holder_boxes
from controller.setup.optics import build_lamps, panel_corners, table_corners
from emulators.world.poses import JointValues, forward

RECIPES = ("featuretype", "flange_xy", "holder", "idler_riser", "widget")
LIKELY = 0.04


def views_of(c: compute.Context, plan: Plan, station: Station, seed: int) -> list[ViewResult]:
    """Return the views of a plan as they are judged."""
    rng = np.random.default_rng(seed)
    held = Held(c.solid, c.samples, c.posed)
    limits = compute.inspection_limits(c.recipe)
    results: list[ViewResult] = []
    grasp, known, true, is_seen = None, np.eye(4), np.eye(4), False
    for number, step in enumerate(s for s in plan.steps if isinstance(s, Present)):
        if grasp is None or not np.allclose(step.grasp.T_part_tcp, grasp):
            grasp, is_seen = step.grasp.T_part_tcp, False
            slip = disturbed(np.eye(4), c.solid.centroid_mm, HOLD_MM, HOLD_DEG, rng)
            known, true = grasp, inverse_pose(slip) @ grasp
        T_true = shown_pose(c.layout, step.q, true)
        T_true = disturbed(T_true, c.layout.station_mm, VIEW_MM, VIEW_DEG, rng)
        joints = JointValues(*step.q[:3], *step.q[3:])
        width = step.expected_opening_mm
        lamps = lamps_for(step)
        links = forward(station.world_arm, joints)
        pictures = station.shoot(
            T_true, links["arm gripper"], width, lamps, 100 * seed + number,
            {k: v for k, v in links.items() if k != "arm gripper"},
        )  # fmt: skip
        task = ViewTask(
            view_id=step.view_id,
            camera=c.inspection,
            T_world_part_expected=shown_pose(c.layout, step.q, known),
            holder=holder_boxes(c.layout, step.q, width),
            panel_mm=panel_corners(c.cell, "station_backlight"),
            lamps=build_lamps(c.cell, lamps),
            limits=limits,
            is_hold_measured=is_seen,
        )
        result = inspect_view(held.part, c.samples, task, pictures)
        if result.evaluated and not is_seen:
            known = inverse_pose(result.T_world_part_known) @ links["arm gripper"]
            is_seen = True
        results.append(result)
    return results


def look(
    c: compute.Context, plan: Plan, station: Station, T: np.ndarray, seed: int
) -> list[ViewResult]:
    """Return what the views of the part on the table come to, judged as `inspect_on_table` does."""
    rng = np.random.default_rng(seed + 5000)
    results = []
    for step in (s for s in plan.steps if isinstance(s, Look)):
        middle = T[:3, :3] @ c.solid.centroid_mm + T[:3, 3]
        found = disturbed(T, middle, 0.1, 0.05, rng)
        found[2, 3] = T[2, 3]
        lamp = TABLE_LAMPS[0]
        pictures = station.shoot_lying(T, (lamp,), seed)
        task = ViewTask(
            view_id=step.view_id,
            camera=c.overhead,
            T_world_part_expected=found,
            holder=(),
            panel_mm=table_corners(c.cell),
            lamps=build_lamps(c.cell, (lamp,)),
            limits=compute.inspection_limits(c.recipe),
            is_hold_measured=True,
        )
        results.append(inspect_view(c.posed, c.samples, task, pictures).within(step.seen))
    return results


def run_recipe(name: str, seeds: list[int], poses: list[int] | None = None) -> list[dict[str, Any]]:
    """Return a row per stable pose and seed."""
    job = compute.Job(ROOT / "recipes" / f"{name}.yaml", CELL)
    c = compute.context(job)
    station = Station(c.solid.mesh)
    rows = []
    for pose in c.poses:
        if pose.marginal or pose.probability < LIKELY or (poses and pose.index not in poses):
            continue
        for seed in seeds:
            rng = np.random.default_rng(seed)
            T = np.eye(4)
            theta = rng.uniform(-np.pi, np.pi)
            T[:3, :3] = rotation(np.array([0.0, 0, 1]), theta) @ pose.R
            x, y = rng.uniform(300, 420), rng.uniform(-70, 70)
            T[:2, 3] = np.array([x, y]) - T[:2, :3] @ c.solid.centroid_mm
            T[2, 3] = -float((c.solid.mesh.vertices @ T[2, :3]).min())
            try:
                plan = answers.plan(job, OnTable(pose.index, T), None, frozenset(), ())
            except NoPlanError as error:
                rows.append({"recipe": name, "pose": pose.index, "seed": seed, "error": str(error)})
                continue
            results = [*look(c, plan, station, T, seed), *views_of(c, plan, station, seed)]
            unseen = {u.face_id: u.reason for u in plan.unseen}
            planned = {s.view_id: s.seen for s in plan.steps if isinstance(s, Present | Look)}
            limits = compute.inspection_limits(c.recipe)
            least = c.recipe.inspection.min_coverage
            got = judge(
                c.solid, c.samples, results, unseen, least, limits, c.not_inspected, planned
            )
            missing = {
                f.label: [round(f.compared_fraction, 2), f.rest[0][0] if f.rest else ""]
                for f in got.faces
                if f.verdict is Verdict.NOT_EVALUATED and f.area_mm2 >= limits.min_area_mm2
            }
            rows.append(
                {
                    "recipe": name,
                    "pose": pose.index,
                    "seed": seed,
                    "verdict": got.verdict.value,
                    "views": len(results),
                    "failures": [f for v in results for f in v.failures],
                    "covered": round(got.compared_fraction, 4),
                    "in_sight": round(got.in_sight_fraction, 4),
                    "planned": round(plan.covered_fraction, 4),
                    "findings": [
                        [v.view_id, f.lamp, round(f.area_mm2, 1), f.face_ids]
                        for v in results
                        for f in v.findings
                    ],
                    "not_compared": missing,
                    "reasons": list(got.reasons),
                }
            )
    return rows


def main() -> int:
    parser = Arguments(__doc__, recipes=["holder"], poses=[0])
    parser.add_argument("--recipes", nargs="+", default=list(RECIPES))
    parser.add_argument("--poses", nargs="+", type=int, help="stable poses (default: likely ones)")
    parser.add_argument("--seeds", nargs="+", type=int, default=[1])
    args = parser.parse_args()
    every: list[dict[str, Any]] = []
    for name in args.recipes:
        rows = run_recipe(name, args.seeds, args.poses)
        every += rows
        for row in rows:
            note(row)
    done = [row for row in every if "error" not in row]
    shares = [row["covered"] / row["in_sight"] for row in done]
    verdicts = Counter(row["verdict"] for row in done)
    figures = {"runs": len(every), "no plan": len(every) - len(done), **verdicts}
    show(
        args, every, figures | {"compared of what is in sight, at least": min(shares, default=None)}
    )
    return int(verdicts["fail"] > 0)


if __name__ == "__main__":
    sys.exit(main())
