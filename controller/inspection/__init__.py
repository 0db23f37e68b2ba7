"""Inspection: pictures of known views -> differences from the CAD, coverage, and a verdict.

Arrays in, dataclasses out (cell-facts.md 3).
"""

from ._gathered import by_place
from ._holder import with_measured_holder
from ._judge import FaceVerdict, PartVerdict, judge
from ._part_types import PartFinding, PartInspection, PartSettings, ViewOff, ViewSet
from ._pose import PosedPart
from ._scene import ViewScene, before_part, box_mesh, make_scene
from ._types import (
    NO_FACTS,
    OUTLINE,
    Check,
    Finding,
    FindingKind,
    InspectionLimits,
    PartFacts,
    PicturedView,
    Unjudged,
    Verdict,
    ViewPictures,
    ViewResult,
    ViewTask,
    WorldBox,
)
from .detection import KINDS, Detection, least_mm
from .kept import Kept, Same
from .learning import MIN_PARTS, GoodPart, Lesson, TooFewPartsError, Tried, learn, require_usable
from .limits import MEASURED_HOLD, MIN_FACE_SHARE, PLANNED_HOLD
from .lit import Appearance, LearnedPicture, LearnedView
from .part import inspect_part, work_ahead
from .predicted import predict_pictures
from .resolution import needed_px_per_mm
from .view import CheckedView, NotEvaluated, inspect_view, locate_view

__all__ = [
    "KINDS",
    "MEASURED_HOLD",
    "MIN_FACE_SHARE",
    "MIN_PARTS",
    "NO_FACTS",
    "OUTLINE",
    "PLANNED_HOLD",
    "Appearance",
    "Check",
    "CheckedView",
    "Detection",
    "FaceVerdict",
    "Finding",
    "FindingKind",
    "GoodPart",
    "InspectionLimits",
    "Kept",
    "LearnedPicture",
    "LearnedView",
    "Lesson",
    "NotEvaluated",
    "PartFacts",
    "PartFinding",
    "PartInspection",
    "PartSettings",
    "PartVerdict",
    "PicturedView",
    "PosedPart",
    "Same",
    "TooFewPartsError",
    "Tried",
    "Unjudged",
    "Verdict",
    "ViewOff",
    "ViewPictures",
    "ViewResult",
    "ViewScene",
    "ViewSet",
    "ViewTask",
    "WorldBox",
    "before_part",
    "box_mesh",
    "by_place",
    "inspect_part",
    "inspect_view",
    "judge",
    "learn",
    "least_mm",
    "locate_view",
    "make_scene",
    "needed_px_per_mm",
    "predict_pictures",
    "require_usable",
    "with_measured_holder",
    "work_ahead",
]
