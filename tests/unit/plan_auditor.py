"""Audits a plan by the JSON of `cellctl plan --json` alone: an example of a program that reads it.

It knows docs/planning.md, "For programs", and nothing of the controller. `audit` returns one
sentence for each thing that contradicts the plan's own words.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

# (gripper, action) that changes where the part is, and from where to where
CHANGES = {
    ("arm", "close"): {"on_table": {"in_arm"}, "in_fixture": {"in_both"}},
    ("arm", "open"): {"in_both": {"in_fixture"}, "in_arm": {"on_table", "placed"}},
    ("fixture", "close"): {"in_arm": {"in_both"}},
    ("fixture", "open"): {"in_both": {"in_arm"}},
}
# where the part is while the arm may move
MOVABLE = {"on_table", "in_arm", "in_fixture", "placed"}
SMALL = 1e-6
# pieces of a face below this share of the surface are not listed as unseen, one for each kind
LEFT_OUT, KIND_COUNT = 0.0002, 6


def audit(plan: dict[str, Any]) -> list[str]:
    """Return what is wrong with a plan; empty if nothing is."""
    return [*joints(plan), *custody(plan), *poses(plan), *sight(plan), *seconds(plan)]


def chains(plan: dict[str, Any]) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yield the steps from the start to each tray, by tray."""
    common = [s for s in plan["steps"] if s["kind"] not in {"place", "park"}]
    for tray, end in plan["trays"].items():
        yield tray, common + end


def joints(plan: dict[str, Any]) -> Iterator[str]:
    """Check limits and speeds of every waypoint on the way to every tray."""
    full = np.array([j["full_speed"] for j in plan["arm"]["joints"]])
    for tray, steps in chains(plan):
        q = np.array(plan["arm"]["start_q"])
        for step in steps:
            for action in step["actions"]:
                for point in action.get("waypoints", ()):
                    to, speeds = np.array(point["q"]), np.array(point["speeds"])
                    where = f"to {tray}, {step['label']}, {action['path']}"
                    for limit in plan["arm"]["limits"]:
                        value = float(np.dot(limit["weights"], to))
                        if not limit["low"] <= value <= limit["high"]:
                            yield f"{where}: {limit['name']} is at {value:.3f}"
                    if (speeds > full * (1 + SMALL)).any():
                        yield f"{where}: faster than the arm"
                    # all joints arrive together
                    if not np.allclose(speeds * travel_s(to - q, speeds), np.abs(to - q)):
                        yield f"{where}: speeds do not lead from waypoint to waypoint"
                    if travel_s(to - q, speeds) > point["seconds"] + SMALL:
                        yield f"{where}: sooner there than its speeds allow"
                    q = to


def travel_s(step: Any, speeds: Any) -> float:
    """Return how long the joint with the longest travel is under way at its speed."""
    longest = int(np.argmax(speeds))
    return float(abs(step[longest]) / speeds[longest]) if speeds[longest] > 0 else 0.0


def custody(plan: dict[str, Any]) -> Iterator[str]:
    """Check that nothing but jaws changes where the part is, and that it ends in each tray."""
    for tray, steps in chains(plan):
        now = "on_table"
        for step in steps:
            where = f"to {tray}, {step['label']}"
            if step["custody"]["before"] != now:
                yield f"{where}: begins {step['custody']['before']}, the part is {now}"
            for action in step["actions"]:
                after = action["custody"]
                allowed = CHANGES.get((action.get("gripper"), action["action"]), {})
                if after != now and after not in allowed.get(now, set()):
                    yield f"{where}: {action['action']} makes {after} of {now}"
                if action["action"] == "move" and now not in MOVABLE:
                    yield f"{where}: the arm moves while the part is {now}"
                if action["action"] in {"open", "close"}:
                    gripper = plan["grippers"][action["gripper"]]
                    if not 0 <= action["opening_mm"] <= gripper["max_opening_mm"] + SMALL:
                        yield f"{where}: {action['gripper']} at {action['opening_mm']:.1f} mm"
                now = after
            if step["custody"]["after"] != now:
                yield f"{where}: ends {step['custody']['after']}, the part is {now}"
        if now != "placed":
            yield f"to {tray}: ends {now}"


def poses(plan: dict[str, Any]) -> Iterator[str]:
    """Check that a gripper's grasp carries the part to where each step has it."""
    grasps = {g["id"]: g for g in plan["grasps"]}
    for step in plan["steps"]:
        if step["grip"] is None:
            continue
        T = np.array(step["T_world_tcp"]) @ np.linalg.inv(grasps[step["grip"]]["T_part_tcp"])
        if not np.allclose(T, step["T_world_part"], atol=1e-3):
            yield f"{step['label']}: the grasp has the part elsewhere"
        ends = [p["q"] for a in step["actions"] for p in a.get("waypoints", ())]
        if step["q"] not in ends:
            yield f"{step['label']}: its moment is at no waypoint"


def sight(plan: dict[str, Any]) -> Iterator[str]:
    """Check that masks of the views add up to the coverage that is stated."""
    samples = plan["samples"]
    areas = np.array(samples["areas_mm2"])
    weights = areas / areas.sum()
    seen = np.zeros(len(areas), dtype=bool)
    if len(samples["points_mm"]) != len(areas) or len(samples["faces"]) != len(areas):
        yield "samples of different numbers"
    for face in sorted({str(f) for f in samples["faces"]} - samples["face_labels"].keys()):
        yield f"face {face} has no label"
    for step in plan["steps"]:
        if (step["view_id"] is None) != ("samples" not in step):
            yield f"{step['label']}: a view without samples, or samples without a view"
        mask = np.zeros(len(areas), dtype=bool)
        mask[step.get("samples", [])] = True
        new = float(weights[mask & ~seen].sum())
        if abs(new - step.get("new_fraction", 0.0)) > SMALL:
            yield f"{step['label']}: shows {new:.4f} for the first time, not what it states"
        seen |= mask
    covered = float(weights[seen].sum())
    if abs(covered - plan["covered_fraction"]) > SMALL:
        yield f"views show {covered:.4f}, stated are {plan['covered_fraction']:.4f}"
    unseen = np.zeros(len(areas), dtype=bool)
    for piece in plan["unseen"]:
        unseen[piece["samples"]] = True
        if {samples["faces"][s] for s in piece["samples"]} - {piece["face"]}:
            yield f"{piece['label']}: unseen samples of another face"
    if (seen & unseen).any():
        yield "samples both seen and unseen"
    left = ~seen & ~unseen
    for face in np.unique(np.array(samples["faces"])[left]):
        share = float(weights[left & (np.array(samples["faces"]) == face)].sum())
        if share > LEFT_OUT * KIND_COUNT:
            yield f"face {face}: {share:.4f} neither seen nor listed"


def seconds(plan: dict[str, Any]) -> Iterator[str]:
    """Check that the forecast is that of the steps, and no step shorter than its motions."""
    total = sum(step["seconds"] for step in plan["steps"])
    if abs(total - plan["forecast_s"]) > 1e-3:
        yield f"steps take {total:.2f} s, forecast are {plan['forecast_s']:.2f} s"
    for step in plan["steps"]:
        moving = sum(p["seconds"] for a in step["actions"] for p in a.get("waypoints", ()))
        if moving > step["seconds"] + SMALL:
            yield f"{step['label']}: motions of {moving:.2f} s in {step['seconds']:.2f} s"


if __name__ == "__main__":
    found = audit(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")))
    sys.stdout.write("\n".join(found or ["nothing is wrong with it"]) + "\n")
    sys.exit(1 if found else 0)
