"""Folds the journal rows of one part: looks, plan, steps, views, verdict, custody."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from controller.cell.custody import Custody

from ._model import (
    CheckReport,
    FaceReport,
    FindingReport,
    LogEntry,
    PartReport,
    PlanReport,
    SightingReport,
    StepReport,
    UnseenReport,
    VerdictReport,
    ViewReport,
)

Body = Mapping[str, Any]
# what is never repeated blindly, in the words of somebody who has to look where the part is
ONCE_WORDS = {
    "grip": "closing the hand on the part on the table",
    "hand_off": "closing the fixed gripper on the part",
    "release": "opening the hand while the fixed gripper holds the part",
    "take_back": "closing the hand on the part in the fixed gripper",
    "fixture_release": "opening the fixed gripper while the hand holds the part",
    "sort": "letting the part go over its tray",
}


@dataclass(slots=True)
class PartFold:
    """Takes the rows of one part in order; `report` tells what they add up to."""

    number: int
    looks: int = 0
    table_pictures: Mapping[str, str] = field(default_factory=dict)
    sightings: tuple[SightingReport, ...] = ()
    plan: PlanReport | None = None
    steps: list[StepReport] = field(default_factory=list)
    grips_missed: list[str] = field(default_factory=list)
    views: list[ViewReport] = field(default_factory=list)
    verdict: VerdictReport | None = None
    tray: str | None = None
    custody: Custody = Custody.ON_TABLE
    custody_detail: str = ""
    # intents since the last word on custody, and whether an outcome followed
    pending: dict[str, bool] = field(default_factory=dict)

    def take(self, entry: LogEntry) -> None:
        """Take one row."""
        body = entry.body
        match entry.kind, entry.name:
            case "observation", "table_pictures":
                self.looks += 1
                self.table_pictures = {str(k): str(v) for k, v in body.items()}
            case "observation", "sightings":
                self.sightings = tuple(_sighting(s) for s in body["sightings"])
            case "decision", "plan":
                self.plan, self.steps = _plan(body), []
            case "outcome", "step":
                self.steps.append(_step(body))
            case "outcome", "grip_missed":
                self.grips_missed.append(str(body["message"]))
            case "observation", "view_pictures":
                pictures = {str(k): str(v) for k, v in body["pictures"].items()}
                self.views.append(ViewReport(str(body["view"]), pictures, None))
            case "observation", "view":
                self._judged(body)
            case "decision", "verdict":
                self.verdict = _verdict(body)
            case "custody", name:
                self.custody = Custody.__members__.get(name.upper(), Custody.UNKNOWN)
                self.custody_detail = str(body.get("detail", ""))
                self.pending.clear()
                if self.custody is Custody.PLACED:
                    self.tray = self.custody_detail
            case "intent", name:
                self.pending[name] = False
            case "outcome", name if name in self.pending:
                self.pending[name] = True

    def _judged(self, body: Body) -> None:
        first = 1 + sum(len(view.findings) for view in self.views)
        judged = _view(body, first)
        for i, view in enumerate(self.views):
            if view.view_id == judged.view_id and view.evaluated is None:
                self.views[i] = replace(judged, pictures=view.pictures)
                return
        self.views.append(judged)

    def report(self, *, is_cut_off: bool) -> PartReport:
        """Return all that is known of the part.

        Parameters
        ----------
        is_cut_off : the journal just stops, so that an outcome without its change of custody
            proves nothing either
        """
        doubt = [
            name for name, has_outcome in self.pending.items() if is_cut_off or not has_outcome
        ]
        return PartReport(
            number=self.number,
            looks=self.looks,
            table_pictures=self.table_pictures,
            sightings=self.sightings,
            plan=self.plan,
            steps=self._all_steps(),
            grips_missed=tuple(self.grips_missed),
            views=tuple(self.views),
            verdict=self.verdict,
            tray=self.tray,
            custody=self.custody,
            custody_detail=self.custody_detail,
            in_doubt=_doubt(doubt[-1], self.custody) if doubt else "",
        )

    def _all_steps(self) -> tuple[StepReport, ...]:
        """Return the steps done, then those the plan still had."""
        if self.plan is None:
            return tuple(self.steps)
        # the plan's last entry is the way to the parking place, which is not timed as a step
        planned = zip(self.plan.labels[:-1], self.plan.seconds[:-1], strict=True)
        rest = tuple(StepReport(label, seconds, None) for label, seconds in planned)
        return (*self.steps, *rest[len(self.steps) :])


def _doubt(name: str, custody: Custody) -> str:
    doing = ONCE_WORDS.get(name, name.replace("_", " "))
    return (
        f"{doing} was begun, and the journal does not say what came of it; the last sure word is "
        f"“{custody.value}”. Look before anything moves."
    )


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) else None


def _box(values: Any) -> tuple[int, int, int, int]:  # noqa: ANN401 - from JSON
    x0, y0, x1, y1 = (round(v) for v in values)
    return x0, y0, x1, y1


def _sighting(s: Body) -> SightingReport:
    others = tuple(
        f"{a['part']}, pose {a['pose_index']}, {a['theta_deg']:.1f} deg"
        for a in s.get("ambiguous_with", ())
    )
    return SightingReport(
        part=s["part"],
        pose_index=int(s["pose_index"]),
        x_mm=float(s["x_mm"]),
        y_mm=float(s["y_mm"]),
        theta_deg=float(s["theta_deg"]),
        score=float(s["score"]),
        sigma_mm=_number(s.get("sigma_mm")),
        sigma_deg=_number(s.get("sigma_deg")),
        residual_px=_number(s.get("residual_px")),
        box_px=_box(s["box_px"]),
        ambiguous_with=others,
        reason=str(s.get("reason", "")),
    )


def _plan(body: Body) -> PlanReport:
    return PlanReport(
        labels=tuple(str(label) for label in body["steps"]),
        seconds=tuple(float(s) for s in body["seconds"]),
        forecast_s=float(body["forecast_s"]),
        covered_fraction=float(body["covered_fraction"]),
        reachable_fraction=float(body["reachable_fraction"]),
        unseen=tuple(
            UnseenReport(int(u["face"]), float(u["area_fraction"]), str(u["reason"]))
            for u in body.get("unseen", ())
        ),
    )


def _step(body: Body) -> StepReport:
    return StepReport(
        label=str(body["label"]),
        forecast_s=_number(body.get("forecast_s")),
        actual_s=_number(body.get("seconds")),
        view=str(body.get("view", "")),
        tray=str(body.get("tray", "")),
        jaw_mm=_number(body.get("jaw_mm")),
        expected_mm=_number(body.get("expected_mm")),
    )


def _view(body: Body, first: int) -> ViewReport:
    view_id, evaluated = str(body["view"]), bool(body["evaluated"])
    findings = tuple(
        FindingReport(
            number=number,
            view_id=view_id,
            kind=str(f["kind"]),
            lamp=str(f["lamp"]),
            area_mm2=float(f["area_mm2"]),
            size_mm=float(f["size_mm"]),
            at_px=(float(f["at_px"][0]), float(f["at_px"][1])),
            box_px=_box(f["box_px"]),
            p_part_mm=tuple(float(v) for v in f["p_part_mm"]),
            face_ids=tuple(int(i) for i in f["faces"]),
        )
        for number, f in enumerate(body.get("findings", ()), start=first)
    )
    return ViewReport(
        view_id=view_id,
        pictures={},
        evaluated=evaluated,
        reason=str(body.get("reason", "")),
        # a view that is not evaluated has no measured pose; its zeros mean nothing
        shift_mm=_number(body.get("shift_mm")) if evaluated else None,
        turn_deg=_number(body.get("turn_deg")) if evaluated else None,
        residual_px=_number(body.get("residual_px")),
        outline_px=tuple((float(x), float(y)) for x, y in body.get("outline_px", ())),
        findings=findings,
        checks=tuple(
            CheckReport(
                check=str(c["check"]),
                reason=str(c["reason"]),
                compared_samples=int(c["compared_samples"]),
                size_mm=float(c["size_mm"]),
                length_mm=float(c["length_mm"]),
            )
            for c in body.get("checks", ())
        ),
    )


def _verdict(body: Body) -> VerdictReport:
    return VerdictReport(
        verdict=str(body["verdict"]),
        reasons=tuple(str(reason) for reason in body["reasons"]),
        covered_fraction=float(body["covered_fraction"]),
        faces=tuple(
            FaceReport(
                face_id=int(f["face"]),
                label=str(f["label"]),
                area_mm2=float(f["area_mm2"]),
                seen_fraction=float(f["seen_fraction"]),
                verdict=str(f["verdict"]),
                views=tuple(str(v) for v in f["views"]),
                reason=str(f["reason"]),
                by_check={str(k): float(v) for k, v in f.get("by_check", {}).items()},
                rest={str(k): float(v) for k, v in f.get("rest", {}).items()},
            )
            for f in body["faces"]
        ),
        in_sight_fraction=_number(body.get("in_sight_fraction")),
        claim=str(body.get("claim", "")),
    )
