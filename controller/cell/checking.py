"""Whether a recipe can be run in a cell: what follows from files alone, before anything moves.

`cellctl check` prints it; `cellctl run` asks the same before it starts anything.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from controller.cad import StablePose

from .planner_setup import PlannerSetup
from .plans import Certified, Planning
from .workers import Job, context

LIKELY = 0.03  # poses rarer than this are no reason to refuse a recipe


@dataclass(frozen=True, slots=True, eq=False)
class CheckedPose:
    """A stable pose that parts are likely to lie in, and what can be promised of it."""

    pose: StablePose
    certified: Certified


@dataclass(frozen=True, slots=True, eq=False)
class Checked:
    """What a recipe comes to in a cell.

    Attributes
    ----------
    problems : why it cannot be run, a sentence each; none where it can
    """

    setup: PlannerSetup
    poses: tuple[CheckedPose, ...]
    problems: tuple[str, ...]


def check_job(job: Job, progress: Callable[[str], None] | None = None) -> Checked:
    """Check files, CAD, and whether the part can be taken and shown from every likely pose.

    Parameters
    ----------
    progress : called with what is being done, before it is done

    Raises
    ------
    ConfigError, CadError : a file is wrong
    """
    c = context(job)
    planning = Planning(c.part, c.layout, c.setup.options)
    wanted = c.recipe.inspection.min_coverage
    poses, problems = [], []
    for pose in c.poses:
        if pose.rolling or pose.marginal or pose.probability < LIKELY:
            continue
        if progress is not None:
            progress(f"planning from pose {pose.index} ({pose.probability:.0%})")
        certified = planning.certified(pose)
        poses.append(CheckedPose(pose, certified))
        plan, lying = certified.told.plan, f"lying in pose {pose.index}"
        if plan is None:
            problems.append(f"{lying} ({pose.probability:.0%}): {certified.told.reason}")
        elif plan.covered_fraction < wanted:
            problems.append(
                f"{lying}: {plan.covered_fraction:.1%} of the surface can be shown, the recipe "
                f"requires {wanted:.1%}"
            )
    if not poses:
        problems.append("there is no pose in which the part is likely to lie still")
    return Checked(c.setup, tuple(poses), tuple(problems))
