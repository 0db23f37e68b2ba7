"""Coverage ledger: all surface, compared or not, with the reasons; and the sums of the time line.

All values are plain numbers from a `PartReport`; shares are in percent.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from controller.cell.journal.rows import FaceJudged

from ..run import PartReport, StepReport

NO_REASON = "planned to be shown, but no evaluated view compared it"
DECIMALS = 2
# What would compare more, by the beginning of a reason; the most usual means first.
MEANS = {
    "beside the gripper": "a grasp elsewhere",
    "seen too flat": "a view more square to it; a finer camera",
    "turned from the lamps": "a lamp from another side",
    "at the border of a shadow": "learning from good parts; a lamp from another side",
    "lit by light from neighbouring": "learning from good parts",
    "where the lamp's highlight": "learning from good parts; a lamp from another side",
    "a finish too uneven": "a larger `smallest_defect_mm`; learning from good parts",
    "lit in a way": "learning from good parts; another lamp or view",
    "too near to an edge": "a finer camera",
    "in pictures that failed": "the next part; the view's own reason says what failed",
    "on the code": "a code on another face",
    "left out": "a smaller `least_gain`",
}


@dataclass(frozen=True, slots=True)
class LedgerRow:
    """A surface and its share of the whole area [%]."""

    face: FaceJudged
    share_percent: float


@dataclass(frozen=True, slots=True)
class Ledger:
    """All surfaces; the rounded shares of surfaces and of classes each add up to 100 %.

    Attributes
    ----------
    classes : name, words and share of the whole area of each class
    not_compared : by reason for no comparison, share of the whole area and what would compare more
        (empty where nothing in this cell does), largest first
    """

    rows: tuple[LedgerRow, ...]
    area_mm2: float
    share_percent: float
    compared_percent: float
    classes: tuple[tuple[str, str, float], ...]
    not_compared: tuple[tuple[str, float, str], ...]


def rounded_to_whole(shares: Sequence[float], whole: float = 100.0) -> list[float]:
    """Return shares rounded to a sum of ``whole``: the largest remainders are rounded up."""
    unit = 10**DECIMALS
    lower_bounds = [int(share * unit) for share in shares]
    missing = round(whole * unit) - sum(lower_bounds)
    order = sorted(range(len(shares)), key=lambda i: lower_bounds[i] - shares[i] * unit)
    for i in order[: max(missing, 0)]:
        lower_bounds[i] += 1
    return [floor / unit for floor in lower_bounds]


def make_ledger(part: PartReport) -> Ledger | None:
    """Return the ledger of a judged part; None for one without a verdict."""
    if part.verdict is None or not part.verdict.faces:
        return None
    faces = part.verdict.faces
    total = sum(face.area_mm2 for face in faces)
    if total <= 0:
        return None
    exact = [100 * face.area_mm2 / total for face in faces]
    shares = rounded_to_whole(exact)
    rows = []
    classes = dict.fromkeys(("pass", "fail", "compared", "not-compared"), 0.0)
    not_compared: dict[str, float] = {}
    for face, share, whole in zip(faces, shares, exact, strict=True):
        compared = whole * face.compared_fraction
        rows.append(LedgerRow(face, share))
        classes[face.verdict if face.verdict in classes else "compared"] += compared
        classes["not-compared"] += whole - compared
        if face.compared_fraction < 1:
            for reason, share in (face.rest or {_why_not_compared(part, face): 1.0}).items():
                part_of = share / (sum(face.rest.values()) or 1.0)
                not_compared[reason] = not_compared.get(reason, 0.0) + (whole - compared) * part_of
    words = {
        "pass": "compared, agrees with the CAD",
        "fail": "compared, on a surface that differs from the CAD",
        "compared": "compared, too little of the surface to judge it, or unconfirmed",
        "not-compared": "not compared",
    }
    class_shares = rounded_to_whole(list(classes.values()))
    return Ledger(
        rows=tuple(rows),
        area_mm2=total,
        share_percent=sum(shares),
        compared_percent=100 - class_shares[3],
        classes=tuple(
            (name, words[name], share) for name, share in zip(classes, class_shares, strict=True)
        ),
        not_compared=tuple(
            (reason, share, means_of(reason))
            for reason, share in sorted(not_compared.items(), key=lambda item: -item[1])
        ),
    )


def means_of(reason: str) -> str:
    """Return what would compare more of a surface, by the reason why it was not; else ""."""
    return next((means for start, means in MEANS.items() if reason.startswith(start)), "")


def _why_not_compared(part: PartReport, face: FaceJudged) -> str:
    planned = [u for u in (part.plan.unseen if part.plan else ()) if u.face == face.face]
    if planned:
        return max(planned, key=lambda u: u.area_fraction).reason or NO_REASON
    return face.reason if face.reason and face.verdict != "fail" else NO_REASON


@dataclass(frozen=True, slots=True)
class Timing:
    """Sums over finished steps [cell s], and the step that exceeded its forecast most."""

    done: int
    forecast_s: float
    actual_s: float
    longest_s: float
    worst: int | None
    sentence: str


def make_timing(steps: Sequence[StepReport]) -> Timing:
    """Return the sums over steps; the worst step is the farthest above its forecast."""
    done = [
        (i, s.forecast_s, s.actual_s)
        for i, s in enumerate(steps)
        if s.actual_s is not None and s.forecast_s is not None
    ]
    longest = max([s for step in steps for s in (step.forecast_s, step.actual_s) if s] or [1.0])
    forecast, actual = sum(f for _, f, _ in done), sum(a for _, _, a in done)
    if not done:
        return Timing(0, 0.0, 0.0, longest, None, "No step was finished.")
    worst, f, a = max(done, key=lambda item: item[2] - item[1])
    what = f"step {worst + 1}, {steps[worst].label}: {a:.1f} s, forecast {f:.1f} s ({a - f:+.1f} s)"
    if a > f:
        sentence = f"Worst against its forecast: {what}."
    else:
        sentence = f"No step took longer than its forecast; the closest was {what}."
    return Timing(len(done), forecast, actual, longest, worst, sentence)
