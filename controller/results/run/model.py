"""The record of a run: plain frozen data, folded from the journal by `_fold`.

Steps are timed in *cell* seconds (an emulated cell may run faster than the wall); all other
durations are wall seconds, with `wall` in their names.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, Final, Literal

from controller.cell.custody import Custody
from controller.cell.journal import Body
from controller.cell.journal.rows import (
    CharacteristicFields,
    CheckMade,
    PartFollowed,
    PartIdentified,
    PartJudged,
    PartLeft,
    PartResumed,
    PlanMade,
    RecipeOrdered,
    label_of,
)

End = Literal["complete", "held", "stopped", "aborted", "refused", "broke_off", "cut_off"]
Box = tuple[int, int, int, int]
Points = tuple[tuple[float, float], ...]
REVIEW_TRAY: Final = "quarantine"  # parts in it await a person


class ResultsError(Exception):
    """A run's journal cannot be read; the message names the fault."""


class UnknownRunError(ResultsError):
    """There is no run of the name given."""


@dataclass(frozen=True, slots=True)
class DeviceReport:
    """A device of the run.

    Attributes
    ----------
    address : address as resolved at the start
    identity : identity that it reported; empty if it never answered
    """

    name: str
    address: str
    is_emulated: bool
    identity: str


@dataclass(frozen=True, slots=True)
class SightingReport:
    """One object found on the table.

    Attributes
    ----------
    part : name, None for an unknown object
    score : probability that part and pose are right, 0..1; of an unknown object, that it is an
        object
    sigma_mm, sigma_deg : standard deviations of position and theta; None if unknown
    residual_px : standard deviation of the edges from their predictions, None if unknown
    box_px : x0, y0, x1, y1 in the overhead picture
    ambiguous_with : other hypotheses that fit as well, in words
    is_taken : the cell went on with it; what else was there was left alone
    """

    part: str | None
    pose_index: int
    x_mm: float
    y_mm: float
    theta_deg: float
    score: float
    sigma_mm: float | None
    sigma_deg: float | None
    residual_px: float | None
    box_px: Box
    ambiguous_with: tuple[str, ...]
    reason: str
    is_taken: bool = False


@dataclass(frozen=True, slots=True)
class StepReport:
    """One step [cell s]; `actual_s` is None if it was not finished or is not timed.

    Attributes
    ----------
    view : id of the view it presented, empty for other steps
    jaw_mm, expected_mm : opening after a grasp, measured and planned
    """

    label: str
    forecast_s: float | None
    actual_s: float | None
    view: str = ""
    tray: str = ""
    jaw_mm: float | None = None
    expected_mm: float | None = None


@dataclass(frozen=True, slots=True)
class DryStepReport:
    """A step that was driven without a part, lifted.

    Attributes
    ----------
    motions : number of motions of the arm
    lifted_mm : least and most of what its waypoints were raised by
    left_out : sentences on the waypoints left out
    seconds : time it took [cell s]
    """

    label: str
    pose_index: int
    motions: int
    lifted_mm: tuple[float, float]
    left_out: tuple[str, ...]
    seconds: float


@dataclass(frozen=True, slots=True)
class FindingReport:
    """A finding: where picture and CAD disagree; see `controller.inspection.Finding`.

    Attributes
    ----------
    number : number of the finding on its part, from 1, in the order the views were judged
    area_mm2 : None where only its extent is known
    verdict : fail where it is proven, indeterminate where not; empty in runs that did not say
    outline_px : border of what differs, in the picture; may be empty
    pictures : every view and lamp that shows it; empty in runs that did not say
    """

    number: int
    view: str
    kind: str
    lamp: str
    area_mm2: float | None
    size_mm: float
    at_px: tuple[float, float] | None
    box_px: Box | None
    p_part_mm: tuple[float, ...]
    faces: tuple[int, ...]
    verdict: str = ""
    outline_px: Points = ()
    pictures: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class ViewReport:
    """One view of the part.

    Attributes
    ----------
    pictures : file by lamp, relative to the run's folder
    evaluated : None if the run ended before the view was judged
    reason : reason why it was not evaluated
    shift_mm, turn_deg, residual_px : measured pose from the expected one; None if unknown
    outline_px : every third border pixel of the prediction
    T_world_part : (4, 4) the pose measured; empty if it is not known
    """

    view: str
    pictures: Mapping[str, str]
    evaluated: bool | None
    reason: str = ""
    shift_mm: float | None = None
    turn_deg: float | None = None
    residual_px: float | None = None
    outline_px: Points = ()
    findings: tuple[FindingReport, ...] = ()
    checks: tuple[CheckMade, ...] = ()
    T_world_part: tuple[tuple[float, ...], ...] = ()


