"""Rows of decisions: plans, recoveries, verdicts, answers, refusals."""

from collections.abc import Mapping, Sequence
from typing import Literal

from pydantic import Field

from messages.fields import Sentence

from ._body import Body, Fields, Matrix


class FirstMotion(Body):
    """The first motion after a pause, as shown: joints [rad, mm] or openings [mm], rounded.

    `tcp_mm` and `turn_deg` are the TCP's way, `seconds` the forecast [cell s].
    """

    kind = "decision"
    row_name = "first_motion"
    words: Sentence
    origin: tuple[float, ...] = ()
    goal: tuple[float, ...] = ()
    tcp_mm: float = 0.0
    turn_deg: float = 0.0
    seconds: float = 0.0


class StoodStill(Body):
    """The cell at rest in a pause: joints [rad, mm] and openings of both grippers [mm]."""

    kind = "decision"
    row_name = "stood_still"
    q: tuple[float, ...]
    arm_mm: float
    fixed_mm: float


class UnseenFields(Fields):
    """A piece of surface that the plan cannot show: its share of all surface, and the reason."""

    face: int
    area_fraction: float
    reason: Sentence


class PlanMade(Body):
    """A plan; times are cell seconds.

    `is_ahead`: it was made while the arm still had the part before, and a fresh look has confirmed
    everything in place.
    """

    kind = "decision"
    row_name = "plan"
    steps: tuple[Sentence, ...]
    seconds: tuple[float, ...]
    forecast_s: float
    covered_fraction: float
    covered_U: float | None = None  # noqa: N815 (U is the symbol of the field)
    reachable_fraction: float
    unseen: tuple[UnseenFields, ...] = ()
    is_ahead: bool = False


class PlanDropped(Body):
    """A plan that was made ahead was dropped because the table or the cell has changed."""

    kind = "decision"
    row_name = "plan_dropped"
    reason: Sentence


class PlanKept(Body):
    """No new plan: the cell goes on with its present plan."""

    kind = "decision"
    row_name = "plan_kept"
    reason: Sentence


class RecoveryBegun(Body):
    """A part fault, and the recovery action that the cell takes."""

    kind = "decision"
    row_name = "recovery"
    fault: str = Field(alias="trouble")
    reason: Sentence
    action: Sentence = Field(alias="remedy")
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
    reason: Sentence = ""
    alarm: int = 0


class DeviceRetried(Body):
    """A failed picture, lamp command or reading; it is repeated after a while [cell s]."""

    kind = "decision"
    row_name = "device_retried"
    device: str
    error: Sentence
    number: int
    delay_s: float = 0.0
    alarm: int = 0


class GraspAvoided(Body):
    """A grasp has failed, and is planned no more for this part."""

    kind = "decision"
    row_name = "grasp_avoided"
    grasp: str


class RecoveryProposed(Body):
    """The proposal for a part that an earlier run left, and the decision on it.

    `custody` is the part's custody by the evidence, `decision` is `refused` or `accepted`, `person`
    is the reason why the cell cannot continue, `shown` is the list of points that the person was
    asked to check before deciding.
    """

    kind = "decision"
    row_name = "recovery_proposed"
    run: str
    custody: str = ""
    evidence: tuple[Sentence, ...]
    intents: tuple[Sentence, ...] = ()
    steps: tuple[Sentence, ...] = ()
    first_motion: Sentence = ""
    is_proven: bool = False
    person: str = ""
    decision: str = ""
    who: str = ""
    why: str = ""
    shown: Sentence = ""


class PartResumed(Body):
    """The part of an interrupted run is continued in this one."""

    kind = "decision"
    row_name = "part_resumed"
    run: str
    serial: str = ""
    lot: str = ""
    order_number: str = ""


class PartFollowed(Body):
    """The later fate of a part that a run ended with; added to that run by the later one.

    `run` is the later run. `custody` is where the part is now (`Custody.key`); without it, the
    later run has taken the part over, and has its record from then on.
    """

    kind = "decision"
    row_name = "part_followed"
    run: str
    custody: str = ""


def has_record(
    followed: PartFollowed | None, resumed: PartResumed | None, *, is_custody_known: bool
) -> bool:
    """Return whether a run has the record of a part, rather than an earlier or later run (ADR 37).

    Parameters
    ----------
    followed, resumed : the last of these rows of the part, None without
    is_custody_known : a row of the run says who had the part
    """
    if followed is not None and not followed.custody:
        return False
    return resumed is None or is_custody_known


