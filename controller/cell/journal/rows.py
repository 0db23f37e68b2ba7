"""What the rows of the journal say: one model for each row, shared by writer and reader.

A row has a kind, a name and a body; kind and name decide the model of the body (`read_row`). Some
models stand for a group of names, one name for each action or event of the cell; there the name
belongs to the row and not to the body. A field that the writer leaves unset is not in the body. So
the bytes of a row, from which its hash is made, are those of the fields that were set, in the order
below.

`SCHEMA_VERSION` (_migrations.py) rises when a field is removed or changes its meaning. A new field
with a default does not change it. Fields that a model does not know are ignored.
"""

from collections.abc import Mapping
from enum import StrEnum
from typing import Annotated, Any, ClassVar, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, RootModel

from ._form import Row, RowKind

Json = Mapping[str, Any]
Text = Annotated[str, Field(coerce_numbers_to_str=True)]
Box = tuple[int, int, int, int]
Matrix = tuple[tuple[float, ...], ...]
Joints = tuple[float, ...]


class EffectClass(StrEnum):
    """Whether what an intent announces may be repeated (cell-facts.md 2)."""

    QUERY = "query"
    """Freely: it only reads."""
    ABSOLUTE = "absolute"
    """After the axes are referenced: it leads to the same place."""
    ONCE = "once"
    """Never without looking."""


class Once(StrEnum):
    """Actions never repeated without looking; the intent is on the disk before the action."""

    GRASP = "grip"
    HAND_OFF = "hand_off"
    RELEASE_ARM = "release"
    RECEIVE = "take_back"
    RELEASE_FIXED = "fixture_release"
    SET_DOWN = "set_down"
    SORT = "sort"
    OPEN_ARM_GRIPPER = "open_arm_gripper"
    OPEN_FIXED_GRIPPER = "open_fixed_gripper"


class Fields(BaseModel):
    """A group of fields inside a body."""

    model_config = ConfigDict(frozen=True, populate_by_name=True)


class Body(BaseModel):
    """What a row says."""

    model_config = ConfigDict(frozen=True, populate_by_name=True)
    kind: ClassVar[RowKind]
    row_name: ClassVar[str]

    def as_json(self) -> dict[str, Any]:
        """Return the body as the journal keeps it."""
        return self.model_dump(by_alias=True, exclude_unset=True)


class NamedBody(Body):
    """The body of a row of a group; the name stands in the row, not in the body."""

    name: str = Field(exclude=True)


class TextByName(Body, RootModel[dict[str, str]]):
    """Texts by the name of their subject: lamp, device, gripper."""


# --- the run: events ----------------------------------------------------------------------------


class RunBegan(Body):
    """The first row of a run: the recipe, the cell and the options."""

    kind = "event"
    row_name = "run_began"
    recipe: Json = {}
    files: Mapping[str, str] = {}
    cell: Json = {}
    devices: Mapping[str, Json] = {}
    emulated_devices: tuple[str, ...] = ()
    emulator: Json = {}
    speed: float = 1.0
    clock: str | None = None
    count: int | None = None
    software: Mapping[str, Text] = {}
    operator: str = ""
    lot: str = ""
    serials: tuple[str, ...] = ()
    part_temperature_c: float | None = None


class Connected(TextByName):
    """How each device identified itself."""

    kind = "event"
    row_name = "connected"


class EmulatedCellEnded(Body):
    """A part of an earlier run is gone, because its emulated cell has ended."""

    kind = "event"
    row_name = "emulated_cell_ended"
    message: str


class AlarmFields(Fields):
    """An alarm (docs/alarms.md): what it is about, and what is not known since.

    `step` is the action it happened in, `unknown` what is not known from now on, `action` what a
    person does about it.
    """

    number: int
    code: str
    device: str = ""
    step: str = ""
    unknown: str = ""
    action: str = ""


class CellEvent(NamedBody):
    """An event, and what the state machine did with it; the row's name is the event's."""

    kind = "event"
    answer: str
    source: str = Field(alias="from")
    target: str = Field(alias="to")
    message: str = ""
    code: str = ""
    reason: str = ""
    alarm: AlarmFields | None = None
    who: str = ""
    why: str = ""


