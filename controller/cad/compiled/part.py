"""The compiled part: all that follows from a part alone; `_cache` keeps it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from controller.arrays import IntArray
from controller.config import STEP_FORMATS, split_cad
from messages import key, say, say_counted

from ..boundary import euler_defect, face_genera
from ..large import drop_derived
from ..reading import load_solid
from ..reading.units import check_unit
from ..resting import (
    MAX_COMPARED,
    LookAlike,
    PartSymmetry,
    Resting,
    StablePose,
    find_resting,
    name_duplicates,
    part_symmetries,
    search_look_alikes,
)
from ..solid import Solid
from ..stages import OnStage, no_stage
from ..surfaces import (
    SAMPLE_SHARE,
    SurfaceSamples,
    count_caution,
    counted_samples,
    sample_surface,
)
from ..surfaces.features import Feature, find_features
from ..surfaces.tolerances import Tolerance
from ..views import LineView, line_view, prepare_views

UNITLESS = (".stl", ".obj", ".ply", ".off")  # formats that have no place for a unit
MAX_SAMPLES = 200_000
MAX_DRAWN_TRIANGLES = 50_000_000  # in the drawings of all poses: 41 of 1.2 million triangles
USUAL_DEFECT_MM = 3.0
CHOICE_SPACING_MM = 4.0  # spacing of the samples by which views are chosen
MAX_NAMED = 4  # poses named one by one in a remark
USUAL_DENSITY_G_CM3 = 2.7  # aluminium, the default of recipes


@dataclass(frozen=True, slots=True)
class CompileOptions:
    """Options with which a part is compiled.

    Density is not an option: the stable poses depend on its ratios only, and each part has a single
    density.

    Attributes
    ----------
    unit : unit of a file that does not say its own; None where nobody has said
    sample_spacing_mm : no spot of a surface is farther than this from a sample; a large part's are
        farther apart
    max_compared : pairs of poses that are compared at most, to state which look alike
    max_drawn_triangles : triangles in the drawings of all stable poses; rarer poses are left out
    """

    unit: str | None = None
    sample_spacing_mm: float = USUAL_DEFECT_MM * SAMPLE_SHARE
    max_compared: int = MAX_COMPARED
    max_drawn_triangles: int = MAX_DRAWN_TRIANGLES

    @property
    def smallest_defect_mm(self) -> float:
        """The smallest defect for which samples are made."""
        return self.sample_spacing_mm / SAMPLE_SHARE


def part_name(path: Path) -> str:
    """Return a part's name, from its file or from the name of its body in that file."""
    return split_cad(path).part_name


def options_among(path: Path, unit: str | None) -> CompileOptions:
    """Return the options for one of several files; a unit is only for those that name none."""
    return CompileOptions(unit=unit if split_cad(path).ending in UNITLESS else None)


def spacing_for(smallest_defect_mm: float) -> float:
    """Return the sample spacing for a smallest defect [mm]."""
    return SAMPLE_SHARE * smallest_defect_mm