class CodeFields(Fields):
    """The code of a part as a camera read it: all it says, its number, and the picture.

    `corners_mm` are the symbol's, in turn, in the part frame; empty beside the part.
    """

    text: Sentence
    number: str
    picture: str
    corners_mm: Matrix = ()


class PartIdentified(Body):
    """The current part belongs to one of the run's recipes, and has this number, if any.

    `recipe` counts from 0 in the order of the run's recipes, `name` is that recipe's. From here on
    all rows of the part are of that recipe; a later row of this name replaces this one. `code` is
    what a camera of the cell read; the number is its own unless the papers give another one.
    """

    kind = "decision"
    row_name = "part_identified"
    recipe: int
    name: str
    serial: str = ""
    lot: str = ""
    code: CodeFields | None = None


def label_of(
    number: int,
    serials: Sequence[str],
    lot: str,
    resumed: PartResumed | None,
    identified: PartIdentified | None,
) -> tuple[str, str]:
    """Return serial number and lot of a part by the rows of its run; empty if it has none.

    Parameters
    ----------
    number : number of the part
    serials, lot : serials and lot given at the start of the run
    resumed, identified : the last of these rows of the part, None without
    """
    if identified is not None:
        serial = identified.serial
    elif resumed is not None:
        serial = resumed.serial
    else:
        serial = serials[number - 1] if 0 < number <= len(serials) else ""
    if identified is not None and identified.lot:
        return serial, identified.lot
    return serial, lot if resumed is None else resumed.lot


class PartLeft(Body):
    """A part of a wanted recipe was left on the table: it cannot be taken, and the reason."""

    kind = "decision"
    row_name = "part_left"
    part: str
    pose_index: int
    x_mm: float
    y_mm: float
    reason: Sentence


class AmbiguityResolved(Body):
    """The hypotheses left after a view."""

    kind = "decision"
    row_name = "doubt_settled"
    between: tuple[str, ...]
    left: tuple[str, ...]
    light: str


class ConfirmedFinding(Fields):
    """A finding in more than one picture."""

    view: str
    kind: str
    lamp: str
    faces: tuple[int, ...]


class FaceJudged(Fields):
    """The result for one surface; all shares are of its own area, 0..1."""

    face: int
    label: Sentence
    area_mm2: float
    compared_fraction: float = Field(alias="seen_fraction")
    by_check: Mapping[str, float] = Field(default_factory=dict)
    rest: Mapping[str, float] = Field(default_factory=dict)
    verdict: str
    views: tuple[str, ...]
    reason: Sentence


class DetectionFields(Fields):
    """A kind of defect: the size requested, and the share on which it would have been found."""

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
    reasons: tuple[Sentence, ...]
    compared_fraction: float = Field(alias="covered_fraction")
    compared_U: float | None = None  # noqa: N815 (U is the symbol of the field)
    in_sight_fraction: float | None = None
    claim: Sentence = ""
    confirmed: tuple[ConfirmedFinding, ...] = ()
    faces: tuple[FaceJudged, ...]
    found: tuple[DetectionFields, ...] = ()


class PartInspected(Body):
    """The basis of a part's verdict: the file of its views, and the SHA-256 of the result lines."""

    kind = "decision"
    row_name = "part_inspected"
    views: str
    lines_sha256: str


class QuestionAnswered(Body):
    """The operator's decision, their name, and the reason."""

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
    message: Sentence
    part_removed: bool


class FindingReviewed(Fields):
    """A person's review of a finding: `real` or `false_alarm`; `number` is the report's."""

    number: int
    word: Literal["real", "false_alarm"]


class PartReviewed(Body):
    """A person's verdict on a part, beside the machine's; the last one counts, as a whole.

    `machine` is the machine's verdict that the person had before them.
    """

    kind = "decision"
    row_name = "part_reviewed"
    verdict: Literal["accept", "reject"]
    who: str
    why: str
    machine: str = ""
    findings: tuple[FindingReviewed, ...] = ()


class PicturesCopied(Body):
    """Pictures of a run that are in a store of objects, too: SHA-256 by file, each read back."""

    kind = "decision"
    row_name = "pictures_copied"
    to: str
    files: Mapping[str, str]
    who: str = ""


class PicturesDropped(Body):
    """Pictures of a run that were deleted to make room; their hashes stay in the journal."""

    kind = "decision"
    row_name = "pictures_dropped"
    before: str
    files: tuple[str, ...]
    who: str = ""
