"""From views to a verdict: per surface, per part. No pass with a surface nobody can account for."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controller.cad import Solid, SurfaceSamples

from ._types import Finding, Limits, Verdict, ViewResult

SURE_AREA = 2.5  # a finding this many times the smallest area stands alone
SAME_PLACE_MM = 6.0  # findings of two views this close are one thing


@dataclass(frozen=True, slots=True)
class FaceVerdict:
    """What is known of one surface.

    Attributes
    ----------
    face_id, label : which
    area_mm2 : its area
    seen_fraction : of its samples, over all evaluated views
    verdict : outcome
    views : views that showed any of it
    reason : why it failed or was not seen
    """

    face_id: int
    label: str
    area_mm2: float
    seen_fraction: float
    verdict: Verdict
    views: tuple[str, ...]
    reason: str


@dataclass(frozen=True, slots=True)
class PartVerdict:
    """The verdict on one part.

    Attributes
    ----------
    verdict : outcome
    reasons : sentences, most important first
    faces : one entry per surface; their areas add up to the whole
    covered_fraction : of the whole area, seen in evaluated views
    confirmed : findings that decided
    """

    verdict: Verdict
    reasons: tuple[str, ...]
    faces: tuple[FaceVerdict, ...]
    covered_fraction: float
    confirmed: tuple[tuple[str, Finding], ...]


def judge(
    solid: Solid,
    samples: SurfaceSamples,
    views: Sequence[ViewResult],
    unseen_reasons: Mapping[int, str],
    min_coverage: float,
    limits: Limits,
) -> PartVerdict:
    """Weigh all views of a part.

    Parameters
    ----------
    unseen_reasons : by face id, why the plan could not show (all of) it
    min_coverage : share of the area that must have been seen for a pass
    """
    evaluated = [view for view in views if view.evaluated]
    shown = np.zeros(len(samples.points_mm), dtype=bool)
    for view in evaluated:
        shown |= view.seen
    covered = float(samples.areas_mm2[shown].sum() / samples.areas_mm2.sum())
    confirmed, doubtful = _confirm(evaluated, limits)
    found = dict.fromkeys((i for _, f in doubtful for i in f.face_ids), Verdict.INDETERMINATE)
    found |= dict.fromkeys((i for _, f in confirmed for i in f.face_ids), Verdict.FAIL)
    faces = tuple(
        _face(solid, samples, i, shown, evaluated, found.get(i), unseen_reasons, limits)
        for i in range(len(solid.faces))
    )
    reasons: list[str] = [_sentence(solid, view_id, f) for view_id, f in confirmed]
    unexplained = [f for f in faces if f.verdict is Verdict.NOT_EVALUATED and not f.reason]
    failed_views = [v for v in views if not v.evaluated]
    if confirmed:
        verdict = Verdict.FAIL
    elif doubtful:
        verdict = Verdict.INDETERMINATE
        reasons += [f"doubtful: {_sentence(solid, view_id, f)}" for view_id, f in doubtful]
    elif covered < min_coverage or unexplained or not evaluated:
        verdict = Verdict.INDETERMINATE
        reasons.append(
            f"{100 * covered:.1f} % of the surface seen, {100 * min_coverage:.1f} % is asked"
        )
        reasons += [f"{f.label}: not seen, and the plan gives no reason" for f in unexplained]
    else:
        verdict = Verdict.PASS
        reasons.append(
            f"{100 * covered:.1f} % of the surface seen in {len(evaluated)} views, no difference "
            f"of {limits.smallest_defect_mm:g} mm or more"
        )
    reasons += [f"view {v.view_id} not evaluated: {v.reason}" for v in failed_views]
    return PartVerdict(verdict, tuple(reasons), faces, covered, tuple(confirmed))


def _confirm(
    views: Sequence[ViewResult], limits: Limits
) -> tuple[list[tuple[str, Finding]], list[tuple[str, Finding]]]:
    """Split findings into those that decide and those nobody else saw."""
    every = [(view.view_id, f) for view in views for f in view.findings]
    sure: list[tuple[str, Finding]] = []
    doubtful: list[tuple[str, Finding]] = []
    for view_id, finding in every:
        seconded = any(
            (other_id, other.lamp) != (view_id, finding.lamp)
            and np.linalg.norm(other.p_part_mm - finding.p_part_mm) < SAME_PLACE_MM
            for other_id, other in every
        )
        large = finding.area_mm2 >= SURE_AREA * limits.min_area_mm2
        (sure if large or seconded else doubtful).append((view_id, finding))
    sure.sort(key=lambda item: -item[1].area_mm2)
    return sure, doubtful


def _sentence(solid: Solid, view_id: str, finding: Finding) -> str:
    where = " and ".join(solid.faces[i].label for i in finding.face_ids[:2])
    return (
        f"{finding.kind} at {where}: {finding.size_mm:.1f} mm across, {finding.area_mm2:.0f} mm2, "
        f"view {view_id}, {finding.lamp}"
    )


def _face(
    solid: Solid,
    samples: SurfaceSamples,
    face_id: int,
    shown: NDArray[np.bool_],
    views: Sequence[ViewResult],
    found: Verdict | None,
    unseen_reasons: Mapping[int, str],
    limits: Limits,
) -> FaceVerdict:
    face = solid.faces[face_id]
    mine = samples.face_ids == face_id
    fraction = float(shown[mine].mean()) if mine.any() else 0.0
    by = tuple(v.view_id for v in views if (v.seen & mine).any())
    reason = unseen_reasons.get(face_id, "")
    verdict = Verdict.NOT_EVALUATED
    if found is Verdict.FAIL:
        verdict, reason = found, "differs from the CAD"
    elif found is not None:
        verdict, reason = found, "may differ from the CAD: one weak finding"
    elif fraction >= 0.5:
        rest = reason or f"{100 * (1 - fraction):.0f} % of it in no view that was evaluated"
        verdict, reason = Verdict.PASS, "" if fraction > 0.98 else rest
    elif not reason and _is_beside_hand(views, mine & ~shown):
        reason = "too near to the hand to be compared wherever it was in sight"
    elif not reason and face.area_mm2 < limits.min_area_mm2:
        reason = "smaller than the smallest difference looked for"
    return FaceVerdict(face_id, face.label, face.area_mm2, fraction, verdict, by, reason)


def _is_beside_hand(views: Sequence[ViewResult], unseen: NDArray[np.bool_]) -> bool:
    """Whether most of some samples were in sight, but so near to the hand that nobody compared."""
    beside = np.zeros_like(unseen)
    for view in views:
        if len(view.beside_hand) == len(beside):
            beside |= view.beside_hand
    return bool(unseen.any() and beside[unseen].mean() >= 0.5)