@dataclass(frozen=True, eq=False, slots=True)
class CompiledPart:
    """A part and all that follows from it.

    Attributes
    ----------
    solid : the part
    resting : its stable poses
    symmetry : the turns that leave it as it is
    views : views of each pose of ``poses``, seen straight from above
    look_alikes : pairs of poses that look the same from above
    samples : points on its surfaces, by which coverage is counted; views are chosen by others
    smallest_defect_mm : smallest defect that samples were drawn for; a large part's samples may
        miss it
    features : holes, slots, keyways, pockets, openings, bosses, chamfers, fillets
    tolerances : tolerances that the file states as data, not only as drawn text
    warnings : sentences on what could not be read from the file or computed for the part
    """

    solid: Solid
    resting: Resting
    symmetry: PartSymmetry
    views: tuple[LineView, ...]
    look_alikes: tuple[LookAlike, ...]
    samples: SurfaceSamples
    smallest_defect_mm: float
    features: tuple[Feature, ...]
    tolerances: tuple[Tolerance, ...]
    warnings: tuple[str, ...]

    @property
    def poses(self) -> tuple[StablePose, ...]:
        """The stable poses, likeliest first."""
        return self.resting.poses

    @property
    def chosen_by(self) -> SurfaceSamples:
        """The samples for choosing views: fewer, and separate from those that count coverage."""
        return sample_surface(self.solid, spacing_of(self.solid, CHOICE_SPACING_MM))

    @property
    def sample_counts(self) -> IntArray:
        """Number of samples on each surface, (f,)."""
        counts = np.bincount(self.samples.face_ids, minlength=len(self.solid.faces))
        return np.asarray(counts, dtype=np.int64)

    @property
    def euler_defect(self) -> int:
        """Shortfall of the Euler-Poincare formula, 0 for a valid boundary."""
        solid = self.solid
        genera = face_genera(solid.mesh, solid.face_of_triangle, len(solid.faces))
        return euler_defect(solid.boundary, genera)

    @property
    def cautions(self) -> tuple[str, ...]:
        """Cautions for the reader, one sentence each."""
        found = list(self.warnings)
        if not self.solid.unit_is_declared:
            found.append(
                say(
                    "The file names no unit; its lengths are taken as {unit}. Declare "
                    "the unit with --unit, or in the recipe with unit:",
                    unit=self.solid.unit,
                )
            )
        counted = count_caution(self.samples, self.smallest_defect_mm)
        if counted:
            found.append(say("{counted}.", counted=counted))
        if self.euler_defect:
            found.append(
                say(
                    "Surfaces and edges do not add up (Euler: {euler_defect:+d}).",
                    euler_defect=self.euler_defect,
                )
            )
        if not any(not pose.rolling for pose in self.poses):
            found.append(key("The part rolls in every pose; it cannot be picked at rest."))
        return tuple(found)

    def density_g_cm3(self, asked: float | None = None) -> float:
        """Return the density required, else the file's, else aluminium's."""
        return asked or self.solid.density_g_cm3 or USUAL_DENSITY_G_CM3

    def remarks(self, pose: StablePose) -> tuple[str, ...]:
        """Return further remarks on a pose, in words."""
        found = []
        for family in self.resting.families:
            if family.pose == pose.index:
                turn = (
                    "all round"
                    if family.arc_rad >= 2 * np.pi - 1e-6
                    else (say("over {degrees:.0f} deg", degrees=np.degrees(family.arc_rad)))
                )
                shape = {"other": "a curve"}.get(family.kind, f"a {family.kind}")
                found.append(
                    say(
                        "rolls {turn} on {shape} of {downs_count} strips",
                        turn=turn,
                        shape=shape,
                        downs_count=len(family.downs),
                    )
                )
        if not pose.is_distinct:
            found.append(
                say("the same as pose {same_as} by a symmetry of the part", same_as=pose.same_as)
            )
        for evidence, what in (("edges", "outline and edges"), ("outline", "outline")):
            others = [
                pair.other if pose.index == pair.pose else pair.pose
                for pair in self.look_alikes
                if pair.evidence == evidence and pose.index in (pair.pose, pair.other)
            ]
            if others:
                found.append(
                    say_counted(
                        "{what} as of pose {few}",
                        "{what} as of poses {few}",
                        count=len(others),
                        what=what,
                        few=_few(others),
                    )
                )
        return tuple(found)


def _few(poses: Sequence[int]) -> str:
    """Return the first few of some poses in words, and the number of the rest."""
    ids = [str(pose) for pose in sorted(poses)]
    if len(ids) <= MAX_NAMED + 1:  # "and 1 more" is no shorter
        return ", ".join(ids)
    return say("{ids} and {more} more", ids=", ".join(ids[:MAX_NAMED]), more=len(ids) - MAX_NAMED)


def compile_part(
    path: Path, options: CompileOptions | None = None, on_stage: OnStage = no_stage
) -> CompiledPart:
    """Read a CAD file and return all that follows from it.

    Parameters
    ----------
    path : CAD file
    options : compile options; None for the defaults
    on_stage : callback, called with the name of each stage as it begins

    Raises
    ------
    CadError : as in `load_solid`
    """
    options = options or CompileOptions()
    solid, tolerances, warnings = _read(path, options.unit, on_stage)
    return compile_solid(solid, options, tolerances, warnings, on_stage)