class PermitIssued(Body):
    """From here on the cell may move; `by` is the event that permits it."""

    kind = "event"
    row_name = "permit_issued"
    number: int
    by: str


class PermitWithdrawn(Body):
    """From here on nothing may move; `by` is the event that forbids it."""

    kind = "event"
    row_name = "permit_withdrawn"
    number: int
    by: str


class FirstMotion(Body):
    """What moves first after a pause, as it was shown: joints [rad, mm] or openings [mm]."""

    kind = "decision"
    row_name = "first_motion"
    words: str
    origin: tuple[float, ...] = ()
    goal: tuple[float, ...] = ()
    tcp_mm: float = 0.0
    turn_deg: float = 0.0
    seconds: float = 0.0


class Acknowledged(Body):
    """A person has seen what stopped the cell and looked at it: the next start is no longer barred.

    `run` and `code` are of the fault that was acknowledged.
    """

    kind = "event"
    row_name = "acknowledged"
    run: str
    code: str
    who: str
    why: str = ""


class Overtaken(Body):
    """What an action reported after a stop had overtaken it."""

    kind = "event"
    row_name = "overtaken"
    effect: str
    message: str


class AtRest(Body):
    """The state that the run came to rest in."""

    kind = "event"
    row_name = "at_rest"
    state: str
    message: str = ""
    code: str = ""
    custody: str = ""
    where: str = ""
    alarm: AlarmFields | None = None


class RunBrokeOff(Body):
    """An error that kept the run from coming to rest."""

    kind = "event"
    row_name = "run_broke_off"
    error: str = ""
    where: str = ""


class SpeedReached(Fields):
    """Cell seconds per second, requested and reached; how long this process was late [s]."""

    asked: float | None = None
    reached: float | None = None
    missed_s: float | None = None


class RunEnded(Body):
    """The last row of a run."""

    kind = "event"
    row_name = "run_ended"
    end: str
    message: str = ""
    parts: int = 0
    speed: SpeedReached = SpeedReached()


class JournalSetAside(Body):
    """A damaged journal got another name, and this one began."""

    kind = "event"
    row_name = "journal_set_aside"
    why: str
    file: str = ""


class JournalNotReadable(Body):
    """A journal in another folder recorded the cell and is gone or damaged."""

    kind = "event"
    row_name = "journal_not_readable"
    why: str


# --- what is done: intents, outcomes, custody -----------------------------------------------------


class Intent(NamedBody):
    """Something of `Once` is about to be done.

    `retreat` is the joint path (n, 6) by which the arm leaves once it is done; it is free of
    contact then, and the way the arm came by is not.
    """

    kind = "intent"
    effect_class: EffectClass = EffectClass.ONCE
    expected_mm: float | None = None
    open_mm: float | None = None
    pose_index: int | None = None
    tray: str | None = None
    by: str = ""
    detail: str = ""
    retreat: tuple[Joints, ...] = ()


class PathBegun(Body):
    """The arm is about to follow a joint path (n, 6), or to go back by as many waypoints."""

    kind = "intent"
    row_name = "follow_path"
    effect_class: EffectClass = EffectClass.ABSOLUTE
    waypoints: tuple[Joints, ...]
    is_back: bool = False


class StoodFree(Body):
    """The arm stands free of everything at these joints (6,): going back ends here from now on."""

    kind = "outcome"
    row_name = "stood_free"
    q: Joints


class OnceDone(NamedBody):
    """Something of `Once` was done."""

    kind = "outcome"


class CustodyChanged(NamedBody):
    """The row's name is the gripper, tray or table that has the part."""

    kind = "custody"
    by: str = ""
    detail: str = ""
    before: str = ""


class Homed(Body):
    """Both grippers are homed and open."""

    kind = "outcome"
    row_name = "homed"


class PositionsTakenOver(Body):
    """The arm's positions, labelled by an earlier run, were found to hold; it was not homed."""

    kind = "outcome"
    row_name = "positions_taken_over"
    q: Joints


