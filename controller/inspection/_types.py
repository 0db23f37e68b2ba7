"""Inputs and results of inspection: pictures of a view in, differences from the CAD out."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from controller.arrays import BoolArray, Float32Array, FloatArray, Grey, Int32Array
from controller.imaging import Camera, PointLamp
from controller.recognition.fitting import FreeTurn
from messages import key, say

from .limits import PLANNED_HOLD


class Verdict(StrEnum):
    """Four outcomes, not two (cell-facts.md 3)."""

    PASS = "pass"
    FAIL = "fail"
    INDETERMINATE = "indeterminate"
    NOT_EVALUATED = key("not evaluated")


class Unjudged(StrEnum):
    """Reason why no check compared a sample in sight; the first in this order that applies."""

    HOLDER = key("beside the gripper, nearer than its place and shape are known")
    FLAT = key("seen too flat for the smallest defect to show")
    UNLIT = key("turned from the lamps or in shadow, where a defect stays as dark as all else")
    PENUMBRA = key("at the border of a shadow")
    BOUNCE = key("lit by light from neighbouring surfaces, which no prediction knows")
    HIGHLIGHT = key("where the lamp's highlight may be")
    ROUGH = key("a finish too uneven for the smallest defect to stand out")
    LIGHT = key("lit in a way that the prediction does not know: another lamp or view is needed")
    EDGE = key("too near to an edge for the smallest defect to show whole")
    LAMP = key("in pictures that failed their self-check")
    CODE = key("on the code with the serial number, or close beside it")

    @property
    def number(self) -> int:
        """Number of the reason in `ViewResult.unjudged`, from 1; 0 stands for none."""
        return 1 + list(Unjudged).index(self)


class FindingKind(StrEnum):
    """Kind of a finding."""

    MISSING = key("missing material")
    EXTRA = key("extra material")
    CHIP = key("chip")
    BURR = key("burr")
    DIMENSION = key("face out of place")
    MISSING_EDGE = key("missing edge")
    SURFACE = key("surface differs")
    DENT = key("dent")
    PIT = key("pit")
    SCRATCH = key("scratch")
    STAIN = key("stain")

    @property
    def is_mark(self) -> bool:
        """True for a local mark in a face's texture; dust, dirt or light may look the same."""
        return self in (self.DENT, self.PIT, self.SCRATCH, self.STAIN)

    @property
    def is_lit(self) -> bool:
        """True if found by its brightness in a picture under a lamp."""
        return self is self.SURFACE or self.is_mark


@dataclass(frozen=True, slots=True)
class InspectionLimits:
    """Limits above which a difference is a finding, each with its reason.

    Attributes
    ----------
    smallest_defect_mm : smallest defect that the recipe asks to be found
    min_outline_share : least share of the predicted outline found, for a view to be evaluated; a
        part in the wrong place matches a third by chance, one with a half missing three quarters
    max_shift_mm, max_turn_rad : largest deviation from the expected pose; beyond it the part has
        slipped in the jaws
    slack_px : deviation of outlines and shading that means nothing
    grey_levels : where the prediction is dark, differences of half as many mean nothing
    min_contrast : between panel and part, and of a lamp on a surface square to it [grey]
    max_lit_shift_px : largest shift of a lit picture from the pose measured in the backlit one
    max_edge_px : largest width of an edge (standard deviation of its blur)
    max_edge_growth_px : largest excess of an edge's width over its prediction; the picture is
        defocused beyond either limit
    max_burnt_share : largest share of burnt-out pixels of panel or part
    false_marks : mean number of false marks per picture from the texture of good faces; with twelve
        pictures a part, one part in eight shows one
    weak_marks : the same for marks that do not count alone, but confirm those of another picture
    dust_mm : width up to which a mark may be a speck of dust, and does not count
    """

    smallest_defect_mm: float = 3.0
    min_outline_share: float = 0.6
    max_shift_mm: float = 4.0
    max_turn_rad: float = 0.12
    slack_px: int = 2
    grey_levels: float = 22.0
    min_contrast: float = 40.0
    max_lit_shift_px: float = 1.0
    max_edge_px: float = 1.3
    max_edge_growth_px: float = 0.45
    max_burnt_share: float = 0.05
    false_marks: float = 0.01
    weak_marks: float = 0.3
    dust_mm: float = 0.5

    @property
    def min_area_mm2(self) -> float:
        """Smallest area that counts: half the disc of the smallest defect."""
        return 0.5 * self.defect_area_mm2

    @property
    def defect_area_mm2(self) -> float:
        """Area of the smallest defect's disc."""
        return float(np.pi / 4 * self.smallest_defect_mm**2)