@dataclass(frozen=True, slots=True)
class ReviewReport:
    """A person's verdict on a part.

    Attributes
    ----------
    verdict : ``accept`` or ``reject``
    machine : the machine's verdict that the person had before them
    findings : by number of a finding, ``real`` or ``false_alarm``; only those that were named
    """

    at: datetime
    verdict: str
    who: str
    why: str
    machine: str
    findings: Mapping[int, str]


@dataclass(frozen=True, slots=True)
class PartReport:
    """The result of one part.

    Attributes
    ----------
    looks : number of looks at the table; more than one after a missed grasp
    table_pictures : pictures of the last look, file by lamp
    sightings : sightings of the last look
    steps : steps of the last plan, done or not
    custody : the last one in the journal
    unconfirmed : actions begun and never confirmed; where not empty, `custody` may be out of date
    resumed : the interrupted run that the part was taken over from; None for a part of this run
    followed : fate of it according to a later run; None if none records it
    is_counted : this is the part's record; else another run has it, or will have
    tray : the one it was placed in; None if it was not placed
    nest : nest in the tray, from 1; None if its parts are not counted
    characteristics : in the order of their balloons
    start, end : times of its first and its last row
    identified : recipe of the run that it belongs to, and its number; None if unknown
    left : parts that could not be taken as they lay, before this one was
    reviews : persons' verdicts, oldest first; the last one counts, as a whole
    """

    number: int
    looks: int
    table_pictures: Mapping[str, str]
    sightings: tuple[SightingReport, ...]
    plan: PlanMade | None
    steps: tuple[StepReport, ...]
    grasps_missed: tuple[str, ...]
    views: tuple[ViewReport, ...]
    verdict: PartJudged | None
    tray: str | None
    nest: int | None
    custody: Custody
    custody_detail: str
    unconfirmed: str
    characteristics: tuple[CharacteristicFields, ...] = ()
    resumed: PartResumed | None = None
    followed: PartFollowed | None = None
    is_counted: bool = True
    start: datetime | None = None
    end: datetime | None = None
    identified: PartIdentified | None = None
    left: tuple[PartLeft, ...] = ()
    reviews: tuple[ReviewReport, ...] = ()

    @property
    def review(self) -> ReviewReport | None:
        """The person's verdict that counts."""
        return self.reviews[-1] if self.reviews else None

    @property
    def serial_picture(self) -> str:
        """The picture in which a camera read its serial number; empty for another source."""
        known = self.identified
        if known is None or known.code is None or known.code.number != known.serial:
            return ""
        return known.code.picture

    @property
    def awaits_review(self) -> bool:
        """Whether a person has to decide, and none has yet."""
        is_open = self.verdict is not None and self.verdict.verdict == "indeterminate"
        return not self.reviews and (is_open or self.tray == REVIEW_TRAY)

    @property
    def findings(self) -> tuple[FindingReport, ...]:
        """The findings of all views."""
        return tuple(f for view in self.views for f in view.findings)


@dataclass(frozen=True, slots=True)
class LogEntry:
    """One row of the journal; `t_s` is wall seconds since the run's first row.

    Attributes
    ----------
    body : as the journal keeps it
    row : its model; None if this version does not know or cannot read such a row
    flaw : reason why it cannot be read; empty otherwise
    cell_s : time of the row by the cell's clock [cell s]; None if unknown
    """

    seq: int
    at: datetime
    t_s: float
    part: int | None
    kind: str
    name: str
    body: Mapping[str, Any]
    row: Body | None = None
    flaw: str = ""
    cell_s: float | None = None


@dataclass(frozen=True, slots=True)
class StageReport:
    """Wall time spent in a state of the cell, all visits together."""

    state: str
    visits: int
    wall_s: float


