"""What follows from the CAD model alone: solid, surfaces, stable poses, what a camera would see.

Plain functions: a file or arrays in, dataclasses out. The facts are of the paper's section 2 and
planning.md 4.
"""

from .boundary import Boundary, Crease, Curve, Face
from .camera import Camera, inverse_pose, transform
from .errors import (
    CadError,
    EmptyCadError,
    ManySolidsCadError,
    OpenCadError,
    UnreadableCadError,
)
from .rays import RayCaster
from .reading import load_solid
from .resting import StablePose, stable_poses
from .shading import PointLamp, predict_light, predict_radiance
from .solid import Solid, make_solid
from .surfaces import SurfaceSamples, sample_surface
from .views import Roi, ViewMaps, render_maps, view_roi

__all__ = [
    "Boundary",
    "CadError",
    "Camera",
    "Crease",
    "Curve",
    "EmptyCadError",
    "Face",
    "ManySolidsCadError",
    "OpenCadError",
    "PointLamp",
    "RayCaster",
    "Roi",
    "Solid",
    "StablePose",
    "SurfaceSamples",
    "UnreadableCadError",
    "ViewMaps",
    "inverse_pose",
    "load_solid",
    "make_solid",
    "predict_light",
    "predict_radiance",
    "render_maps",
    "sample_surface",
    "stable_poses",
    "transform",
    "view_roi",
]