@dataclass(frozen=True, eq=False, slots=True)
class WorldBox:
    """A box of the gripper or the arm: pose of its centre (4, 4), half edge lengths (3,) [mm]."""

    T: FloatArray
    half_mm: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class PartFacts:
    """Facts on one part that its CAD model does not have, at the time of a view.

    Attributes
    ----------
    codes_mm : corners (4, 3) of codes on the part, in turn, CAD frame; nothing is compared there
    free_turn : axis about which the turn of the expected pose is a guess; None as a rule
    """

    codes_mm: tuple[FloatArray, ...] = ()
    free_turn: FreeTurn | None = None

    @property
    def is_turn_open(self) -> bool:
        """Nothing is known of its turn about an axis yet."""
        return self.free_turn is not None and not self.free_turn.is_shown


NO_FACTS: Final = PartFacts()


@dataclass(frozen=True, eq=False, slots=True)
class ViewTask:
    """One view to judge.

    Attributes
    ----------
    view_id : its name
    camera : the inspection camera
    T_world_part_expected : (4, 4) expected pose of the part
    holder : boxes of the gripper and the arm that may be in the picture
    panel_mm : (4, 3) corners of the backlight panel behind the part, world
    lamps : lamps of the lit pictures
    limits : tolerances
    is_hold_measured : True if the expected pose was measured in an earlier view under this grasp,
        to a fraction of a millimetre; otherwise it is the planned pose
    facts : known of this part besides its CAD model
    """

    view_id: str
    camera: Camera
    T_world_part_expected: FloatArray
    holder: tuple[WorldBox, ...]
    panel_mm: FloatArray
    lamps: tuple[PointLamp, ...]
    limits: InspectionLimits
    is_hold_measured: bool = False
    facts: PartFacts = NO_FACTS


@dataclass(frozen=True, eq=False, slots=True)
class ViewPictures:
    """Pictures of one view in one pose: before the backlight panel, and by lamp name."""

    backlit: Grey
    lit: Mapping[str, Grey]


@dataclass(frozen=True, eq=False, slots=True)
class PicturedView:
    """One view of a part with its pictures.

    Attributes
    ----------
    task : the view: camera, pose expected, gripper, lamps
    pictures : taken there
    grasp : number of the grasp; views with the same number share how the part lies in the jaws
    prior_mm, prior_rad : standard deviations of the expected pose, the grasp's and the arm's
        together
    counted : (n,) samples that it counts for; None for all
    """

    task: ViewTask
    pictures: ViewPictures
    grasp: int = 0
    prior_mm: float = PLANNED_HOLD[0]
    prior_rad: float = PLANNED_HOLD[1]
    counted: BoolArray | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Finding:
    """A place where picture and CAD disagree.

    Attributes
    ----------
    kind : what it is
    lamp : picture that shows it (``backlit`` or a lamp's name)
    area_mm2, size_mm : visible area, and longest extent, on the part
    at_px : (x, y) of its centre in the picture
    box_px : x0, y0, x1, y1
    p_part_mm : (3,) nearest point of the part, CAD frame
    face_ids : surfaces it lies on, largest share first
    evidence : strength of a mark over the limit of texture; below 1 it only confirms others
    contrast : brightness of a mark against its surroundings, as a share
    dipole_px : vector from the dark to the bright side of a mark that has both
    is_sure : True if one look is enough: no dust, light or error of the pose looks like it
    outline_px : (k, 2) border of the difference in the picture; None where unknown
    words : deviation in words; empty where the size states it
    """

    kind: FindingKind
    lamp: str
    area_mm2: float
    size_mm: float
    at_px: tuple[float, float]
    box_px: tuple[int, int, int, int]
    p_part_mm: FloatArray
    face_ids: tuple[int, ...]
    evidence: float = 1.0
    contrast: float = 0.0
    dipole_px: tuple[float, float] = (0.0, 0.0)
    is_sure: bool = False
    outline_px: FloatArray | None = None
    words: str = ""

    @property
    def is_long(self) -> bool:
        """True for a line, as found by a line filter."""
        return self.kind is FindingKind.SCRATCH


