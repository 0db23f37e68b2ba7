"""Pictures of the table -> which part, which way up, where, how sure, or "none of these".

Arrays in, dataclasses out (paper, section 3; DESIGN.md 3.5).
"""

from ._contours import (
    Contour,
    mask_contour,
    subpixel_contour,
    table_contrast,
    threshold_levels,
)
from ._pose_fit import PosedPart, PoseFit, fit_pose
from ._recognise import (
    Alternative,
    CatalogueEntry,
    Limits,
    Sighting,
    find_objects,
    lying,
    make_catalogue,
    recognise,
)

__all__ = [
    "Alternative",
    "CatalogueEntry",
    "Contour",
    "Limits",
    "PoseFit",
    "PosedPart",
    "Sighting",
    "find_objects",
    "fit_pose",
    "lying",
    "make_catalogue",
    "mask_contour",
    "recognise",
    "subpixel_contour",
    "table_contrast",
    "threshold_levels",
]
