"""Check from files alone whether a recipe can be run in a cell.

`cellctl check` prints the result. `cellctl run` makes the same checks before anything moves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from controller.cad import Solid, StablePose, load_solid
from controller.cad.compiled import (
    UNITLESS,
    CompiledPart,
    CompileOptions,
    cached_part,
    load_part,
)
from controller.config import (
    Cell,
    ConfigError,
    Recipe,
    line_in,
    load_cell,
    load_recipe,
    split_cad,
)
from controller.planning import Plan
from controller.setup.drivers import require_drivers, require_force
from controller.setup.faces import faces_left_out
from controller.setup.planner import PlannerSetup
from messages import joined, key, say

from ...plans import Certified, PlanCache
from .. import Job, context, part_files
from .characteristics import CheckedCharacteristic, check_characteristics
from .defects import check_defects
from .forecast import Forecast, forecast

# A stable pose less probable than this is no reason to refuse a recipe.
LIKELY = 0.03
# Share of a face in sight up to which `check` foretells that it can hardly be compared.
HARDLY = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class CheckedPose:
    """A stable pose, with its plan or the reason why there is none.

    Attributes
    ----------
    remarks : further remarks in words: it rolls, it is barely stable
    forecast : what a run by its plan will have compared; None where none was asked for
    """

    pose: StablePose
    certified: Certified
    remarks: tuple[str, ...] = ()
    forecast: Forecast | None = None

    @property
    def is_served(self) -> bool:
        """True if there is a plan."""
        return self.certified.certificate.plan is not None


@dataclass(frozen=True, slots=True, eq=False)
class Checked:
    """Whether a recipe can be run in a cell.

    Attributes
    ----------
    poses : poses planned ahead
    problems : one sentence for each reason why it cannot; empty if it can
    characteristics : characteristics to measure on the part, and the capability of this cell
    met_later : stable poses that are planned when a part comes to lie so
    unseen_faces : faces that come next to not in sight in any plan, by id, with the reason; those
        that the recipe leaves out are not among them
    """

    setup: PlannerSetup
    poses: tuple[CheckedPose, ...]
    problems: tuple[str, ...]
    characteristics: tuple[CheckedCharacteristic, ...] = ()
    met_later: tuple[StablePose, ...] = ()
    unseen_faces: Mapping[int, str] = field(default_factory=dict)

    @property
    def served_fraction(self) -> float:
        """Share of landings, by the poses' quasi-static probabilities, that have a plan."""
        return sum(one.pose.probability for one in self.poses if one.is_served)

    @property
    def serves_most(self) -> bool:
        """True if most dropped parts rest in poses with a plan."""
        return self.served_fraction > 0.5


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
    """Check files, CAD and a plan for every likely, steady pose; return plans and problems.

    Raises
    ------
    ConfigError, CadError : a file is wrong
    """
    _check_files(job)
    return check_plans(job)


def _check_files(job: Job) -> None:
    cell = load_cell(job.cell_path)
    require_drivers(job.cell_path, cell)
    recipe = load_recipe(job.recipe_path)
    check_sizes(job.recipe_path, recipe, cell)
    require_force(job.recipe_path, recipe.grasp.force_n, cell)


def check_every_pose(job: Job) -> Checked:
    """Return the result of `check_job` with unsteady poses (rolling, barely standing) planned, too.

    A run computes these only when a part rests that way; a check of a recipe should report their
    cost. What will be compared is forecast from the likeliest pose that has a plan.

    Raises
    ------
    ConfigError, CadError : a file is wrong
    """
    _check_files(job)
    checked = check_plans(job, has_unsteady=True)
    poses = list(checked.poses)
    planned = [k for k, one in enumerate(poses) if one.certified.certificate.plan is not None]
    if planned:
        k = max(planned, key=lambda k: poses[k].pose.probability)
        plan = poses[k].certified.certificate.plan
        assert plan is not None
        poses[k] = replace(poses[k], forecast=forecast(context(job), plan))
    return replace(checked, poses=tuple(poses))