@dataclass(frozen=True, slots=True)
class RunOutcome:
    """The end of the run.

    Attributes
    ----------
    end : the state of rest; ``broke_off`` where it could not come to rest, ``cut_off`` where the
        journal just stops
    message : message of the end; empty when all went well
    code : stable short name of what happened
    where : place of the part, as a sentence
    """

    end: End
    message: str
    code: str
    custody: Custody
    where: str


@dataclass(frozen=True, slots=True)
class Copy:
    """The copy of a picture: the address of its store of objects, and its SHA-256."""

    to: str
    sha256: str


@dataclass(frozen=True, slots=True)
class RunRecord:
    """A run, folded from its journal.

    Attributes
    ----------
    folder : the run's own folder, where its pictures are
    recipe, cell : as they were read, whole
    emulator : report of the emulator about itself; empty on a real cell
    speed, speed_reached : cell seconds per wall second, requested and reached on average; None
        where the run did not come to its end
    ordered : number of parts ordered
    first_broken_row : number of the first journal row whose hash does not fit; None if all fit
    files : sha256 of recipe, cell file and CAD files, by path
    operator, lot, order_number, serials, part_temperature_c : as given with the order; may be empty
        or None
    calibration : calibrations of the cell that did not count; None if the journal is older than
        they are
    dry : the steps of a dry run; None if the run was to inspect parts
    ordered_recipes : all recipes of the run, at least one; `recipe` is the first
    stored : sha256 of each file of the run's folder, as the journal has it
    copies : copies of pictures, by file
    """

    run_id: str
    folder: Path
    recipe: Mapping[str, Any]
    cell: Mapping[str, Any]
    devices: tuple[DeviceReport, ...]
    emulator: Mapping[str, Any]
    software: Mapping[str, str]
    speed: float
    speed_reached: float | None
    ordered: int
    start: datetime
    end: datetime
    wall_s: float
    outcome: RunOutcome
    parts: tuple[PartReport, ...]
    stages: tuple[StageReport, ...]
    log: tuple[LogEntry, ...]
    first_broken_row: int | None
    files: Mapping[str, str] = field(default_factory=dict)
    operator: str = ""
    lot: str = ""
    order_number: str = ""
    serials: tuple[str, ...] = ()
    part_temperature_c: float | None = None
    calibration: tuple[str, ...] | None = None
    dry: tuple[DryStepReport, ...] | None = None
    ordered_recipes: tuple[RecipeOrdered, ...] = ()
    stored: Mapping[str, str] = field(default_factory=dict)
    copies: Mapping[str, Copy] = field(default_factory=dict)

    @property
    def recipe_name(self) -> str:
        """The recipe's name; of several recipes all names."""
        return " + ".join(str(recipe.get("name", "unknown")) for recipe in self.recipes)

    @property
    def recipes(self) -> tuple[Mapping[str, Any], ...]:
        """The recipes of the run, at least one, with their content when read."""
        return tuple(one.recipe for one in self.ordered_recipes)

    def recipe_of(self, part: PartReport) -> RecipeOrdered:
        """Return the recipe of a part; the first one if it was not recognised."""
        return self.ordered_recipes[0 if part.identified is None else part.identified.recipe]

    def label_of(self, part: PartReport) -> tuple[str, str]:
        """Return serial number and lot of a part; empty if it has none."""
        return label_of(part.number, self.serials, self.lot, part.resumed, part.identified)

    def papers_of(self, part: PartReport) -> Mapping[str, str]:
        """Return the numbers in a part's papers, by key: the recipe's, and the order as given."""
        found = self.recipe_of(part).recipe.get("papers") or {}
        given = self.order_number if part.resumed is None else part.resumed.order_number
        papers = {**found, **({"order_number": given} if given else {})}
        return {key: str(number) for key, number in papers.items() if number}

    @property
    def cell_name(self) -> str:
        """The cell's name."""
        return str(self.cell.get("name", "unknown"))

    @property
    def emulated_devices(self) -> tuple[str, ...]:
        """The names of the devices that were not real."""
        return tuple(device.name for device in self.devices if device.is_emulated)
