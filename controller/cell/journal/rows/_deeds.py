"""Rows of actions: intents, outcomes, custody, leases."""

from messages.fields import Sentence

from ._body import Body, EffectClass, Fields, Joints, Matrix, NamedBody


class Intent(NamedBody):
    """Something of `Once` is about to be done.

    `retreat` is the joint path (n, 6) by which the arm leaves after the action; that path is free
    of contact then, unlike the approach.
    """

    kind = "intent"
    effect_class: EffectClass = EffectClass.ONCE
    expected_mm: float | None = None
    open_mm: float | None = None
    pose_index: int | None = None
    tray: str | None = None
    by: str = ""
    detail: Sentence = ""
    retreat: tuple[Joints, ...] = ()


class PathBegun(Body):
    """The arm is about to follow a joint path (n, 6), or to go back by as many waypoints."""

    kind = "intent"
    row_name = "follow_path"
    effect_class: EffectClass = EffectClass.ABSOLUTE
    waypoints: tuple[Joints, ...]
    is_back: bool = False


class PathEnded(Body):
    """The arm has come to the end of the path that was begun last."""

    kind = "outcome"
    row_name = "path_ended"


class HomingBegun(Body):
    """The arm is about to home with its jaws shut, from about these joints (6,); no jaw opens.

    `low` and `high` bound its position; `opening_mm` is the opening at which the jaws press on the
    part, none if they are empty.
    """

    kind = "intent"
    row_name = "home_with_part"
    effect_class: EffectClass = EffectClass.ABSOLUTE
    low: Joints
    high: Joints
    opening_mm: float | None = None


class HomedWithPart(Body):
    """The arm is homed, with its jaws pressed at this opening."""

    kind = "outcome"
    row_name = "homed_with_part"
    q: Joints
    opening_mm: float


class StoodFree(Body):
    """The arm stands clear of everything at these joints (6,): going back ends here from now on."""

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
    detail: Sentence = ""
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


class StoredFields(Fields):
    """A part in a nest of a tray, at the pose in which it was put there; nests count from 0."""

    tray: str
    nest: int
    part: str
    T_world_part: Matrix
    run: str = ""
    number: int = 0
    serial: str = ""


class PartStored(Body):
    """A part was put into a nest."""

    kind = "outcome"
    row_name = "part_stored"
    part: StoredFields


class TraysStood(Body):
    """The content of the trays' nests as the run begins."""

    kind = "observation"
    row_name = "trays_stood"
    stored: tuple[StoredFields, ...] = ()


class TrayEmptied(Body):
    """A person has stated that a tray is empty."""

    kind = "decision"
    row_name = "tray_emptied"
    tray: str
    count: int = 0


class StepDone(Body):
    """A step of the plan was done; times are cell seconds."""

    kind = "outcome"
    row_name = "step"
    label: Sentence
    forecast_s: float | None = None
    seconds: float | None = None
    view: str = ""
    passed_by: str = ""
    tray: str = ""
    jaw_mm: float | None = None
    expected_mm: float | None = None


class DryStepDone(Body):
    """A step of a plan was driven without a part, each waypoint lifted.

    `lifted_mm` has its smallest and largest value, `left_out` the reasons why waypoints were left
    out, `seconds` are cell seconds.
    """

    kind = "outcome"
    row_name = "dry_step"
    label: Sentence
    pose_index: int
    waypoints: int
    lifted_mm: tuple[float, float]
    left_out: tuple[Sentence, ...] = ()
    seconds: float


class GraspMissed(Body):
    """The jaws closed on nothing, or too far."""

    kind = "outcome"
    row_name = "grip_missed"
    message: Sentence


class PartDone(Body):
    """The part is booked."""

    kind = "outcome"
    row_name = "part_done"
    verdict: str = ""
    tray: str | None = None
    recoveries: tuple[Sentence, ...] = ()


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
    error: Sentence
    alarm: int = 0


class LeaseTaken(Body):
    """An action has devices and spaces to itself from now on."""

    kind = "lease"
    row_name = "lease_taken"
    by: str
    resources: tuple[str, ...]


class LeaseReturned(Body):
    """An action has given back its resources."""

    kind = "lease"
    row_name = "lease_returned"
    by: str
    resources: tuple[str, ...]
