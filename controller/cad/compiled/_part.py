"""What follows from a part alone: computed here, kept by `_cache`."""

from dataclasses import dataclass
from pathlib import Path

from ..reading import load_solid
from ..resting import StablePose, stable_poses
from ..solid import Solid
from ..surfaces import SurfaceSamples, sample_surface
from ..views import LineView, line_view, prepare_views


@dataclass(frozen=True, slots=True)
class CompileOptions:
    """What a part is compiled with, beside its file.

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
    poses : the ways it can lie, likeliest first
    views : of each pose, seen straight from above
    samples : points on its surfaces, which coverage is counted by
    """

    solid: Solid
    poses: tuple[StablePose, ...]
    views: tuple[LineView, ...]
    samples: SurfaceSamples


def compile_part(path: Path, options: CompileOptions | None = None) -> CompiledPart:
    """Read a CAD file and work out all that follows from it.

    Raises
    ------
    CadError : as `load_solid`
    """
    options = options or CompileOptions()
    solid = load_solid(path)
    poses = stable_poses(solid)
    prepared = prepare_views(solid)
    return CompiledPart(
        solid=solid,
        poses=poses,
        views=tuple(line_view(solid, pose.R, prepared=prepared) for pose in poses),
        samples=sample_surface(solid, options.sample_spacing_mm, options.samples_per_face),
    )
