"""`cellctl check`: what follows from files alone; nothing moves."""

import time
from pathlib import Path
from typing import Any

from controller.cell.compute import Job
from controller.cell.compute.checks import Checked, CheckedPose, check_job
from controller.config import load_recipe
from controller.results.moments import view_count

from ..terminal.output import emit, print_line, warn
from .certificates import counted, covered_words
from .characteristics import characteristic_json, print_checked
from .plan_json import certificate_json


def check_recipe(recipe_path: Path, cell_path: Path | None, *, as_json: bool) -> int:
    """Check files and CAD, and that every likely stable pose can be grasped and shown.

    Parameters
    ----------
    recipe_path : recipe file
    cell_path : cell file, None for the recipe's
    as_json : print one JSON object instead of sentences

    Returns
    -------
    exit code: 0 if the recipe can be run on this cell; else 1, after printing each reason
    """
    started = time.monotonic()
    recipe = load_recipe(recipe_path)
    checked = check_job(Job(recipe_path, cell_path or recipe.cell))
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
