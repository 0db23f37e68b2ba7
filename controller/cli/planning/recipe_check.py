"""`cellctl check`: what follows from files alone; nothing moves."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from controller.cell.batch import jobs_of
from controller.cell.compute import Job
from controller.cell.compute.checks import Checked, CheckedPose, check_job
from controller.results.moments import view_count

from ..inputs.recipes import AskedRecipe, cell_of, ordered_recipes
from ..terminal.output import emit, print_line, warn
from .certificates import counted, covered_words
from .characteristics import characteristic_json, print_checked
from .plan_json import certificate_json


def check_recipes(asked: Sequence[AskedRecipe], cell_path: Path | None, *, as_json: bool) -> int:
    """Check files and CAD, and that every likely stable pose can be grasped and shown.

    Parameters
    ----------
    asked : the recipes; several are checked as for one run
    cell_path : cell file, None for the recipes'
    as_json : print one JSON object a recipe instead of sentences

    Returns
    -------
    exit code: 0 if the recipes can be run on this cell; else 1, after printing each reason

    Raises
    ------
    ConfigError : a file is wrong, or no run could have these recipes together
    """
    ordered = ordered_recipes(asked)
    jobs = jobs_of(ordered, cell_of(ordered, cell_path))
    return max([_check(job, as_json=as_json) for job in jobs])


def _check(job: Job, *, as_json: bool) -> int:
    started, recipe_path = time.monotonic(), job.recipe_path
    checked = check_job(job)
    if as_json:
        emit(
            {
                "recipe": str(recipe_path),
                "ok": not checked.problems,
                "problems": list(checked.problems),
                "planned_with": checked.setup.as_json(),
                "poses": [_pose_json(pose) for pose in checked.poses],
                "characteristics": [
                    characteristic_json(each.characteristic, each.capability)
                    for each in checked.characteristics
                ],
                "certificates": [
                    certificate_json(p.certified.certificate, checked.setup) for p in checked.poses
                ],
                "seconds": time.monotonic() - started,
            }
        )
        return 1 if checked.problems else 0
    _print(recipe_path, checked)
    return 1 if checked.problems else 0


def _print(recipe_path: Path, checked: Checked) -> None:
    print_line(checked.setup.sentence)
    for pose in checked.poses:
        entry, plan = _pose_json(pose), pose.certified.certificate.plan
        if plan is not None:
            print_line(
                f"pose {entry['pose_index']} ({entry['probability']:.0%}): "
                f"{counted(entry['views'], 'view')}, {counted(entry['regrips'], 'regrasp')}, "
                f"{covered_words(plan)} of the surface in sight, "
                f"{entry['forecast_s']:.0f} s"
            )
    print_checked(checked.characteristics)
    warn_of(recipe_path, checked)
    if checked.problems:
        print_line(f"{recipe_path}: not ready")
    else:
        print_line(f"{recipe_path}: ready (how much can be compared shows in the pictures)")


def warn_of(recipe_path: Path, checked: Checked) -> None:
    """Print why a recipe cannot be run."""
    for problem in checked.problems:
        warn(f"{recipe_path}: {problem}")


def _pose_json(checked: CheckedPose) -> dict[str, Any]:
    certificate, plan = checked.certified.certificate, checked.certified.certificate.plan
    entry: dict[str, Any] = {
        "pose_index": certificate.pose_index,
        "probability": certificate.probability,
    }
    if plan is None:
        return entry | {"planned": False, "reason": certificate.reason}
    return entry | {
        "planned": True,
        "views": view_count(plan),
        "regrips": plan.regrasp_count,
        "forecast_s": plan.forecast_s,
        "covered_fraction": plan.covered_fraction,
        "covered_U": plan.covered_U,
    }
