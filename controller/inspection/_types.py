"""What inspection takes and gives: one shown view in, what differs from the CAD out."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from controller.cad import Camera, PointLamp

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Grey = NDArray[np.uint8]


class Verdict(StrEnum):
    """Four outcomes, not two (inspection.md, finding 7)."""

    PASS = "pass"
    FAIL = "fail"
    INDETERMINATE = "indeterminate"
    NOT_EVALUATED = "not evaluated"


class Kind(StrEnum):
    """What a finding is."""

    MISSING = "missing material"
    EXTRA = "extra material"
    SURFACE = "surface differs"


@dataclass(frozen=True, slots=True)
class Limits:
    """When a difference is a finding; each with its reason.

    Attributes
    ----------
    smallest_defect_mm : what the recipe asks to be found
    max_residual_px : outline fit worse than this: the view is not evaluated
    min_outline_share : less of the predicted outline found: the view is not evaluated; a part in
        the wrong place keeps a third by chance, one that lost its half keeps three quarters
    max_shift_mm, max_turn_rad : farther from the expected pose the part has slipped in the jaws
    slack_px : outlines and shading may be off by this much without meaning anything
    grey_share, grey_levels : a surface is as bright as predicted within these
    """

    smallest_defect_mm: float = 3.0
    max_residual_px: float = 1.2
    min_outline_share: float = 0.6
    max_shift_mm: float = 4.0
    max_turn_rad: float = 0.12
    slack_px: int = 2
    grey_share: float = 0.30
    grey_levels: float = 22.0
    min_contrast: float = 40.0

    @property
    def min_area_mm2(self) -> float:
        """Return the smallest area that counts: half the disc of the smallest defect."""
        return 0.5 * np.pi / 4 * self.smallest_defect_mm**2


@dataclass(frozen=True, eq=False, slots=True)
class WorldBox:
    """A box of the gripper or the arm: pose of its centre (4, 4), half edges (3,) [mm]."""

    T: Array
    half_mm: Array


@dataclass(frozen=True, eq=False, slots=True)
class ViewTask:
    """One view to judge.

    Attributes
    ----------
    view_id : its name
    camera : the inspection camera
    T_world_part : (4, 4) where the part is expected
    holder : boxes of what holds it and may stand in the picture
    panel_mm : (4, 3) corners of the glowing panel behind the part, world
    lamps : lamps of the lit pictures
    limits : tolerances
    is_hold_seen : the expected pose was measured in an earlier view under this grip, so that it is
        good to a fraction of a millimetre; else it is the plan's
    """

    view_id: str
    camera: Camera
    T_world_part: Array
    holder: tuple[WorldBox, ...]
    panel_mm: Array
    lamps: tuple[PointLamp, ...]
    limits: Limits
    is_hold_seen: bool = False


@dataclass(frozen=True, eq=False, slots=True)
class ViewPictures:
    """Pictures of one view, all of one pose: before the glowing panel, and by lamp name."""

    backlit: Grey
    lit: Mapping[str, Grey]


@dataclass(frozen=True, eq=False, slots=True)
class Finding:
    """One place where picture and CAD disagree.

    Attributes
    ----------
    kind : what it is
    lamp : in which picture it shows (``backlit`` or a lamp's name)
    area_mm2, size_mm : seen area, and longest extent, on the part
    at_px : (x, y) of its middle in the picture
    box_px : x0, y0, x1, y1
    p_part_mm : (3,) nearest point of the part, CAD frame
    face_ids : surfaces it lies on, largest share first
    """

    kind: Kind
    lamp: str
    area_mm2: float
    size_mm: float
    at_px: tuple[float, float]
    box_px: tuple[int, int, int, int]
    p_part_mm: Array
    face_ids: tuple[int, ...]


@dataclass(frozen=True, eq=False, slots=True)
class ViewResult:
    """What one view told.

    Attributes
    ----------
    evaluated : False where a self-check failed; `reason` says which
    T_world_part : (4, 4) measured pose (the expected one where not evaluated)
    shift_mm, turn_rad : from the expected pose to the measured one
    residual_px : of the outline fit
    findings : differences from the CAD
    seen : (n,) surface samples that this view did show and compare
    beside_hand : (n,) samples in sight, but too near to the hand to be compared
    outline_px : outline of the prediction at the measured pose, (k, 2), for the report
    """

    view_id: str
    evaluated: bool
    reason: str
    T_world_part: Array
    shift_mm: float
    turn_rad: float
    residual_px: float
    findings: tuple[Finding, ...]
    seen: Mask
    outline_px: Array
    beside_hand: Mask = field(default_factory=lambda: np.zeros(0, dtype=bool))
