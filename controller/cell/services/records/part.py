"""The known facts on the current part."""

import asyncio
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from controller import inspection as inspecting
from controller.arrays import BoolArray, FloatArray, Grey
from controller.cell.compute import Located
from controller.cell.custody import Custody
from controller.cell.journal.rows import CodeFields, SightingFields
from controller.cell.machine import Recovery
from controller.planning import FaceToShowAgain, Grasp, Look, Plan, Present
from controller.recognition import Alternative, FreeTurn, Sighting

from .product import BatchProduct


@dataclass(slots=True, eq=False)
class PartInGripper:
    """The arm gripper's hold of the part, from one grasp to its release.

    Attributes
    ----------
    grasp : as planned
    T_part_tcp : (4, 4) as planned, or as measured once `is_measured`
    opening_mm : opening of the jaws on the part
    is_measured : whether a view has confirmed it
    number : counts the arm gripper's grasps of this part
    unconfirmed_count : number of views in a row that could not confirm it
    """

    grasp: Grasp
    T_part_tcp: FloatArray
    opening_mm: float
    is_measured: bool = False
    unconfirmed_count: int = 0
    number: int = 0


@dataclass(slots=True, eq=False)
class Shown:
    """A view that is being judged.

    Attributes
    ----------
    hold : grasp in which it was taken, None for a part on the table
    q : (6,) joints of the arm
    expected : (4, 4) expected pose of the part
    backlit : its picture before the backlight panel
    lamps : lamps of its lit pictures
    is_hold_measured : the expected pose was measured in an earlier view
    T_part_tcp : (4, 4) grasp at that time; None for a part on the table
    facts : what was known of the part then besides its CAD model
    task : the result
    located : pose of the part, known sooner; None to take it from the result
    """

    view: str
    hold: PartInGripper | None
    q: FloatArray
    expected: FloatArray
    holder: tuple[inspecting.WorldBox, ...]
    backlit: Grey
    lamps: tuple[str, ...]
    is_hold_measured: bool
    T_part_tcp: FloatArray | None
    task: asyncio.Task[inspecting.ViewResult]
    located: asyncio.Task[Located] | None = None
    facts: inspecting.PartFacts = inspecting.NO_FACTS


@dataclass(frozen=True, slots=True)
class AboveTray:
    """The arm has gone on to a tray before the verdict.

    Attributes
    ----------
    tray : tray below it now
    started_s : start time [cell s]
    """

    tray: str
    started_s: float