def check_plans(
    job: Job, progress: Callable[[str], None] | None = None, *, has_unsteady: bool = False
) -> Checked:
    """Plan every likely stable pose, the files checked before; return plans and problems.

    Parameters
    ----------
    job : recipe and cell
    progress : called before each step with what it does
    has_unsteady : plan likely poses in which the part rolls or barely stands as well; that one of
        these has no plan is no problem of the recipe, unless the part has no others

    Raises
    ------
    ConfigError, CadError : a file is wrong
    """
    c = context(job)
    planning = PlanCache(c.part, c.layout, c.setup.options)
    measured, too_tight = check_characteristics(job.recipe_path, c.recipe, c.cell, c.part)
    poses, problems = [], [*too_tight, *check_defects(c.recipe, c.cell)]
    likely = [pose for pose in c.poses if pose.probability >= LIKELY]
    steady = [pose for pose in likely if not (pose.rolling or pose.marginal)]
    # a part that rests in no steady pose is run from where it lies still
    chosen = likely if has_unsteady or not steady else steady
    for pose in chosen:
        if progress is not None:
            progress(
                say(
                    "planning from pose {index} ({probability:.0%})",
                    index=pose.index,
                    probability=pose.probability,
                )
            )
        certified = planning.certified(pose)
        plan, where = certified.certificate.plan, say("in stable pose {index}", index=pose.index)
        poses.append(CheckedPose(pose, certified, _remarks(pose, c.part)))
        if plan is None and (pose in steady or not steady):
            problems.append(
                say(
                    "{where} ({probability:.0%}): {reason}",
                    where=where,
                    probability=pose.probability,
                    reason=certified.certificate.reason,
                )
            )
    later = [pose for pose in c.poses if pose not in chosen]
    if not likely:
        problems.append(_restless(c.poses, c.part))
    plans = [one.certified.certificate.plan for one in poses]
    hidden = _unseen_by_all([plan for plan in plans if plan is not None], c.part.solid)
    for face in faces_left_out(job.recipe_path, c.recipe, c.part.solid.faces, c.part.features):
        hidden.pop(face, None)
    return Checked(c.setup, tuple(poses), tuple(problems), measured, tuple(later), hidden)


def _restless(poses: Sequence[StablePose], part: CompiledPart) -> str:
    """Return the sentence on a part without a stable pose, with its likeliest motion."""
    where = key("the part has no stable pose in which it is likely to rest")
    if not poses:
        return where
    does = joined("; ", _remarks(poses[0], part)) or key("it is rare")
    return say(
        "{where}: in pose {index} ({probability:.0%}) {does}",
        where=where,
        index=poses[0].index,
        probability=poses[0].probability,
        does=does,
    )


def _remarks(pose: StablePose, part: CompiledPart) -> tuple[str, ...]:
    return (*([key("barely stable")] if pose.marginal else []), *part.remarks(pose))


def _unseen_by_all(plans: Sequence[Plan], solid: Solid) -> dict[int, str]:
    """Return the faces that no plan covers by more than `HARDLY`, each with the reason."""
    total_mm2 = sum(face.area_mm2 for face in solid.faces)
    found: list[dict[int, str]] = []
    for plan in plans:
        unseen: dict[int, float] = {}
        reasons: dict[int, str] = {}
        for piece in sorted(plan.unseen, key=lambda piece: -piece.area_fraction):
            unseen[piece.face_id] = unseen.get(piece.face_id, 0.0) + piece.area_fraction
            reasons.setdefault(piece.face_id, piece.reason)
        shares = {face: solid.faces[face].area_mm2 / total_mm2 for face in unseen}
        hidden = [f for f, lost in unseen.items() if lost >= (1 - HARDLY) * shares[f]]
        found.append({face: reasons[face] for face in hidden})
    always = set.intersection(*map(set, found)) if found else set()
    return {face: found[0][face] for face in sorted(always)}
