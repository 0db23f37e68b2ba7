"""Rows of observations: openings, holds, pictures, sightings, views, characteristics, findings."""

from collections.abc import Mapping
from typing import Literal

from pydantic import Field

from controller.config.view_set import SetTurn
from messages.fields import Sentence

from ._body import Body, Box, Fields, Matrix, TextByName


class TouchedDown(Body):
    """A lowered part met tray or table above its planned height, by this much."""

    kind = "observation"
    row_name = "touched_down"
    left_mm: float
    error: Sentence = ""


class Openings(TextByName):
    """The report of each gripper: whether it holds something, and the reading behind it."""

    kind = "observation"
    row_name = "openings"


class GraspFields(Fields):
    """A grasp, as planned; see `controller.planning.Grasp`."""

    id: str
    T_part_tcp: Matrix
    opening_mm: float
    pre_open_mm: float
    contact_mm2: float
    load: float
    score: float
    holder: str
    margin: float = 1.0
    is_inner: bool = False
    on_table: bool = False


class HoldNoted(Body):
    """A gripper's hold of the part, or the hold it will have once closed (`is_expected`).

    `T_part_tcp` is as measured where `is_measured`, else as planned; `number` counts the grasps of
    the arm gripper on this part.
    """

    kind = "observation"
    row_name = "hold"
    gripper: Literal["arm", "fixed"]
    grasp: GraspFields
    T_part_tcp: Matrix
    opening_mm: float
    is_measured: bool = False
    is_expected: bool = False
    number: int = 0


class HoldPressed(Body):
    """The arm gripper pressed once more on the part: its openings before and after."""

    kind = "observation"
    row_name = "hold_pressed"
    opening_mm: float
    held_mm: float


class CalibrationFields(Fields):
    """One calibration: when it was measured, and why it no longer counts; empty while it does."""

    measured: str
    why_stale: Sentence = ""


class CalibrationsStood(Body):
    """Whether the cell's calibrations count, as the run begins.

    `sentences` are the sentences for reports.
    """

    kind = "observation"
    row_name = "calibrations_stood"
    each: Mapping[str, CalibrationFields] = Field(default_factory=dict)
    why_not_verified: Sentence = ""
    sentences: tuple[Sentence, ...] = ()


class FilesStored(TextByName):
    """Files of the run's folder, with the SHA-256 of their content when written."""

    kind = "observation"
    row_name = "files_stored"


class TablePictures(TextByName):
    """The pictures of the table, file by lamp."""

    kind = "observation"
    row_name = "table_pictures"


class OtherHypothesis(Fields):
    """Another hypothesis for an object on the table: part or pose."""

    part: str
    pose_index: int
    theta_deg: float
    T_world_part: Matrix | None = None


class SightingFields(Fields):
    """An object on the table."""

    part: str | None
    pose_index: int
    R: tuple[tuple[float, ...], ...] | None = Field(default=None, alias="stable_pose_R")
    x_mm: float
    y_mm: float
    theta_deg: float
    score: float
    sigma_mm: float | None = None
    sigma_deg: float | None = None
    residual_px: float | None = None
    ambiguous_with: tuple[OtherHypothesis, ...] = ()
    box_px: Box
    reason: Sentence = ""
    T_world_part: Matrix | None = None
    free_share: float = 1.0
    touching_count: int = 0
    is_cut: bool = False
    lies_on: tuple[int, ...] = ()
    is_covered: bool = False
    free_turn: SetTurn | None = None


class Sightings(Body):
    """The objects recognised on the table; `taken` is the number of the one taken."""

    kind = "observation"
    row_name = "sightings"
    sightings: tuple[SightingFields, ...]
    taken: int | None = None

    def parted(self) -> tuple[SightingFields | None, tuple[SightingFields, ...]]:
        """Return the part that is taken, and all parts left alone.

        A single object is the part, whether it was taken or not.
        """
        taken = 0 if self.taken is None and len(self.sightings) == 1 else self.taken
        if taken is None:
            return None, self.sightings
        return self.sightings[taken], (*self.sightings[:taken], *self.sightings[taken + 1 :])


class ViewHold(Fields):
    """The hold of the part in a view: as known at that time, and its grasp of the arm gripper."""

    number: int
    T_part_tcp: Matrix
    opening_mm: float
    is_measured: bool


class ViewPicturesTaken(Body):
    """The pictures of a view, file by lamp, and the arm's joint values (6,).

    With the data for judging the view again: the grasp of the part, None for a part on the table,
    and the samples it was planned to show, packed as in `controller.config.view_set.packed`.
    """

    kind = "observation"
    row_name = "view_pictures"
    view: str
    pictures: Mapping[str, str]
    q: tuple[float, ...] = ()
    hold: ViewHold | None = None
    planned: str = ""
    sample_count: int = 0


