"""Inspection: pictures of known views -> differences from the CAD, coverage, and a verdict.

Arrays in, dataclasses out (cell-facts.md 3).
"""

from ._gathered import by_place
from ._judge import FaceVerdict, PartVerdict, judge
from ._pose import MEASURED_HOLD, PLANNED_HOLD, PosedPart
from ._scene import before_part, box_mesh, make_scene
from ._types import (
    OUTLINE,
    Check,
    Finding,
    FindingKind,
    InspectionLimits,
    Unjudged,
    Verdict,
    ViewPictures,
    ViewResult,
    ViewTask,
    WorldBox,
)
from .detection import KINDS, Detection, least_mm
from .kept import Kept, Same
from .lit import MIN_WIDTH_PX
from .part import (
    HeldView,
    PartFinding,
    PartInspection,
    PartSettings,
    ViewOff,
    ViewSet,
    inspect_part,
    work_ahead,
)
from .view import LocatedView, inspect_view, locate_view

__all__ = [
    "KINDS",
    "MEASURED_HOLD",
    "MIN_WIDTH_PX",
    "OUTLINE",
    "PLANNED_HOLD",
    "Check",
    "Detection",
    "FaceVerdict",
    "Finding",
    "FindingKind",
    "HeldView",
    "InspectionLimits",
    "Kept",
    "LocatedView",
    "PartFinding",
    "PartInspection",
    "PartSettings",
    "PartVerdict",
    "PosedPart",
    "Same",
    "Unjudged",
    "Verdict",
    "ViewOff",
    "ViewPictures",
    "ViewResult",
    "ViewSet",
    "ViewTask",
    "WorldBox",
    "before_part",
    "box_mesh",
    "by_place",
    "inspect_part",
    "inspect_view",
    "judge",
    "least_mm",
    "locate_view",
    "make_scene",
    "work_ahead",
]