@dataclass(frozen=True, eq=False, slots=True)
class Check:
    """One comparison of one picture with the CAD: the samples compared, and the sizes detectable.

    Attributes
    ----------
    name : ``outline``, or the lamp's name
    reason : reason why it was not made; empty where it was
    compared : (n,) mask of surface samples where a difference of `size_mm` would be a finding
    size_mm : largest unnoticed deviation of an outline, along `length_mm` of it; under a lamp, the
        width of the smallest area that stands out
    length_mm : see `size_mm`; 0 under a lamp
    misfit : share by which at least a tenth of the lit surface is off its predicted brightness
    smallest_mm : smallest width that would have been found at each sample (n,), by kind of mark
        (dent, scratch, stain); inf where none
    learned_from : number of good parts that the picture was compared with
    is_dark : True if nothing in sight is known to be lit, and too little shows to verify the pose
    """

    name: str
    reason: str
    compared: BoolArray
    size_mm: float = 0.0
    length_mm: float = 0.0
    misfit: float = 0.0
    smallest_mm: Mapping[str, Float32Array] = field(default_factory=dict)
    learned_from: int = 0
    is_dark: bool = False


OUTLINE = "outline"


@dataclass(frozen=True, eq=False, slots=True)
class ViewResult:
    """Result of one view.

    Attributes
    ----------
    evaluated : False where a self-check failed; `reason` says which
    T_world_part_expected : (4, 4)
    T_world_part_measured : (4, 4); None where not evaluated
    shift_mm, turn_rad : displacement from the expected to the measured pose
    residual_px : residual of the outline fit
    findings : differences from the CAD
    compared : (n,) mask of surface samples that any check of this view compared
    beside_gripper : (n,) mask of samples in sight, but too near to the gripper to be compared
    unobstructed : (n,) mask of samples with nothing in front, the gripper's margin left out; empty
        where a view records no more than `compared`
    checks : all checks, including those that failed
    unjudged : (n,) reason why no check compared a sample in sight, as a number of `Unjudged`
        from 1; 0 for none; may be empty
    outline_px : outline of the prediction at the measured pose, (k, 2), for the report
    hints : marks too weak to be findings, which may confirm those of another look
    face_ids : (n,) surface of each sample, for readers without the part; may be empty
    """

    view_id: str
    evaluated: bool
    reason: str
    T_world_part_expected: FloatArray
    T_world_part_measured: FloatArray | None
    shift_mm: float
    turn_rad: float
    residual_px: float
    findings: tuple[Finding, ...]
    compared: BoolArray
    outline_px: FloatArray
    beside_gripper: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    unobstructed: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    checks: tuple[Check, ...] = ()
    unjudged: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, dtype=np.uint8))
    hints: tuple[Finding, ...] = ()
    face_ids: Int32Array = field(default_factory=lambda: np.zeros(0, dtype=np.int32))

    @property
    def T_world_part_known(self) -> FloatArray:
        """The measured pose (4, 4), else the expected one."""
        T = self.T_world_part_measured
        return self.T_world_part_expected if T is None else T

    @property
    def in_sight(self) -> BoolArray:
        """Mask (n,) of the samples in sight in the judged pictures of this view."""
        if not self.evaluated:
            return np.zeros_like(self.compared)
        is_lit = any(not c.reason for c in self.checks if c.name != OUTLINE)
        if len(self.unobstructed) and is_lit:
            return self.unobstructed | self.compared
        return self.compared

    @property
    def failures(self) -> tuple[str, ...]:
        """Reasons of the failed self-checks, of the whole view or of lamps."""
        if not self.evaluated:
            return (
                say(
                    "view {view_id} not evaluated: {reason}",
                    view_id=self.view_id,
                    reason=self.reason,
                ),
            )
        return tuple(
            say(
                "view {view_id}, {name} not evaluated: {reason}",
                view_id=self.view_id,
                name=c.name,
                reason=c.reason,
            )
            for c in self.checks
            if c.reason
        )

    def within(self, samples: BoolArray) -> "ViewResult":
        """Return this view's result restricted to some samples (n,)."""
        return replace(
            self,
            compared=self.compared & samples,
            unobstructed=self.unobstructed & samples
            if len(self.unobstructed)
            else self.unobstructed,
            checks=tuple(
                replace(
                    c,
                    compared=c.compared & samples,
                    smallest_mm={
                        kind: np.where(samples, widths, np.float32(np.inf))
                        for kind, widths in c.smallest_mm.items()
                    },
                )
                for c in self.checks
            ),
        )
