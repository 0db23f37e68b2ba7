"""What follows from the CAD model alone: solid, surfaces, stable poses, what a camera would see.

Plain functions: a file or arrays in, dataclasses out. Facts: references.md P2.0 to
P2.2, planning-facts.md 4.
"""

from .boundary import Boundary, Crease, Curve, Face, surface_normals
from .errors import (
    CadError,
    CoordinatesCadError,
    CsgCadError,
    EmptyCadError,
    InsideOutCadError,
    LargeCadError,
    ManySolidsCadError,
    OpenCadError,
    SelfIntersectingCadError,
    UnitCadError,
    UnreadableCadError,
)
from .reading import load_solid
from .resting import (
    LookAlike,
    PartSymmetry,
    Resting,
    RollingFamily,
    StablePose,
    find_resting,
    look_alikes,
    name_duplicates,
    part_symmetries,
    stable_poses,
)
from .solid import Solid, make_solid
from .surfaces import (
    Feature,
    SurfaceSamples,
    counted_samples,
    face_shares,
    find_features,
    sample_surface,
    share_of,
    uncertainty_of,
)
from .views import (
    DrawnEdge,
    LineView,
    Loop,
    Stroke,
    ViewModel,
    camera_view,
    line_view,
    outline,
    prepare_views,
)

__all__ = [
    "Boundary",
    "CadError",
    "CoordinatesCadError",
    "Crease",
    "CsgCadError",
    "Curve",
    "DrawnEdge",
    "EmptyCadError",
    "Face",
    "Feature",
    "InsideOutCadError",
    "LargeCadError",
    "LineView",
    "LookAlike",
    "Loop",
    "ManySolidsCadError",
    "OpenCadError",
    "PartSymmetry",
    "Resting",
    "RollingFamily",
    "SelfIntersectingCadError",
    "Solid",
    "StablePose",
    "Stroke",
    "SurfaceSamples",
    "UnitCadError",
    "UnreadableCadError",
    "ViewModel",
    "camera_view",
    "counted_samples",
    "face_shares",
    "find_features",
    "find_resting",
    "line_view",
    "load_solid",
    "look_alikes",
    "make_solid",
    "name_duplicates",
    "outline",
    "part_symmetries",
    "prepare_views",
    "sample_surface",
    "share_of",
    "stable_poses",
    "surface_normals",
    "uncertainty_of",
]
