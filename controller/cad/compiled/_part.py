"""What follows from a part alone: computed here, kept by `_cache`."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..boundary import euler_defect, face_genera
from ..reading import load_solid
from ..resting import Resting, StablePose, find_resting
from ..solid import Solid
from ..surfaces import SurfaceSamples, sample_surface
from ..views import LineView, line_view, prepare_views

USUAL_DENSITY_G_CM3 = 2.7  # aluminium, as in a recipe that does not say


@dataclass(frozen=True, slots=True)
class CompileOptions:
    """What a part is compiled with, beside its file.

    Density is none of them: the ways to lie depend on its ratios only, and a part is of one.

    Attributes
    ----------
    unit : of a file that does not say its own; None where nobody has said
    sample_spacing_mm, samples_per_face : how densely surfaces are sampled
    """

    unit: str | None = None
    sample_spacing_mm: float = 4.0
    samples_per_face: int = 6


@dataclass(frozen=True, eq=False, slots=True)
class CompiledPart:
    """A part and what follows from it.

    Attributes
    ----------
    solid : the part
    resting : the ways it can lie
    views : of each pose of ``poses``, seen straight from above
    samples : points on its surfaces, which coverage is counted by
    """

    solid: Solid
    resting: Resting
    views: tuple[LineView, ...]
    samples: SurfaceSamples

    @property
    def poses(self) -> tuple[StablePose, ...]:
        """The ways it can lie, likeliest first."""
        return self.resting.poses

    @property
    def sample_counts(self) -> NDArray[np.int64]:
        """How many samples each surface has, (f,)."""
        counts = np.bincount(self.samples.face_ids, minlength=len(self.solid.faces))
        return np.asarray(counts, dtype=np.int64)

    @property
    def euler_defect(self) -> int:
        """What Euler-Poincare is short of, 0 for a right boundary."""
        solid = self.solid
        genera = face_genera(solid.mesh, solid.face_of_triangle, len(solid.faces))
        return euler_defect(solid.boundary, genera)

    @property
    def cautions(self) -> tuple[str, ...]:
        """What a reader has to know first, one sentence each."""
        found = []
        if not self.solid.unit_is_declared:
            found.append(
                f"The file names no unit; its lengths are taken as {self.solid.unit}. "
                "Declare the unit with --unit, or in the recipe with unit:"
            )
        if self.euler_defect:
            found.append(f"Surfaces and edges do not add up (Euler: {self.euler_defect:+d}).")
        if not any(not pose.rolling for pose in self.poses):
            found.append("The part rolls whichever way it lies; it cannot be picked at rest.")
        return tuple(found)

    def density_g_cm3(self, asked: float | None = None) -> float:
        """Return the density asked for, else the file's, else aluminium's."""
        return asked or self.solid.density_g_cm3 or USUAL_DENSITY_G_CM3

    def remarks(self, pose: StablePose) -> tuple[str, ...]:
        """Return what else is known of a pose, in words."""
        found = []
        for family in self.resting.families:
            if family.pose == pose.index:
                turn = (
                    "all round"
                    if family.arc_rad >= 2 * np.pi - 1e-6
                    else (f"over {np.degrees(family.arc_rad):.0f} deg")
                )
                shape = {"other": "a curve"}.get(family.kind, f"a {family.kind}")
                found.append(f"rolls {turn} on {shape} of {len(family.downs)} strips")
        if pose.same_as not in (-1, pose.index):
            found.append(f"the same as pose {pose.same_as} by a symmetry of the part")
        return tuple(found)


def compile_part(path: Path, options: CompileOptions | None = None) -> CompiledPart:
    """Read a CAD file and work out all that follows from it.

    Raises
    ------
    CadError : as `load_solid`
    """
    options = options or CompileOptions()
    solid = load_solid(path, unit=options.unit)
    resting = find_resting(solid)
    prepared = prepare_views(solid)
    return CompiledPart(
        solid=solid,
        resting=resting,
        views=tuple(line_view(solid, pose.R, prepared=prepared) for pose in resting.poses),
        samples=sample_surface(solid, options.sample_spacing_mm, options.samples_per_face),
    )
