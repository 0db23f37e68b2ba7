"""`cellctl check` and `plan`: what follows from files alone; nothing moves."""

import time
from pathlib import Path
from typing import Any

import numpy as np

from controller.cad import Solid
from controller.cad.compiled import CompileOptions, load_part
from controller.cell.workers import Job, context
from controller.cell.workers import plan as plan_job
from controller.cell.workers import prepare as prepare_job
from controller.config import ConfigError, build_layout, load_cell, load_recipe
from controller.planning import NoPlanError, Plan, plan_part, prepare_part
from controller.recognition import lying

from ._output import emit, say, warn

LIKELY = 0.03  # poses rarer than this are told, but are no reason to refuse a recipe


def check_recipe(recipe_path: Path, cell_path: Path | None, *, as_json: bool) -> int:
    """Check files, CAD, and whether every likely pose can be taken and shown."""
    started = time.monotonic()
    recipe = load_recipe(recipe_path)
    cell_file = cell_path or recipe.cell
    job = Job(recipe_path, cell_file)
    c = context(job)
    prepare_job(job)
    area = c.cell.table.drop_area
    middle = (sum(area.x) / 2, sum(area.y) / 2)
    problems, poses = [], []
    for pose in c.poses:
        if pose.rolling or pose.marginal or pose.probability < LIKELY:
            continue
        T = lying(c.solid, pose, middle[0], middle[1], 0.3)
        entry: dict[str, Any] = {"pose_index": pose.index, "probability": pose.probability}
        try:
            plan = plan_job(job, pose.index, T)
        except NoPlanError as error:
            problems.append(f"lying in pose {pose.index} ({pose.probability:.0%}): {error}")
            entry |= {"planned": False, "reason": str(error)}
        else:
            entry |= {
                "planned": True,
                "views": len(plan.presents),
                "regrips": plan.regrip_count,
                "forecast_s": plan.forecast_s,
                "covered_fraction": plan.covered_fraction,
            }
            if plan.covered_fraction < recipe.inspection.min_coverage:
                problems.append(
                    f"lying in pose {pose.index}: {plan.covered_fraction:.1%} of the surface can "
                    f"be shown, the recipe asks for {recipe.inspection.min_coverage:.1%}"
                )
        poses.append(entry)
    if as_json:
        emit(
            {
                "recipe": str(recipe_path),
                "ok": not problems,
                "problems": problems,
                "poses": poses,
                "seconds": time.monotonic() - started,
            }
        )
        return 1 if problems else 0
    for entry in poses:
        if entry["planned"]:
            say(
                f"pose {entry['pose_index']} ({entry['probability']:.0%}): {entry['views']} views, "
                f"{entry['regrips']} re-grips, {entry['covered_fraction']:.1%} of the surface, "
                f"{entry['forecast_s']:.0f} s"
            )
    for problem in problems:
        warn(f"{recipe_path}: {problem}")
    say(f"{recipe_path}: {'not ready' if problems else 'ready'}")
    return 1 if problems else 0


def plan_part_file(
    part: Path,
    cell_path: Path,
    pose_index: int,
    at: str | None,
    *,
    unit: str | None,
    as_json: bool,
) -> int:
    """Plan one part at one place."""
    cell = load_cell(cell_path)
    layout = build_layout(cell)
    compiled = load_part(part, CompileOptions(unit=unit))
    solid, samples = compiled.solid, compiled.samples
    poses = {p.index: p for p in compiled.poses}
    if pose_index not in poses:
        raise ConfigError(f"--pose {pose_index}: {solid.name} has poses {sorted(poses)}")
    x_mm, y_mm, theta_deg = parse_place(at, cell.table.drop_area.x, cell.table.drop_area.y)
    pose = poses[pose_index]
    started = time.monotonic()
    prepared = prepare_part(solid, samples, layout)
    T = lying(solid, pose, x_mm, y_mm, np.radians(theta_deg))
    plan = plan_part(solid, samples, pose, T, layout, prepared=prepared)
    seconds = time.monotonic() - started
    if as_json:
        emit(_plan_json(solid, plan) | {"seconds": seconds})
        return 0
    for i, (label, step_s) in enumerate(plan.seconds_by_step, 1):
        say(f"{i:3}  {step_s:6.1f} s  {label}")
    say(
        f"forecast {plan.forecast_s:.0f} s; {plan.covered_fraction:.1%} of the surface seen, "
        f"{plan.reachable_fraction:.1%} could be"
    )
    for u in plan.unseen:
        say(f"  {solid.faces[u.face_id].label}: {u.area_fraction:.2%} unseen, {u.reason}")
    return 0


def parse_place(
    at: str | None, x: tuple[float, float], y: tuple[float, float]
) -> tuple[float, float, float]:
    """Return x, y [mm] and theta [deg] of ``X,Y,THETA``; the middle of the area otherwise.

    Raises
    ------
    ConfigError : not three numbers
    """
    if at is None:
        return sum(x) / 2, sum(y) / 2, 0.0
    try:
        numbers = [float(word) for word in at.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 3 or not np.isfinite(numbers).all():
        raise ConfigError(f"--at {at}: three numbers are asked, X,Y,THETA_DEG, as in 350,20,45")
    return numbers[0], numbers[1], numbers[2]


def _plan_json(solid: Solid, plan: Plan) -> dict[str, Any]:
    return {
        "part": solid.name,
        "steps": [{"label": label, "seconds": s} for label, s in plan.seconds_by_step],
        "forecast_s": plan.forecast_s,
        "covered_fraction": plan.covered_fraction,
        "reachable_fraction": plan.reachable_fraction,
        "regrips": plan.regrip_count,
        "views": [
            {"view": p.view_id, "direction_part": p.direction_part.tolist(), "q": p.q.tolist()}
            for p in plan.presents
        ],
        "unseen": [
            {"face": u.face_id, "area_fraction": u.area_fraction, "reason": u.reason}
            for u in plan.unseen
        ],
    }
