"""Folds the journal rows of one part: looks, plan, steps, views, verdict, custody."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime

from controller.cell.custody import Custody
from controller.cell.journal import Body, Once, rows

from .model import (
    FindingReport,
    PartReport,
    ReviewReport,
    SightingReport,
    StepReport,
    ViewReport,
)

# Once actions, in words for a person who has to find where the part is.
ONCE_WORDS: Mapping[str, str] = {
    Once.GRASP: "closing the arm gripper on the part on the table",
    Once.HAND_OFF: "closing the fixed gripper on the part",
    Once.RELEASE_ARM: "opening the arm gripper while the fixed gripper holds the part",
    Once.RECEIVE: "closing the arm gripper on the part in the fixed gripper",
    Once.RELEASE_FIXED: "opening the fixed gripper while the arm gripper holds the part",
    Once.SORT: "releasing the part over its tray",
}


@dataclass(slots=True)
class PartFold:
    """Takes the rows of one part in order; `report` returns the result."""

    number: int
    start: datetime | None = None
    end: datetime | None = None
    looks: int = 0
    table_pictures: Mapping[str, str] = field(default_factory=dict)
    sightings: tuple[SightingReport, ...] = ()
    plan: rows.PlanMade | None = None
    steps: list[StepReport] = field(default_factory=list)
    grasps_missed: list[str] = field(default_factory=list)
    views: list[ViewReport] = field(default_factory=list)
    characteristics: tuple[rows.CharacteristicFields, ...] = ()
    # None where findings are known view by view only
    findings: tuple[rows.PartFindingFields, ...] | None = None
    verdict: rows.PartJudged | None = None
    tray: str | None = None
    nest: int | None = None
    custody: Custody = Custody.ON_TABLE
    custody_detail: str = ""
    resumed: rows.PartResumed | None = None
    followed: rows.PartFollowed | None = None
    # by a row of this run, not as every part begins
    is_custody_known: bool = False
    identified: rows.PartIdentified | None = None
    left: list[rows.PartLeft] = field(default_factory=list)
    reviews: list[ReviewReport] = field(default_factory=list)
    # Intents since the last change of custody, and whether an outcome followed.
    pending: dict[str, bool] = field(default_factory=dict)

    def take(self, row: Body | None, at: datetime | None = None) -> None:
        """Take one row; rows of other kinds are skipped.

        Parameters
        ----------
        row : content of the row
        at : time of the row; None to omit it
        """
        if at is not None:
            if isinstance(row, rows.PartReviewed):
                self.reviews.append(_review(row, at))
                return
            if isinstance(row, rows.PartFollowed):
                self._follow(row)
                return
            self.start, self.end = self.start or at, at
        match row:
            case rows.PartResumed():
                self.resumed = row
            case rows.PartIdentified():
                self.identified = row
            case rows.PartLeft():
                self.left.append(row)
            case rows.TablePictures():
                self.looks += 1
                self.table_pictures = row.root
            case rows.PartStored():
                self.nest = row.part.nest + 1
            case rows.Sightings():
                taken, _ = row.parted()
                self.sightings = tuple(_sighting(s, is_taken=s is taken) for s in row.sightings)
            case rows.PlanMade():
                self.plan, self.steps = row, []
            case rows.StepDone():
                self.steps.append(_step(row))
            case rows.GraspMissed():
                self.grasps_missed.append(row.message)
            case rows.ViewPicturesTaken():
                self.views.append(ViewReport(row.view, row.pictures, None))
            case rows.ViewJudged():
                self._judged(row)
            case rows.PartMeasured():
                self.characteristics = row.characteristics
            case rows.PartFindings():
                self.findings = row.findings
            case rows.PartJudged():
                self.verdict = row
            case rows.CustodyChanged():
                self.custody = Custody.of_key(row.name)
                self.custody_detail = row.detail
                self.is_custody_known = True
                self.pending.clear()
                if self.custody is Custody.PLACED:
                    self.tray = row.detail
            case rows.Intent():
                self.pending[row.name] = False
            case rows.OnceDone() if row.name in self.pending:
                self.pending[row.name] = True

    def _follow(self, row: rows.PartFollowed) -> None:
        self.followed = row
        self.pending.clear()
        if row.custody:
            self.custody = Custody.of_key(row.custody)
            self.custody_detail = f"run {row.run}"

    def _is_counted(self, *, is_ended_early: bool) -> bool:
        """Return whether this run has the part's record, and not another run that went on with it.

        A part still on the table when its run is interrupted or stopped is sought anew by the next
        run, which gives it a record of its own. The same holds for a run that was killed while it
        took a part over, before it had its custody.
        """
        if not rows.has_record(self.followed, self.resumed, is_custody_known=self.is_custody_known):
            return False
        is_on_table = self.custody is Custody.ON_TABLE and not self.pending
        is_judged = self.verdict is not None or bool(self.characteristics)
        return is_judged or not (is_ended_early and is_on_table)

    def _judged(self, row: rows.ViewJudged) -> None:
        first = 1 + sum(len(view.findings) for view in self.views)
        judged = _view(row, first)
        for i, view in enumerate(self.views):
            if view.view == judged.view and view.evaluated is None:
                self.views[i] = replace(judged, pictures=view.pictures)
                return
        self.views.append(judged)

    def report(self, *, is_cut_off: bool, is_ended_early: bool = False) -> PartReport:
        """Return the report of the part.

        Parameters
        ----------
        is_cut_off : the journal just stops, so that an outcome proves nothing without the change
            of custody after it
        is_ended_early : the run was cut off or stopped
        """
        ambiguity = [
            name for name, has_outcome in self.pending.items() if is_cut_off or not has_outcome
        ]
        return PartReport(
            number=self.number,
            looks=self.looks,
            table_pictures=self.table_pictures,
            sightings=self.sightings,
            plan=self.plan,
            steps=self._all_steps(),
            grasps_missed=tuple(self.grasps_missed),
            views=_with_findings(self.views, self.findings),
            verdict=self.verdict,
            tray=self.tray,
            nest=self.nest,
            custody=self.custody,
            custody_detail=self.custody_detail,
            unconfirmed=_unconfirmed(ambiguity[-1], self.custody) if ambiguity else "",
            characteristics=self.characteristics,
            resumed=self.resumed,
            followed=self.followed,
            is_counted=self._is_counted(is_ended_early=is_ended_early or is_cut_off),
            start=self.start,
            end=self.end,
            identified=self.identified,
            left=tuple(self.left),
            reviews=tuple(self.reviews),
        )

    def _all_steps(self) -> tuple[StepReport, ...]:
        """Return the steps done, then the rest of the plan."""
        if self.plan is None:
            return tuple(self.steps)
        # the plan's last entry is parking, which is not timed as a step
        planned = zip(self.plan.steps[:-1], self.plan.seconds[:-1], strict=True)
        rest = tuple(StepReport(label, seconds, None) for label, seconds in planned)
        return (*self.steps, *rest[len(self.steps) :])


def _unconfirmed(name: str, custody: Custody) -> str:
    doing = ONCE_WORDS.get(name, name.replace("_", " "))
    return (
        f"{doing} was begun, and the journal does not say what came of it; the last certain entry "
        f"is “{custody.value}”. Look before anything moves."
    )


def _review(row: rows.PartReviewed, at: datetime) -> ReviewReport:
    words = {one.number: one.word for one in row.findings}
    return ReviewReport(at, row.verdict, row.who, row.why, row.machine, words)


def _sighting(s: rows.SightingFields, *, is_taken: bool) -> SightingReport:
    return SightingReport(
        part=s.part,
        pose_index=s.pose_index,
        x_mm=s.x_mm,
        y_mm=s.y_mm,
        theta_deg=s.theta_deg,
        score=s.score,
        sigma_mm=s.sigma_mm,
        sigma_deg=s.sigma_deg,
        residual_px=s.residual_px,
        box_px=s.box_px,
        ambiguous_with=tuple(
            f"{a.part}, pose {a.pose_index}, {a.theta_deg:.1f} deg" for a in s.ambiguous_with
        ),
        reason=s.reason,
        is_taken=is_taken,
    )


def _step(row: rows.StepDone) -> StepReport:
    return StepReport(
        label=row.label,
        forecast_s=row.forecast_s,
        actual_s=row.seconds,
        view=row.view,
        tray=row.tray,
        jaw_mm=row.jaw_mm,
        expected_mm=row.expected_mm,
    )


def _view(row: rows.ViewJudged, first: int) -> ViewReport:
    return ViewReport(
        view=row.view,
        pictures={},
        evaluated=row.evaluated,
        reason=row.reason,
        # a view that was not evaluated has no measured pose, only zeros
        shift_mm=row.shift_mm if row.evaluated else None,
        turn_deg=row.turn_deg if row.evaluated else None,
        residual_px=row.residual_px,
        outline_px=row.outline_px,
        findings=tuple(
            FindingReport(
                number=number,
                view=row.view,
                kind=f.kind,
                lamp=f.lamp,
                area_mm2=f.area_mm2,
                size_mm=f.size_mm,
                at_px=f.at_px,
                box_px=f.box_px,
                p_part_mm=f.p_part_mm,
                faces=f.faces,
            )
            for number, f in enumerate(row.findings, start=first)
        ),
        checks=row.checks,
        T_world_part=row.T_world_part if row.evaluated else (),
    )


def _with_findings(
    views: Sequence[ViewReport], findings: Sequence[rows.PartFindingFields] | None
) -> tuple[ViewReport, ...]:
    """Return the views with the findings of the whole part in place of their own."""
    if findings is None:
        return tuple(views)
    of_view: dict[str, list[FindingReport]] = {view.view: [] for view in views}
    own = {
        (f.view, f.lamp, tuple(round(v, 1) for v in f.p_part_mm)): f
        for view in views
        for f in view.findings
    }
    for number, f in enumerate(findings, start=1):
        seen = own.get((f.view, f.lamp, tuple(round(v, 1) for v in f.p_part_mm)))
        of_view.setdefault(f.view, []).append(
            FindingReport(
                number=number,
                view=f.view,
                kind=f.kind,
                lamp=f.lamp,
                area_mm2=f.area_mm2 if f.area_mm2 is not None or not seen else seen.area_mm2,
                size_mm=f.size_mm,
                at_px=f.at_px or (seen.at_px if seen else _middle(f.box_px)),
                box_px=f.box_px or (seen.box_px if seen else None),
                p_part_mm=f.p_part_mm,
                faces=f.faces,
                verdict=f.verdict,
                outline_px=f.outline_px,
                pictures=f.pictures,
            )
        )
    known = [replace(view, findings=tuple(of_view.pop(view.view, ()))) for view in views]
    # a finding of all views together may name none of them
    return (*known, *(ViewReport(name, {}, None, findings=tuple(f)) for name, f in of_view.items()))


def _middle(box: tuple[int, int, int, int] | None) -> tuple[float, float] | None:
    return None if box is None else ((box[0] + box[2]) / 2, (box[1] + box[3]) / 2)
