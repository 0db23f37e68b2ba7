"""Pictures and rays, without a part: cameras, lamps, lines of sight, levels, outlines, edges.

All rooms that process pictures build on this one. Camera frames are OpenCV's; pixel (0, 0) is the
centre of the first pixel; lengths are in millimetres, angles in radians.
"""

from .camera import Camera, inverse_pose, rotation_angle, transform
from .contours import Contour, mask_contour, mask_rim, subpixel_contour, threshold_levels
from .edges import (
    EdgeFits,
    blur_shift_px,
    measure_edges,
    measure_sloped_edges,
    step_heights,
)
from .lamp import PointLamp
from .levels import Ground, Levels, fit_ground
from .loops import evenly, loop_normals, signed_area, trace_loops
from .maps import Roi, ViewMaps, meet_part, render_maps, view_roi
from .rays import RayCaster
from .sampling import sample_picture, slopes_of

__all__ = [
    "Camera",
    "Contour",
    "EdgeFits",
    "Ground",
    "Levels",
    "PointLamp",
    "RayCaster",
    "Roi",
    "ViewMaps",
    "blur_shift_px",
    "evenly",
    "fit_ground",
    "inverse_pose",
    "loop_normals",
    "mask_contour",
    "mask_rim",
    "measure_edges",
    "measure_sloped_edges",
    "meet_part",
    "render_maps",
    "rotation_angle",
    "sample_picture",
    "signed_area",
    "slopes_of",
    "step_heights",
    "subpixel_contour",
    "threshold_levels",
    "trace_loops",
    "transform",
    "view_roi",
]
