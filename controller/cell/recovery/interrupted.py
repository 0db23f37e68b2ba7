"""The state that an earlier run left: its journal's knowledge of the part in a gripper."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from ..custody import Around, Custody, TrayRecord
from ..journal import Row, read_row, rows
from .trail import Trail


@dataclass(frozen=True, slots=True)
class TakenView:
    """A view with stored pictures.

    Attributes
    ----------
    row : row of the view
    sighting : pose of the part then, for a view of the table
    """

    row: rows.ViewPicturesTaken
    sighting: rows.SightingFields | None


@dataclass(slots=True, eq=False)
class Interrupted:
    """A part that a run did not bring to its tray, folded from the rows of that run.

    Attributes
    ----------
    run, part : run, and the number of the part in it
    began : the run's first row
    custody, custody_detail, custody_before : by the last row on custody, and the one before it
    last_intent : the last of something that is never repeated without looking
    intent : the same, if no row on custody followed it
    has_outcome : True if that intent's outcome was written
    hand_off : the last intent to close the fixed gripper on the part in the arm gripper
    arm_hold, expected_hold, fixed_hold : grasps of the part in the grippers, actual or expected
    trail : the way the arm came
    views : in order, with the digests of their files in `digests`
    table_pictures, sightings, sighting : the part on the table, as seen last
    neighbours : other objects on the table at that time
    trays : contents of the trays
    is_ambiguous : pictures of the table leave other hypotheses, and no view has decided
    recoveries, avoid : part faults so far, and grasps that failed
    plan_count, hold_count, look_count : plans made, grasps taken, pictures of the table
    verdict : if the part was judged
    judged : rows of that judgement: its views, values and findings, in order
    identified : recipe of the run that it belongs to, and its number
    resumed : if that run had taken the part over from one before it
    serials : numbers of other parts of that run
    is_homed : positions meant something in that run
    is_homing : homing with the part had begun, and had not ended
    has_ended : True if it came to its end by itself, so that it was not killed
    """

    run: str
    part: int
    began: rows.RunBegan
    custody: Custody = Custody.ON_TABLE
    custody_before: Custody = Custody.NONE
    custody_detail: str = ""
    last_intent: rows.Intent | None = None
    intent: rows.Intent | None = None
    has_outcome: bool = False
    hand_off: rows.Intent | None = None
    arm_hold: rows.HoldNoted | None = None
    expected_hold: rows.HoldNoted | None = None
    fixed_hold: rows.HoldNoted | None = None
    trail: Trail = field(default_factory=Trail)
    views: list[TakenView] = field(default_factory=list)
    digests: dict[str, str] = field(default_factory=dict)
    sighting: rows.SightingFields | None = None
    neighbours: tuple[rows.SightingFields, ...] = ()
    trays: TrayRecord = field(default_factory=TrayRecord)
    is_ambiguous: bool = False
    recoveries: list[rows.RecoveryBegun] = field(default_factory=list)
    avoid: list[str] = field(default_factory=list)
    plan_count: int = 0
    hold_count: int = 0
    look_count: int = 0
    table_pictures: rows.TablePictures | None = None
    sightings: rows.Sightings | None = None
    verdict: rows.PartJudged | None = None
    judged: dict[tuple[str, str], rows.Body] = field(default_factory=dict)
    resumed: rows.PartResumed | None = None
    identified: rows.PartIdentified | None = None
    serials: set[str] = field(default_factory=set)
    is_homed: bool = False
    is_homing: bool = False
    has_ended: bool = False

    @property
    def recipe_number(self) -> int:
        """The number of the part's recipe in the run; the first if it was not recognised."""
        return 0 if self.identified is None else self.identified.recipe

    @property
    def recipe(self) -> rows.RecipeOrdered:
        """The recipe of the part."""
        return self.began.ordered[self.recipe_number]

    @property
    def serial(self) -> str:
        """The part's serial number; empty if it has none."""
        return self._label[0]

    @property
    def lot(self) -> str:
        """The part's lot; empty if it has none."""
        return self._label[1]

    @property
    def order_number(self) -> str:
        """The number of the part's order; empty if none was given."""
        began = self.began
        return began.order_number if self.resumed is None else self.resumed.order_number

    @property
    def _label(self) -> tuple[str, str]:
        began = self.began
        return rows.label_of(self.part, began.serials, began.lot, self.resumed, self.identified)

    @property
    def around(self) -> Around:
        """The other objects in the cell."""
        return Around(self.neighbours, self.trays.stored)

    def take(self, row: rows.Body) -> None:
        """Take one row about this part."""
        match row:
            case rows.CustodyChanged():
                self.custody_before, self.custody = self.custody, Custody.of_key(row.name)
                self.custody_detail = row.detail
                self.intent, self.has_outcome = None, False
            case rows.Intent():
                self.intent = self.last_intent = row
                self.has_outcome = False
                if row.name == rows.Once.HAND_OFF:
                    self.hand_off = row
            case rows.OnceDone() if self.intent is not None and row.name == self.intent.name:
                self.has_outcome = True
            case rows.HoldNoted():
                self._take_hold(row)
            case rows.Sightings():
                self.sightings = row
                self.sighting, self.neighbours = row.parted()
                self.is_ambiguous = bool(self.sighting and self.sighting.ambiguous_with)
            case rows.AmbiguityResolved():
                self.is_ambiguous = len(row.left) != 1
            case rows.TablePictures():
                self.look_count += 1
                self.table_pictures = row
            case rows.FilesStored():
                self.digests |= row.root
            case rows.ViewPicturesTaken():
                self.views.append(TakenView(row, None if row.q else self.sighting))
            case rows.PlanMade():
                self.plan_count += 1
            case rows.RecoveryBegun():
                self.recoveries.append(row)
            case rows.GraspAvoided():
                self.avoid.append(row.grasp)
            case rows.ViewJudged():
                self.judged[row.row_name, row.view] = row
            case rows.PartMeasured() | rows.PartFindings():
                self.judged[row.row_name, ""] = row
            case rows.PartJudged():
                self.verdict = row
            case rows.PartResumed():
                self.resumed = row
            case rows.PartIdentified():
                self.identified = row
        self.trail.take(row)

    def _take_hold(self, row: rows.HoldNoted) -> None:
        if row.gripper == "fixed":
            self.fixed_hold = row
        elif row.is_expected:
            self.expected_hold = row
        else:
            self.arm_hold = row
        self.hold_count = max(self.hold_count, row.number)


