"""Digests of the plans of the recipes: the same before and after a change that is to change none.

python benchmarks/plan_digests.py [--recipes NAME...] [--numbers] [--json]

Per recipe: what is prepared of its part, and the plan from every likely stable pose at two places
of the drop area, each as a hash of every bit; with the CPU seconds they took. Run it on both
states of the code and compare. `--numbers` leaves labels and reasons out: words may be put better
while every pose and joint of a plan stays.
"""

from __future__ import annotations

import dataclasses
import hashlib
import sys
import time
from collections.abc import Mapping
from enum import Enum

import numpy as np
from bench import EMULATED, ROOT, Arguments, note, show

from controller.cad import StablePose
from controller.cad.compiled import load_part
from controller.cell.compute import part_files
from controller.config import load_cell, load_recipe
from controller.planning import (
    CellLayout,
    NoPlanError,
    OnTable,
    PreparedPart,
    plan_from,
    prepare_part,
    resting_pose,
)
from controller.setup.planner import planner_setup

RECIPES = ("featuretype", "flange_xy", "holder", "idler_riser", "widget")
LIKELY = 0.03
OF_THE_PART = ("solid", "samples", "shape")  # what the planner is given; meshes have no digest
# shares of the drop area, and a turn [rad]: its middle, and a place that is none in particular
PLACES = ((0.5, 0.5, 0.0), (0.83, 0.21, 2.0))


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


def unworded(thing: object) -> object:
    """Return a plan as nested tuples without its words, for a digest of its numbers."""
    if dataclasses.is_dataclass(thing):
        return tuple(unworded(getattr(thing, f.name)) for f in dataclasses.fields(thing))
    if isinstance(thing, Mapping):
        return tuple(unworded(value) for value in thing.values())
    if isinstance(thing, tuple | list):
        return tuple(unworded(item) for item in thing)
    return "" if isinstance(thing, str | Enum) else thing


def plan_digest(
    part: PreparedPart,
    layout: CellLayout,
    pose: StablePose,
    place: tuple[float, float, float],
    *,
    numbers: bool,
) -> str:
    """Return the digest of one plan, or of the reason why there is none."""
    low, high = layout.set_down_mm.T
    x, y = low + np.array(place[:2]) * (high - low)
    T = resting_pose(part.solid, pose, float(x), float(y), place[2])
    try:
        plan = plan_from(part, layout, OnTable(pose.index, T))
    except NoPlanError as error:
        return "none" if numbers else f"none {digest(str(error))}"
    return digest(unworded(plan) if numbers else plan)


def digests(name: str, *, numbers: bool = False) -> dict[str, object]:
    """Return the digests of one recipe's plans, and what they took."""
    recipe = load_recipe(ROOT / "recipes" / f"{name}.yaml")
    part = load_part(*part_files(recipe)[0])
    setup = planner_setup(recipe, load_cell(EMULATED), part)
    begin = time.process_time()
    prepared = prepare_part(part.solid, part.chosen_by, setup.layout, setup.options, part.samples)
    prepare_s = time.process_time() - begin
    tables = {f.name: getattr(prepared, f.name) for f in dataclasses.fields(prepared)}
    known = {k: v for k, v in tables.items() if k not in OF_THE_PART}
    plans: dict[str, str] = {}
    begin = time.process_time()
    for pose in part.poses:
        if pose.rolling or pose.marginal or pose.probability < LIKELY:
            continue
        for k, place in enumerate(PLACES):
            plans[f"pose {pose.index} place {k}"] = plan_digest(
                prepared, setup.layout, pose, place, numbers=numbers
            )
    return {
        "recipe": name,
        "prepared": digest(unworded(known) if numbers else known),
        "plans": plans,
        "prepare_cpu_s": prepare_s,
        "plan_cpu_s": time.process_time() - begin,
    }


def main() -> int:
    parser = Arguments(__doc__, recipes=["holder"])
    parser.add_argument("--recipes", nargs="*", default=list(RECIPES), metavar="NAME")
    parser.add_argument("--numbers", action="store_true", help="leave words out of the digests")
    args = parser.parse_args()
    rows = []
    for name in args.recipes:
        row = digests(name, numbers=args.numbers)
        plans = row.pop("plans")
        assert isinstance(plans, dict)
        rows.append(row | plans)
        note(row)
    show(args, rows, {"plans": sum(key.startswith("pose") for row in rows for key in row)})
    return 0


if __name__ == "__main__":
    sys.exit(main())
