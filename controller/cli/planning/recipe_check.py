"""`cellctl check`: everything that follows from files alone; nothing moves."""

import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, Literal

from controller.cad import StablePose
from controller.cell.batch import jobs_of
from controller.cell.compute import Job
from controller.cell.compute.checks import Checked, CheckedPose, Forecast, check_every_pose
from controller.results.moments import view_count

from ..inputs.recipes import AskedRecipe, cell_of, ordered_recipes
from ..terminal.output import emit, print_line, warn
from .certificates import counted, covered_words
from .characteristics import characteristic_json, print_checked
from .plan_json import certificate_json

MAX_REASON: Final = 200  # longest reason in a recipe [characters]


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
    checked = check_every_pose(job)
    problems = [*checked.problems, *_unserved(checked)]
    if as_json:
        emit(
            {
                "recipe": str(recipe_path),
                "ok": not problems,
                "problems": problems,
                "served_fraction": checked.served_fraction,
                "landings": [_landing_json(one) for one in _landings(checked)],
                "unseen_faces": [
                    {"face": face, "name": f"F{face}", "reason": reason}
                    for face, reason in checked.unseen_faces.items()
                ],
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
        return 1 if problems else 0
    _print(recipe_path, checked, problems)
    return 1 if problems else 0


@dataclass(frozen=True, slots=True)
class Landing:
    """A stable pose, and the fate of a part that lands in it."""

    pose: StablePose
    outcome: Literal["planned", "no plan", "planned when met"]
    words: str


def _landings(checked: Checked) -> list[Landing]:
    """Return every stable pose, likeliest first."""
    found = [_landing(one) for one in checked.poses]
    found += [
        Landing(pose, "planned when met", "rare; planned when a part rests that way")
        for pose in checked.met_later
    ]
    return sorted(found, key=lambda one: one.pose.index)


def _landing(one: CheckedPose) -> Landing:
    plan, entry = one.certified.certificate.plan, _pose_json(one)
    remarks = "".join(f"{remark}; " for remark in one.remarks)
    if plan is None:
        reason = one.certified.certificate.reason
        return Landing(one.pose, "no plan", f"{remarks}no plan: {reason}")
    words = (
        f"{counted(entry['views'], 'view')}, {counted(entry['regrips'], 'regrasp')}, "
        f"{covered_words(plan)} of the surface in sight, {entry['forecast_s']:.0f} s"
    )
    return Landing(one.pose, "planned", f"{remarks}{words}")


def _landing_json(one: Landing) -> dict[str, Any]:
    pose = one.pose
    return {
        "pose_index": pose.index,
        "probability": pose.probability,
        "drop_probability": pose.drop_probability,
        "rolling": pose.rolling,
        "marginal": pose.marginal,
        "outcome": one.outcome,
        "words": one.words,
    }


def _unserved(checked: Checked) -> list[str]:
    """Return the refusal of a part that mostly lands in poses without a plan."""
    if checked.problems or checked.serves_most:
        return []
    served = ", ".join(f"pose {one.pose.index}" for one in checked.poses if one.is_served)
    return [
        f"{checked.served_fraction:.0%} of dropped parts rest in a pose with a plan; feed "
        f"the part so that it rests in {served}, or remove the obstacle to the other plans. "
        "A run would start, and wait whenever a part rests in another pose"
    ]


def _print(recipe_path: Path, checked: Checked, problems: Sequence[str]) -> None:
    print_line(checked.setup.sentence)
    for one in _landings(checked):
        print_line(f"pose {one.pose.index} ({one.pose.probability:.0%}): {one.words}")
    for pose in checked.poses:
        if pose.forecast is not None:
            _print_forecast(pose, pose.forecast)
    print_checked(checked.characteristics)
    if checked.unseen_faces:
        faces = ", ".join(f"F{face}" for face in checked.unseen_faces)
        print_line(
            f"hardly in sight in any plan: {faces}. To pass parts without a comparison of "
            f"{faces}, add to the recipe:"
        )
        print_line("inspection:\n  not_inspected:")
        for face, reason in checked.unseen_faces.items():
            print_line(f"    F{face}: {json.dumps(reason[:MAX_REASON], ensure_ascii=False)}")
    warn_of(recipe_path, problems)
    served = f"{checked.served_fraction:.0%} of landings"
    if problems:
        print_line(f"{recipe_path}: not ready ({served} served)")
    else:
        print_line(
            f"{recipe_path}: ready for {served} (the pictures decide how much can be compared)"
        )


def _print_forecast(pose: CheckedPose, forecast: Forecast) -> None:
    """Print what will be compared of a good part, and the faces that will fall short."""
    print_line(
        f"forecast from pose {pose.pose.index}: {forecast.compared_fraction:.1%} of the surface "
        f"compared, of {forecast.in_sight_fraction:.1%} in sight"
    )
    short = forecast.short_faces
    if not short:
        return
    print_line(f"{counted(len(short), 'face')} will keep a good part from a PASS:")
    for face in short:
        print_line(
            f"    {face.label}, {face.area_mm2:.0f} mm2, {face.compared_fraction:.0%} compared: "
            f"{face.reason}"
        )


def warn_of(recipe_path: Path, problems: Sequence[str]) -> None:
    """Print why a recipe cannot be run."""
    for problem in problems:
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
        "forecast": None if checked.forecast is None else asdict(checked.forecast),
    }
