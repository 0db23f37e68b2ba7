"""What follows from the CAD model alone: solid, surfaces, stable poses, what a camera would see.

Plain functions: a file or arrays in, dataclasses out. The facts are of the paper's section 2 and
planning.md 4.
"""

from .boundary import Boundary, Crease, Curve, Face, surface_normals
from .camera import Camera, inverse_pose, transform
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
from .lamp import PointLamp
from .rays import RayCaster
from .reading import load_solid
from .resting import (
    LookAlike,
    PartSymmetry,
    PoseOdds,
    Resting,
    RollingFamily,
    StablePose,
    find_resting,
    look_alikes,
    name_duplicates,
    part_symmetries,
    pose_odds,
    stable_poses,
)
from .solid import Solid, make_solid
from .surfaces import Feature, SurfaceSamples, find_features, sample_surface
from .views import (
    DrawnEdge,
    LineView,
    Loop,
    Roi,
    Stroke,
    ViewMaps,
    ViewModel,
    camera_view,
    line_view,
    meet_part,
    outline,
    prepare_views,
    render_maps,
    view_roi,
)

__all__ = [
    "Boundary",
    "CadError",
    "Camera",
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
    "PointLamp",
    "PoseOdds",
    "RayCaster",
    "Resting",
    "Roi",
    "RollingFamily",
    "SelfIntersectingCadError",
    "Solid",
    "StablePose",
    "Stroke",
    "SurfaceSamples",
    "UnitCadError",
    "UnreadableCadError",
    "ViewMaps",
    "ViewModel",
    "camera_view",
    "find_features",
    "find_resting",
    "inverse_pose",
    "line_view",
    "load_solid",
    "look_alikes",
    "make_solid",
    "meet_part",
    "name_duplicates",
    "outline",
    "part_symmetries",
    "pose_odds",
    "prepare_views",
    "render_maps",
    "sample_surface",
    "stable_poses",
    "surface_normals",
    "transform",
    "view_roi",
]