@dataclass(slots=True)
class PartRecord:
    """All known facts on the current part.

    Attributes
    ----------
    product : product of the batch it belongs to; None until it was recognised
    serial, lot : empty if it has none
    scanned : serial number that was read off it before it was looked at
    code : code on it, or beside it, that a camera has read; None before
    coded : corners (4, 3) of each code that was read on it, by what it says, in the part frame
    code_problem : reason why the codes that were read cannot name it; empty without one
    other_codes : what other codes say, and why they do not name it
    codes_sought : number of pictures in which its code was sought
    reading : views whose pictures are searched for its code
    pictures, picture_names : pictures and picture names of the last look at the table
    look_count : number of looks at the table
    seen : all sightings of the last look
    alternatives : other hypotheses from the pictures of the table
    free_turn : axis about which its turn is a guess; None as a rule
    laid : (4, 4) pose in which the arm has set it down, until it is seen there; None otherwise
    neighbours : other objects on the table at the last look; they stay there
    plan_ahead : made while the arm had the part before; None if there is none that holds
    plan, next_step : the plan being followed, and the number of its next step
    plan_count : number of plans made
    hold : grasp in the arm gripper; None if it is empty
    hold_count : number of times that the arm gripper took it, or was about to
    fixed_grasp : grasp in the fixed gripper, as measured; None if it is empty
    pending : views whose results are not known yet
    unlearned : views of which nobody has asked yet where they show the part
    results : results of all views, of earlier plans too
    judged : the views that they are of
    suspect_count : number of views with findings at the last judgement before the last view
    files : files of the pictures of each view, by lamp
    planned : mask (n,) of the samples that each view was planned to show
    recoveries : part faults that the cell has set out to recover from
    avoid : ids of grasps that have failed
    short : faces of which too little was compared, and from which grasps
    above_tray : the tray that the arm went on to while the part was judged
    parked : the fault for which the part goes to the quarantine tray, None while all is well
    is_said_to_be_out : a person states that they took it out; not checked yet
    interrupted : the run that was cut off while it had the part; empty for a part of this run alone
    """

    number: int
    product: BatchProduct | None = None
    serial: str = ""
    lot: str = ""
    scanned: str = ""
    code: CodeFields | None = None
    coded: dict[str, FloatArray] = field(default_factory=dict)
    code_problem: str = ""
    other_codes: list[str] = field(default_factory=list)
    codes_sought: int = 0
    reading: list[asyncio.Task[None]] = field(default_factory=list)
    custody: Custody = Custody.ON_TABLE
    pictures: dict[str, Grey] = field(default_factory=dict)
    picture_names: dict[str, str] = field(default_factory=dict)
    look_count: int = 0
    seen: tuple[Sighting, ...] = ()
    sighting: Sighting | None = None
    alternatives: tuple[Alternative, ...] = ()
    free_turn: FreeTurn | None = None
    laid: FloatArray | None = None
    neighbours: tuple[SightingFields, ...] = ()
    plan_ahead: Plan | None = None
    plan: Plan | None = None
    plan_count: int = 0
    next_step: int = 0
    hold: PartInGripper | None = None
    hold_count: int = 0
    fixed_grasp: Grasp | None = None
    pending: list[Shown] = field(default_factory=list)
    unlearned: list[Shown] = field(default_factory=list)
    results: list[inspecting.ViewResult] = field(default_factory=list)
    judged: list[Shown] = field(default_factory=list)
    suspect_count: int = 0
    files: dict[str, Mapping[str, str]] = field(default_factory=dict)
    planned: dict[str, BoolArray] = field(default_factory=dict)
    recoveries: list[Recovery] = field(default_factory=list)
    avoid: set[str] = field(default_factory=set)
    short: frozenset[FaceToShowAgain] = frozenset()
    above_tray: AboveTray | None = None
    parked: Recovery | None = None
    verdict: inspecting.PartVerdict | None = None
    tray: str | None = None
    is_said_to_be_out: bool = False
    interrupted: str = ""

    @property
    def in_sight(self) -> BoolArray | None:
        """Mask of the samples (n,) that views had in sight; None before the first view.

        In sight, compared or not: if no check could compare, another such view could not either. A
        view from another grasp may: see `short`.
        """
        return merged([result.in_sight for result in self.results if result.evaluated])

    @property
    def codes_mm(self) -> tuple[FloatArray, ...]:
        """The corners (4, 3) of the codes known to be on it, in the part frame."""
        return tuple(self.coded.values())

    @property
    def facts(self) -> inspecting.PartFacts:
        """All that is known of it now besides its CAD model, for the judging of a view."""
        return inspecting.PartFacts(self.codes_mm, self.free_turn)

    @property
    def shown(self) -> tuple[Shown, ...]:
        """All views shown, in their order, with a result or without."""
        return (*self.judged, *self.pending)

    @property
    def suspects(self) -> int:
        """Number of views with findings against the part, of those that have a result."""
        return sum(bool(result.evaluated and result.findings) for result in self.results)

    @property
    def presents_left(self) -> int:
        """Number of views in a gripper that the plan still has."""
        left = () if self.plan is None else self.plan.steps[self.next_step :]
        return sum(isinstance(step, Present) for step in left)

    @property
    def promised(self) -> BoolArray | None:
        """Mask of the samples (n,) that the views of the present plan are to show."""
        plan = self.plan
        if plan is None:
            return None
        return merged([s.seen for s in plan.steps if isinstance(s, Present | Look)])


def merged(masks: Sequence[BoolArray]) -> BoolArray | None:
    """Return the union of masks (n,); None if none has samples."""
    whole = [mask for mask in masks if len(mask)]
    return np.logical_or.reduce(whole) if whole else None