class CheckMade(Fields):
    """A comparison of a view with the CAD; `reason` is why it was not made."""

    check: str
    reason: Sentence
    compared_samples: int
    size_mm: float
    length_mm: float
    misfit: float | None = None


class FindingFields(Fields):
    """A place where picture and CAD differ."""

    kind: str
    lamp: str
    area_mm2: float
    size_mm: float
    at_px: tuple[float, float]
    box_px: Box
    p_part_mm: tuple[float, ...]
    faces: tuple[int, ...]


class ViewJudged(Body):
    """The result of inspecting a view.

    `faces` has for each face the number of its samples compared so far, and their total: (face,
    compared, of). Faces without any compared sample are left out.
    """

    kind = "observation"
    row_name = "view"
    view: str
    evaluated: bool
    reason: Sentence = ""
    T_world_part: tuple[tuple[float, ...], ...] = ()
    shift_mm: float | None = None
    turn_deg: float | None = None
    residual_px: float | None = None
    compared_samples: int = Field(default=0, alias="seen_samples")
    in_sight_samples: int = 0
    checks: tuple[CheckMade, ...] = ()
    outline_px: tuple[tuple[int, int], ...] = ()
    findings: tuple[FindingFields, ...] = ()
    faces: tuple[tuple[int, int, int], ...] = ()


class LookFields(Fields):
    """The result of one picture for a characteristic, with the edge points and the shape fitted."""

    view: str
    lamp: str
    measured: float | None = None
    u: float | None = None
    reason: Sentence = ""
    budget: Mapping[str, float] = Field(default_factory=dict)
    points_px: tuple[tuple[float, float], ...] = ()
    accepted: tuple[int, ...] = ()
    shape_px: tuple[tuple[float, float], ...] = ()


class CharacteristicFields(Fields):
    """A characteristic with its result; values in `unit`, which is mm or deg.

    `anchors_mm` are the places it is measured at, CAD frame: one of a hole, two of a distance;
    `axis` is the axis of a hole or boss, or the direction of a distance.
    """

    id: str
    balloon: int
    kind: str
    label: Sentence
    unit: str = "mm"
    nominal: float
    lower: float
    upper: float
    source: str
    faces: tuple[int, ...] = ()
    is_critical: bool = False
    measured: float | None = None
    U: float | None = None
    verdict: str
    views: tuple[str, ...] = ()
    reason: Sentence = ""
    anchors_mm: tuple[tuple[float, float, float], ...] = ()
    axis: tuple[float, float, float] | None = None
    rim_radius_mm: float | None = None
    is_hole: bool | None = None
    looks: tuple[LookFields, ...] = ()

    @property
    def deviation(self) -> float | None:
        """The difference of the value from the nominal one."""
        return None if self.measured is None else self.measured - self.nominal


class PartMeasured(Body):
    """The characteristics of a part, by all its views."""

    kind = "observation"
    row_name = "characteristics"
    characteristics: tuple[CharacteristicFields, ...]


class ViewOffFields(Fields):
    """A held part's distance in one view from its pose by all views of its grasp."""

    view: str
    grasp: int
    off_mm: float
    off_deg: float


class ViewsPosed(Body):
    """The disagreement of arm and camera from view to view: residuals of the joint fit."""

    kind = "observation"
    row_name = "views_posed"
    views: tuple[ViewOffFields, ...]


class PartFindingFields(Fields):
    """A finding of a part, by all its views; values in pixels are in the picture named.

    `pictures` has every view and lamp that shows it.
    """

    kind: str
    view: str
    lamp: str
    p_part_mm: tuple[float, ...]
    size_mm: float
    faces: tuple[int, ...]
    verdict: str
    area_mm2: float | None = None
    at_px: tuple[float, float] | None = None
    box_px: Box | None = None
    outline_px: tuple[tuple[float, float], ...] = ()
    pictures: tuple[tuple[str, str], ...] = ()


class PartFindings(Body):
    """The findings of a part, by all its views."""

    kind = "observation"
    row_name = "findings"
    findings: tuple[PartFindingFields, ...]


class LoopLate(Body):
    """Delays of the controller's event loop within a time: the longest, and their sum.

    `longest_s` and `missed_s` are seconds of the wall, `within_s` is cell seconds.
    """

    kind = "observation"
    row_name = "loop_late"
    longest_s: float
    missed_s: float
    within_s: float
    alarm: int = 0
