"""Check from files alone whether a recipe can be run in a cell.

`cellctl check` prints the result. `cellctl run` makes the same checks before anything moves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from controller.cad import Solid, StablePose, load_solid
from controller.cad.compiled import UNITLESS, CompileOptions, cached_part, load_part
from controller.config import (
    Cell,
    ConfigError,
    Recipe,
    line_in,
    load_cell,
    load_recipe,
    split_cad,
)
from controller.setup.drivers import require_drivers, require_force
from controller.setup.planner import PlannerSetup

from ...plans import Certified, PlanCache
from .. import Job, context, part_files
from .characteristics import CheckedCharacteristic, check_characteristics
from .defects import check_defects

# A stable pose less probable than this is no reason to refuse a recipe.
LIKELY = 0.03


@dataclass(frozen=True, slots=True, eq=False)
class CheckedPose:
    """A likely stable pose, with its plan or the reason why there is none."""

    pose: StablePose
    certified: Certified


@dataclass(frozen=True, slots=True, eq=False)
class Checked:
    """Whether a recipe can be run in a cell.

    Attributes
    ----------
    problems : one sentence for each reason why it cannot; empty if it can
    characteristics : what is measured of the part, and how well this cell can
    """

    setup: PlannerSetup
    poses: tuple[CheckedPose, ...]
    problems: tuple[str, ...]
    characteristics: tuple[CheckedCharacteristic, ...] = ()


def check_sizes(recipe_path: Path, recipe: Recipe, cell: Cell) -> None:
    """Check that each part fits on the table in any stable pose.

    This comes before parts are compiled, since a part in the wrong unit may have millions of
    samples.

    Parameters
    ----------
    recipe_path : recipe file, for the message
    recipe : its parts are read, and their meshes measured
    cell : its backlit area must have room for them

    Raises
    ------
    ConfigError : a part does not fit; the unit in the recipe may be wrong
    CadError : a CAD file is wrong
    """
    area = cell.table.glowing_area
    room_mm = sorted((area.x[1] - area.x[0], area.y[1] - area.y[0]))
    for path, options in part_files(recipe):
        solid = _solid(path, options)
        size_mm = sorted(solid.mesh.extents.tolist())
        if size_mm[0] <= room_mm[0] and size_mm[1] <= room_mm[1]:
            continue
        line = line_in(recipe_path, ("unit",))
        where = recipe_path if line is None else f"{recipe_path}:{line}"
        size = " x ".join(f"{side:.0f}" for side in reversed(size_mm))
        raise ConfigError(
            f"{where}: {solid.name} is {size} mm in `unit: {solid.unit}` and does not fit on the "
            f"table of {room_mm[1]:.0f} x {room_mm[0]:.0f} mm; is the unit right?"
        )


def _solid(path: Path, options: CompileOptions) -> Solid:
    """Return a part's solid; compile the part only if reading it alone would take as long."""
    kept = cached_part(path, options)
    if kept is not None:
        return kept.solid
    is_quick = split_cad(path).ending in UNITLESS
    return load_solid(path, unit=options.unit) if is_quick else load_part(path, options).solid


def check_job(job: Job) -> Checked:
    """Check files, CAD and a plan for every likely stable pose; return plans and problems.

    Raises
    ------
    ConfigError, CadError : a file is wrong
    """
    cell = load_cell(job.cell_path)
    require_drivers(job.cell_path, cell)
    recipe = load_recipe(job.recipe_path)
    check_sizes(job.recipe_path, recipe, cell)
    require_force(job.recipe_path, recipe.grasp.force_n, cell)
    return check_plans(job)


def check_plans(job: Job, progress: Callable[[str], None] | None = None) -> Checked:
    """Plan every likely stable pose, the files checked before; return plans and problems.

    Parameters
    ----------
    job : which recipe on which cell
    progress : called before each step with what it does

    Raises
    ------
    ConfigError, CadError : a file is wrong
    """
    c = context(job)
    planning = PlanCache(c.part, c.layout, c.setup.options)
    wanted = c.recipe.inspection.min_coverage
    measured, too_tight = check_characteristics(job.recipe_path, c.recipe, c.cell, c.part)
    poses, problems = [], [*too_tight, *check_defects(c.recipe, c.cell)]
    for pose in c.poses:
        if pose.rolling or pose.marginal or pose.probability < LIKELY:
            continue
        if progress is not None:
            progress(f"planning from pose {pose.index} ({pose.probability:.0%})")
        certified = planning.certified(pose)
        poses.append(CheckedPose(pose, certified))
        plan, where = certified.certificate.plan, f"in stable pose {pose.index}"
        if plan is None:
            problems.append(f"{where} ({pose.probability:.0%}): {certified.certificate.reason}")
        elif plan.covered_fraction < wanted:
            problems.append(
                f"{where}: {plan.covered_fraction:.1%} of the surface comes in sight, but the "
                f"recipe requires {wanted:.1%} to be compared (`min_coverage`); require less, or "
                "see in `cellctl plan --recipe` what hides the rest"
            )
    if not poses:
        problems.append("the part has no stable pose in which it is likely to rest")
    return Checked(c.setup, tuple(poses), tuple(problems), measured)