def fold_interrupted(found: Iterable[Row], run: str, part: int) -> Interrupted | None:
    """Return a run's knowledge of one of its parts; None if the run's first row is missing.

    Parameters
    ----------
    found : rows of a journal, in order; those of other runs and parts are skipped
    run, part : run and part

    Raises
    ------
    ValueError : a row is not as this version writes it
    """
    known: Interrupted | None = None
    is_homed = is_homing = has_ended = False
    for one in found:
        if one.run != run:
            continue
        row = read_row(one.kind, one.name, one.body)
        if isinstance(row, rows.RunBegan):
            known = Interrupted(run, part, row)
        elif isinstance(row, rows.Homed | rows.PositionsTakenOver | rows.HomedWithPart):
            is_homed, is_homing = True, False
        elif isinstance(row, rows.HomingBegun):
            is_homing = True
        elif isinstance(row, rows.RunEnded | rows.RunBrokeOff):
            has_ended = True
        elif known is not None and row is not None:
            known.trays.take(row)
            if one.part == part:
                known.take(row)
            else:
                known.trail.take(row)
                if isinstance(row, rows.PartIdentified) and row.serial:
                    known.serials.add(row.serial)
    if known is not None:
        known.is_homed, known.is_homing, known.has_ended = is_homed, is_homing, has_ended
    return known


def same_cell(one: Mapping[str, object], other: Mapping[str, object]) -> bool:
    """Return whether two cell files describe the same cell, apart from the devices' addresses."""
    return {k: v for k, v in one.items() if k != "devices"} == {
        k: v for k, v in other.items() if k != "devices"
    }