def compile_solid(
    solid: Solid,
    options: CompileOptions | None = None,
    tolerances: tuple[Tolerance, ...] = (),
    warnings: tuple[str, ...] = (),
    on_stage: OnStage = no_stage,
) -> CompiledPart:
    """Return all that follows from a solid.

    Parameters
    ----------
    solid : checked, as `load_solid` returns it
    options : compile options; None for the defaults
    tolerances, warnings : statements of its file beside the solid
    on_stage : callback, called with the name of each stage as it begins
    """
    options = options or CompileOptions()
    if not solid.faces_are_complete:
        warnings += (
            key(
                "Which surfaces are cylinders, cones, spheres and tori is not worked out to "
                "the end: some of them may count as free-form."
            ),
        )
    on_stage(key("finding symmetries"))
    symmetry = part_symmetries(solid)
    drop_derived(solid.mesh)
    on_stage(key("finding stable poses"))
    found = find_resting(solid)
    drop_derived(solid.mesh)
    pose_count = len(found.poses)
    found = _likeliest(found, max(1, options.max_drawn_triangles // len(solid.mesh.faces)))
    if len(found.poses) < pose_count:
        share = 100 * sum(pose.probability for pose in found.poses)
        warnings += (
            say(
                "Of {pose_count} stable poses the {poses_count} likeliest are "
                "worked out, {share:.0f} % of all; a part in another one is not "
                "recognised.",
                pose_count=pose_count,
                poses_count=len(found.poses),
                share=share,
            ),
        )
    resting = replace(found, poses=name_duplicates(found.poses, symmetry))
    views = _views(solid, resting.poses, on_stage)
    on_stage(key("comparing stable poses"))
    alike = search_look_alikes(solid, resting.poses, views, max_compared=options.max_compared)
    drop_derived(solid.mesh)
    if alike.pose_count < len(resting.poses):
        warnings += (
            say(
                "Which stable poses look alike is not worked out beyond the "
                "{pose_count} likeliest of {poses_count}: a rarer one may be taken "
                "for another.",
                pose_count=alike.pose_count,
                poses_count=len(resting.poses),
            ),
        )
    on_stage(key("sampling surfaces, finding features"))
    return CompiledPart(
        solid=solid,
        resting=resting,
        symmetry=symmetry,
        views=views,
        look_alikes=alike.pairs,
        samples=counted_samples(solid, options.sample_spacing_mm),
        smallest_defect_mm=options.smallest_defect_mm,
        features=find_features(solid),
        tolerances=tolerances,
        warnings=warnings,
    )


def spacing_of(solid: Solid, asked_mm: float) -> float:
    """Return the spacing of samples; on a very large part it grows to limit their number."""
    return max(asked_mm, float(np.sqrt(solid.mesh.area / MAX_SAMPLES)))


def _views(solid: Solid, poses: Sequence[StablePose], on_stage: OnStage) -> tuple[LineView, ...]:
    on_stage(key("finding edges"))
    prepared = prepare_views(solid)
    views = []
    for number, pose in enumerate(poses, 1):
        on_stage(
            say(
                "drawing stable pose {number} of {poses_count}",
                number=number,
                poses_count=len(poses),
            )
        )
        views.append(line_view(solid, pose.R, prepared=prepared))
    del prepared
    drop_derived(solid.mesh)
    return tuple(views)


def _likeliest(resting: Resting, count: int) -> Resting:
    """Return the ``count`` likeliest poses with their families and facets."""
    if len(resting.poses) <= count:
        return resting
    return replace(
        resting,
        poses=resting.poses[:count],
        families=tuple(family for family in resting.families if family.pose < count),
        facet_pose=np.where(resting.facet_pose < count, resting.facet_pose, -1).astype(np.int32),
    )


def _read(
    path: Path, unit: str | None, on_stage: OnStage
) -> tuple[Solid, tuple[Tolerance, ...], tuple[str, ...]]:
    source = split_cad(path)
    if source.ending not in STEP_FORMATS:
        return load_solid(path, unit=unit, on_stage=on_stage), (), ()
    on_stage(key("reading the file"))
    from ..reading.step.files import (
        read_step_part,  # slow to import, and only needed here
    )

    found = read_step_part(source.file, body=source.body)
    check_unit(unit, found.solid.unit, path)
    return found.solid, found.tolerances, found.warnings
