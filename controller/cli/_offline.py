"""`cellctl check`: what follows from files alone; nothing moves."""

import time
from pathlib import Path
from typing import Any

from controller.cell.workers import Job, context
from controller.cell.workers import plan as plan_job
from controller.cell.workers import prepare as prepare_job
from controller.config import load_recipe
from controller.planning import NoPlanError
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
