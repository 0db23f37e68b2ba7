"""Inputs and results of the inspection of a part from all its views."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from controller.arrays import BoolArray, FloatArray
from controller.cad import SurfaceSamples

from ._judge import NO_PLAN, NOTHING, PartVerdict
from ._pose import PosedPart
from ._types import InspectionLimits, PicturedView, Verdict, ViewResult
from .characteristics import Measured
from .detection import NOTHING_ASKED
from .dimensions import MeasuringSettings
from .grasp_pose import PoseSettings
from .integrity import Allowances
from .lit import Appearance


@dataclass(frozen=True, eq=False, slots=True)
class ViewSet:
    """All views of one part.

    Attributes
    ----------
    part, samples : the CAD model and its surface samples
    views : in the order taken
    """

    part: PosedPart
    samples: SurfaceSamples
    views: tuple[PicturedView, ...]


@dataclass(frozen=True, eq=False, slots=True)
class PartSettings:
    """Strictness with which a part is judged.

    Attributes
    ----------
    limits : limits of differences
    min_coverage : share of what can be seen that must have been verified for a pass
    not_inspected : reason, by face id, why the recipe leaves a face out
    unseen_reasons : reason, by face id, why the plan could not show all of a face
    planned : mask, by view id, of the samples (n,) that the plan meant the view to show
    allowances : allowed deviations of the outline of a good part
    pose : prior knowledge of arm, parts and light
    measuring : prior knowledge of lens, scale and temperature
    find_mm : by kind of defect the size that has to be found for a pass; of other kinds the size
        is stated
    appearance : of good parts, which decides on surfaces in views that it serves; None where none
        was learned
    """

    limits: InspectionLimits
    min_coverage: float = 0.95
    not_inspected: Mapping[int, str] = field(default_factory=lambda: NOTHING)
    unseen_reasons: Mapping[int, str] = field(default_factory=lambda: NOTHING)
    planned: Mapping[str, BoolArray] = field(default_factory=lambda: NO_PLAN)
    allowances: Allowances = field(default_factory=Allowances)
    pose: PoseSettings = field(default_factory=PoseSettings)
    measuring: MeasuringSettings = field(default_factory=MeasuringSettings)
    find_mm: Mapping[str, float] = field(default_factory=lambda: NOTHING_ASKED)
    appearance: Appearance | None = None


@dataclass(frozen=True, eq=False, slots=True)
class PartFinding:
    """A difference of the part from the CAD model: one place, one finding.

    Attributes
    ----------
    kind : missing, extra, chip, burr, dimension, missing_edge, dent, pit, scratch, stain, surface
        or identity
    view_id, lamp : picture that shows it best
    p_part_mm : (3,) CAD frame
    size_mm : longest extent
    faces : ids of the surfaces it lies on
    verdict : FAIL where it is proven, INDETERMINATE where it may be something else
    box_px : x0, y0, x1, y1 in that picture; None if it is not known there
    outline_px : (k, 2) border of the difference in that picture, for the report
    area_mm2 : largest visible area; None for the whole part
    at_px : (x, y) of its centre in that picture; None if unknown
    pictures : every view and lamp that shows it
    """

    kind: str
    view_id: str
    lamp: str
    p_part_mm: FloatArray
    size_mm: float
    faces: tuple[int, ...]
    verdict: Verdict
    box_px: tuple[int, int, int, int] | None = None
    outline_px: FloatArray | None = None
    area_mm2: float | None = None
    at_px: tuple[float, float] | None = None
    pictures: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class ViewOff:
    """Disagreement of arm and camera in one view of a held part.

    Attributes
    ----------
    view_id : name of the view
    grasp : number of the grasp, from 0
    mm, rad : deviation from the joint pose of all views of the grasp
    """

    view_id: str
    grasp: int
    mm: float
    rad: float


@dataclass(frozen=True, eq=False, slots=True)
class PartInspection:
    """Inspection result of a part from all its views.

    Attributes
    ----------
    verdict : worst proven verdict; PASS where nothing is left open
    reasons : sentences, most important first
    views : results view by view
    measured : characteristics with their results
    findings : differences from the CAD model
    ledger : compared share of each surface, and the reasons for the rest
    unproven : characteristics that a PASS does not cover since they were not verified, in sentences
    off : disagreement of arm and camera, view by view
    """

    verdict: Verdict
    reasons: tuple[str, ...]
    views: tuple[ViewResult, ...]
    measured: tuple[Measured, ...]
    findings: tuple[PartFinding, ...]
    ledger: PartVerdict
    unproven: tuple[str, ...] = ()
    off: tuple[ViewOff, ...] = ()
