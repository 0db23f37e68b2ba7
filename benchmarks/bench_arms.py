"""What an arm shows of a part without regrasp: the UMI RTX, and a UR5e with either gripper.

python benchmarks/bench_arms.py [--parts NAME...] [--plans] [--json]

`one_grasp`: share of the surface that the best grasp by which the part can be picked shows alone,
with the look at the table from above. `new`, `lost`: share that some such grasp shows with this
arm and none with the first, and the other way round. `all_grasps`: share that all grasps show
together. With `--plans` the plans from the middle of the drop area, too: covered, regrasps,
forecast. Means over the stable poses in which a part may start, by their probabilities; poses that
a symmetry makes one count once. Without the cache, by a recipe's default figures.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_name] = "1"

import numpy as np  # noqa: E402  (threads come first)
from bench import EMULATED, ROOT, Arguments, note, show  # noqa: E402
from known_parts import cad_files, start_poses  # noqa: E402

from controller.arrays import BoolArray, FloatArray  # noqa: E402
from controller.cad import StablePose  # noqa: E402
from controller.cad.compiled import CompiledPart, load_part  # noqa: E402
from controller.cell.plans import PlanCache  # noqa: E402
from controller.config import Cell, load_cell  # noqa: E402
from controller.planning import CellLayout, NoPlanError, OnTable, Plan, PreparedPart, resting_pose  # noqa: E402
from controller.planning.planner.beginning import from_table  # noqa: E402
from controller.setup.planner import planner_setup  # noqa: E402

UR5E = EMULATED.with_name("ur5e.yaml")
# parts of the recipes, and nine of the benchmarks' own; no mirror image, and no part of which the
# cells' grippers hold nothing
PARTS = (
    *("holder", "idler_riser", "featuretype", "flange_xy", "widget"),
    *("angle_bracket", "clevis", "cover_plate", "l_profile", "lever"),
    *("short_shaft", "stepped_shaft", "t_slot_nut", "wedge_block"),
)


def cells() -> dict[str, Cell]:
    """Return the cells by name; the last one is the UR5e with the gripper of the RTX."""
    rtx, ur5e = load_cell(EMULATED), load_cell(UR5E)
    gripper = ("arm_gripper", "fingers", "jaws", "jaw_max_mm")
    arm = ur5e.arm.model_copy(update={key: getattr(rtx.arm, key) for key in gripper})
    same = ur5e.model_copy(update={"arm": arm})
    return {"RTX": rtx, "UR5e": ur5e, "UR5e, RTX's gripper": same}


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """A part in a cell.

    Attributes
    ----------
    figures : of the table, by column
    weights : (n,) share of the surface that each sample stands for
    by_first : per stable pose with its probability, the samples (n,) that some first grasp shows
    """

    figures: dict[str, Any]
    weights: FloatArray
    by_first: tuple[tuple[float, BoolArray], ...]

    def share_beyond(self, other: Measured) -> float:
        """Return the share of the surface that a first grasp shows here, and none there."""
        only = [
            (share, float(self.weights[shown & ~there].sum()))
            for (share, shown), (_, there) in zip(self.by_first, other.by_first, strict=True)
        ]
        return _mean([share for _, share in only], [probability for probability, _ in only])


def shown_by_first(prepared: PreparedPart, layout: CellLayout, pose: StablePose) -> BoolArray:
    """Return what each first grasp shows, with the look at the table: (g, n), none where g is 0."""
    x, y = layout.set_down_mm.mean(axis=1).tolist()
    start = OnTable(pose.index, resting_pose(prepared.solid, pose, x, y))
    none = np.zeros(len(prepared.weights), dtype=bool)
    try:
        beginning = from_table(prepared, layout, start, none)
    except NoPlanError:
        return none[:0, None]
    seen = none if beginning.look is None else beginning.look.seen
    return np.asarray(prepared.covered[np.isfinite(beginning.first_s)] | seen)


def measure(part: CompiledPart, cell: Cell, *, with_plans: bool) -> Measured:
    """Return what a part comes to in a cell."""
    setup = planner_setup(None, cell, part)
    planning = PlanCache(part, setup.layout, setup.options, use_cache=False)
    began = time.process_time()
    prepared = planning.prepared()
    by_first: list[tuple[float, BoolArray]] = []
    alone: list[float] = []
    plans: list[Plan | None] = []
    for pose in start_poses(part):
        if not pose.is_distinct:
            continue
        share = sum(p.probability for p in part.poses if p.first_alike == pose.first_alike)
        shown = shown_by_first(prepared, setup.layout, pose)
        by_first.append((share, np.any(shown, axis=0)))
        alone.append(max((float(prepared.weights[s].sum()) for s in shown), default=0.0))
        if with_plans:
            plans.append(planning.certified(pose).certificate.plan)
    shares = [share for share, _ in by_first]
    told: dict[str, Any] = {
        "poses": len(shares),
        "not_picked": sum(not one for one in alone),
        "one_grasp": _mean(alone, shares),
        "all_grasps": float(prepared.weights[np.any(prepared.covered, axis=0)].sum()),
    }
    if with_plans:
        told["planned"] = _mean([0.0 if p is None else p.covered_fraction for p in plans], shares)
        there = [(p, share) for p, share in zip(plans, shares, strict=True) if p is not None]
        for key in ("regrasp_count", "forecast_s") if there else ():
            told[key] = _mean([getattr(p, key) for p, _ in there], [share for _, share in there])
    told["cpu_s"] = time.process_time() - began
    return Measured(told, prepared.weights, tuple(by_first))


def _mean(values: Sequence[float], shares: Sequence[float]) -> float:
    return float(np.average(values, weights=shares))


def main() -> int:
    """Print the table, or JSON."""
    parser = Arguments(__doc__, parts=["cover_plate"])
    parser.add_argument("--parts", nargs="*", default=list(PARTS), metavar="NAME")
    parser.add_argument("--plans", action="store_true", help="plan, too: twice as long")
    given = parser.parse_args()
    files = cad_files([ROOT / "recipes" / "parts", ROOT / "benchmarks" / "parts"])
    if unknown := [name for name in given.parts if name not in files]:
        raise SystemExit(f"no part {', '.join(unknown)}; there are {', '.join(files)}")
    rows: list[dict[str, Any]] = []
    for name in given.parts:
        part = load_part(files[name])
        first: Measured | None = None
        for label, cell in cells().items():
            one = measure(part, cell, with_plans=given.plans)
            first = first or one
            beyond = {"new": one.share_beyond(first), "lost": first.share_beyond(one)}
            rows.append({"part": name, "arm": label, **one.figures} | beyond)
            note(rows[-1])
    show(given, rows, figures(rows))
    return 0


def figures(rows: Sequence[dict[str, Any]]) -> dict[str, object]:
    """Return what the parts come to, by arm."""
    told: dict[str, object] = {}
    for label in dict.fromkeys(row["arm"] for row in rows):
        mine = [row for row in rows if row["arm"] == label]
        for key in ("one_grasp", "new", "lost", "planned", "regrasp_count", "forecast_s"):
            if values := [row[key] for row in mine if key in row]:
                told[f"{label}: {key}, mean of {len(values)} parts"] = float(np.mean(values))
    return told


if __name__ == "__main__":
    sys.exit(main())