class TouchedDown(Body):
    """A part that was lowered met tray or table so far above its planned place."""

    kind = "observation"
    row_name = "touched_down"
    left_mm: float
    error: str = ""


class StepDone(Body):
    """A step of the plan was done; times are cell seconds."""

    kind = "outcome"
    row_name = "step"
    label: str
    forecast_s: float | None = None
    seconds: float | None = None
    view: str = ""
    passed_by: str = ""
    tray: str = ""
    jaw_mm: float | None = None
    expected_mm: float | None = None


class GraspMissed(Body):
    """The jaws closed on nothing, or too far."""

    kind = "outcome"
    row_name = "grip_missed"
    message: str


class PartDone(Body):
    """The part is booked."""

    kind = "outcome"
    row_name = "part_done"
    verdict: str = ""
    tray: str | None = None
    recoveries: tuple[str, ...] = ()


class Stopped(Body):
    """A device confirmed a stop."""

    kind = "outcome"
    row_name = "stopped"
    device: str


class StopNotConfirmed(Body):
    """A device did not confirm a stop."""

    kind = "outcome"
    row_name = "stop_not_confirmed"
    device: str
    error: str
    alarm: int = 0


# --- what is seen: observations -------------------------------------------------------------------


class Openings(TextByName):
    """What each gripper reports: whether it holds something, and by which reading."""

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
    """How a gripper holds the part, or will hold it once it has closed (`is_expected`).

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


class FilesStored(TextByName):
    """Files of the run's folder, with the SHA-256 of what was written."""

    kind = "observation"
    row_name = "files_stored"


class TablePictures(TextByName):
    """The pictures of the table, file by lamp."""

    kind = "observation"
    row_name = "table_pictures"


class OtherHypothesis(Fields):
    """Another part or pose that an object on the table may be."""

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
    reason: str = ""
    T_world_part: Matrix | None = None


class Sightings(Body):
    """What was recognised on the table."""

    kind = "observation"
    row_name = "sightings"
    sightings: tuple[SightingFields, ...]


class ViewHold(Fields):
    """How the part was held in a view: as known by then, in which grasp of the arm gripper."""

    number: int
    T_part_tcp: Matrix
    opening_mm: float
    is_measured: bool


class ViewPicturesTaken(Body):
    """The pictures of a view, file by lamp, and the arm's joint values (6,).

    With what the view needs to be judged again: how the part was held, None for a part on the
    table, and which samples it was planned to show, as `controller.config.view_set.packed` has it.
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
    reason: str
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
    """The result of inspecting a view."""

    kind = "observation"
    row_name = "view"
    view: str
    evaluated: bool
    reason: str = ""
    T_world_part: tuple[tuple[float, ...], ...] = ()
    shift_mm: float | None = None
    turn_deg: float | None = None
    residual_px: float | None = None
    compared_samples: int = Field(default=0, alias="seen_samples")
    in_sight_samples: int = 0
    checks: tuple[CheckMade, ...] = ()
    outline_px: tuple[tuple[int, int], ...] = ()
    findings: tuple[FindingFields, ...] = ()


class LookFields(Fields):
    """What one picture shows of a characteristic, with the edge points and the shape fitted."""

    view: str
    lamp: str
    measured: float | None = None
    u: float | None = None
    reason: str = ""
    budget: Mapping[str, float] = {}
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
    label: str
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
    reason: str = ""
    anchors_mm: tuple[tuple[float, float, float], ...] = ()
    axis: tuple[float, float, float] | None = None
    rim_radius_mm: float | None = None
    is_hole: bool | None = None
    looks: tuple[LookFields, ...] = ()


class PartMeasured(Body):
    """The characteristics of a part, by all its views."""

    kind = "observation"
    row_name = "characteristics"
    characteristics: tuple[CharacteristicFields, ...]


class PartFindingFields(Fields):
    """A finding of a part, by all its views; `box_px`, `outline_px` are in the picture named."""

    kind: str
    view: str
    lamp: str
    p_part_mm: tuple[float, ...]
    size_mm: float
    faces: tuple[int, ...]
    verdict: str
    box_px: Box | None = None
    outline_px: tuple[tuple[float, float], ...] = ()


class PartFindings(Body):
    """The findings of a part, by all its views."""

    kind = "observation"
    row_name = "findings"
    findings: tuple[PartFindingFields, ...]


# --- what is decided ------------------------------------------------------------------------------


class UnseenFields(Fields):
    """What the plan cannot show of a surface: its share of all surface, and the reason."""

    face: int
    area_fraction: float
    reason: str


class PlanMade(Body):
    """A plan; times are cell seconds."""

    kind = "decision"
    row_name = "plan"
    steps: tuple[str, ...]
    seconds: tuple[float, ...]
    forecast_s: float
    covered_fraction: float
    reachable_fraction: float
    unseen: tuple[UnseenFields, ...] = ()


class PlanKept(Body):
    """There is no new plan: the cell goes on with the plan it has."""

    kind = "decision"
    row_name = "plan_kept"
    reason: str


class RecoveryBegun(Body):
    """A part fault, and the recovery action that the cell takes."""

    kind = "decision"
    row_name = "recovery"
    fault: str = Field(alias="trouble")
    reason: str
    action: str = Field(alias="remedy")
    number: int = 0
    custody: str = ""
    act: str = ""
    source: str = ""
    alarm: int = 0


class SourceDemoted(Body):
    """A grasp or view has failed so often that the rest of the batch avoids it."""

    kind = "decision"
    row_name = "demoted"
    source: str
    failures: int
    uses: int
    reason: str = ""
    alarm: int = 0


class LeaseTaken(Body):
    """An action has devices and spaces to itself from now on."""

    kind = "lease"
    row_name = "lease_taken"
    by: str
    resources: tuple[str, ...]


class LeaseReturned(Body):
    """An action has given back what it had."""

    kind = "lease"
    row_name = "lease_returned"
    by: str
    resources: tuple[str, ...]


class LoopLate(Body):
    """The controller's event loop was late: the longest delay, and all of it, within a time.

    `longest_s` and `missed_s` are seconds of the wall, `within_s` is cell seconds.
    """

    kind = "observation"
    row_name = "loop_late"
    longest_s: float
    missed_s: float
    within_s: float
    alarm: int = 0


class DeviceRetried(Body):
    """A picture, a lamp or a reading did not come; it is tried again after a while [cell s]."""

    kind = "decision"
    row_name = "device_retried"
    device: str
    error: str
    number: int
    delay_s: float = 0.0
    alarm: int = 0


class GraspAvoided(Body):
    """A grasp has failed, and is planned no more for this part."""

    kind = "decision"
    row_name = "grasp_avoided"
    grasp: str


class RecoveryProposed(Body):
    """What a start makes of a part that an earlier run left, and what was decided.

    `custody` is where the part is by the evidence, `decision` is `refused` or `accepted`, `person`
    is why the cell cannot go on.
    """

    kind = "decision"
    row_name = "recovery_proposed"
    run: str
    custody: str = ""
    evidence: tuple[str, ...]
    intents: tuple[str, ...] = ()
    steps: tuple[str, ...] = ()
    first_motion: str = ""
    is_proven: bool = False
    person: str = ""
    decision: str = ""
    who: str = ""
    why: str = ""


class PartResumed(Body):
    """The part of an interrupted run goes on in this one."""

    kind = "decision"
    row_name = "part_resumed"
    run: str
    serial: str = ""
    lot: str = ""


class AmbiguityResolved(Body):
    """Which hypotheses are left after a view."""

    kind = "decision"
    row_name = "doubt_settled"
    between: tuple[str, ...]
    left: tuple[str, ...]
    light: str


class ConfirmedFinding(Fields):
    """A finding that shows in more than one picture."""

    view: str
    kind: str
    lamp: str
    faces: tuple[int, ...]


class FaceJudged(Fields):
    """What is known of one surface; all shares are of its own area, 0..1."""

    face: int
    label: str
    area_mm2: float
    compared_fraction: float = Field(alias="seen_fraction")
    by_check: Mapping[str, float] = {}
    rest: Mapping[str, float] = {}
    verdict: str
    views: tuple[str, ...]
    reason: str


class DetectionFields(Fields):
    """A kind of defect: the size asked for, and on which share it would have been found."""

    kind: str
    size_mm: float
    share: float
    half_mm: float | None = None
    is_asked: bool = False
    open_faces: tuple[int, ...] = ()


class PartJudged(Body):
    """The verdict on a part."""

    kind = "decision"
    row_name = "verdict"
    verdict: str
    reasons: tuple[str, ...]
    compared_fraction: float = Field(alias="covered_fraction")
    in_sight_fraction: float | None = None
    claim: str = ""
    confirmed: tuple[ConfirmedFinding, ...] = ()
    faces: tuple[FaceJudged, ...]
    found: tuple[DetectionFields, ...] = ()


class PartInspected(Body):
    """What a part was judged from: the file of its views, and the SHA-256 of the lines it gave."""

    kind = "decision"
    row_name = "part_inspected"
    views: str
    lines_sha256: str


class QuestionRaised(Body):
    """A question to the operator; nothing moves until it is answered.

    `choices` are what may be typed, `preview` is what moves first after each that moves something.
    """

    kind = "event"
    row_name = "question_raised"
    code: str
    text: str
    choices: tuple[str, ...]
    preview: Mapping[str, str] = {}


class QuestionAnswered(Body):
    """What the operator decided, who that was, and why."""

    kind = "decision"
    row_name = "question_answered"
    code: str
    choice: str
    who: str
    why: str = ""


class StartRefused(Body):
    """A gripper may hold a part: nothing moves."""

    kind = "decision"
    row_name = "start_refused"
    message: str
    part_removed: bool


# --- which model a row is of ----------------------------------------------------------------------

ROWS: Final[Mapping[tuple[str, str], type[Body]]] = {
    (model.kind, model.row_name): model
    for model in (
        RunBegan, Connected, EmulatedCellEnded, PermitIssued, PermitWithdrawn,
        FirstMotion, Acknowledged, Overtaken, AtRest, RunBrokeOff, RunEnded,
        JournalSetAside, JournalNotReadable, Homed, StepDone, GraspMissed, PartDone, Stopped,
        StopNotConfirmed, Openings, TablePictures, Sightings, ViewPicturesTaken, ViewJudged,
        PartMeasured, PartFindings, FilesStored, PartInspected,
        PlanMade, PlanKept, RecoveryBegun, AmbiguityResolved, PartJudged, StartRefused,
        SourceDemoted, DeviceRetried, TouchedDown, LoopLate, LeaseTaken, LeaseReturned,
        QuestionRaised, QuestionAnswered, PathBegun, StoodFree, PositionsTakenOver, HoldNoted,
        GraspAvoided, RecoveryProposed, PartResumed,
    )
}  # fmt: skip
# By kind: the model of every name that has no model of its own.
GROUPS: Final[Mapping[str, type[NamedBody]]] = {
    "event": CellEvent,
    "intent": Intent,
    "outcome": OnceDone,
    "custody": CustodyChanged,
}


def read_row(kind: str, name: str, body: Json) -> Body | None:
    """Return the body of a row as its model; None for a row without a known model.

    Parameters
    ----------
    kind, name : of the row
    body : as the journal keeps it

    Raises
    ------
    ValueError : the body is not as this version writes it
    """
    model = ROWS.get((kind, name))
    if model is not None:
        read: Body = model.model_validate(body)
        return read
    group = GROUPS.get(kind)
    if group is None:
        return None
    named: Body = group.model_validate({**body, "name": name})
    return named


def name_of(body: Body) -> str:
    """Return the name of the row to which a body belongs."""
    return body.name if isinstance(body, NamedBody) else body.row_name


def is_once(row: Row) -> bool:
    """Return whether a row is the intent of something that is never repeated without looking.

    An intent without a class is of one: it was written before there were classes.
    """
    return row.kind == "intent" and row.body.get("effect_class", EffectClass.ONCE) == "once"


def is_of(row: Row, model: type[Body]) -> bool:
    """Return whether a row of the journal is of a given model with a name of its own."""
    return (row.kind, row.name) == (model.kind, model.row_name)
