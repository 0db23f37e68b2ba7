"""Verdicts on surfaces and on the part. A surface that no check compared is not inspected.

A pass needs every surface compared for the greater part, or named by the recipe as not inspected,
or shown by its edges where there is no room for a comparison (docs/adr/0034); every failed
self-check made good by another view; and no finding. A fail needs two looks that one error cannot
explain. All else is indeterminate, with the reasons (docs/adr/0017).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from controller.arrays import BoolArray, FloatArray
from controller.cad import Solid, SurfaceSamples, count_caution, uncertainty_of
from messages import joined, key, say

from ._apart import SAME_PIXELS_PX, is_turned
from ._gathered import PlacedFinding, gather
from ._types import (
    OUTLINE,
    Finding,
    FindingKind,
    InspectionLimits,
    Unjudged,
    Verdict,
    ViewResult,
)
from .detection import MARKS, NEXT_WIDTH, NOTHING_ASKED, Detection
from .edge_evidence import EdgeEvidence, FaceEdges
from .limits import MIN_FACE_SHARE

# Area, in smallest areas, above which a finding cannot be noise at a border.
SURE_AREA: Final = 2.5
# Distance between the centres of two views' findings below which both are the same thing.
SAME_PLACE_MM: Final = 6.0
SAME_PLACE_SHARE: Final = 0.25  # distance added, as a share of their sizes
# Misfit below which surface finish cannot explain a lit picture's findings.
EVEN_MISFIT: Final = 0.12
# The same for marks: the errors of two poses, and of the centre of the visible portion.
MARK_PLACE_MM: Final = 1.0
MARK_PLACE_SHARE: Final = 0.35
# `SAME_PIXELS_PX` as a share of a mark's extent; the part's outline may cut the mark.
SAME_PIXELS_SHARE: Final = 0.25
# Least turn of a dent's bright side from one lamp to the other.
OTHER_SIDE_RAD: Final = float(np.radians(60.0))
# Number of looks that would have shown a mark and did not, from which it is a reflection.
SEEN_AGAIN_COUNT: Final = 2
# Kinds that several looks together do not prove: an edge in place may hide in all pictures.
UNPROVEN: Final = {FindingKind.MISSING_EDGE}
# Strength, in limits of texture, above which a mark is never taken for a reflection.
PLAIN: Final = 3.0
# Share of a failed view's surface that other views must have in sight to make up for it.
MADE_GOOD_SHARE: Final = 0.99
NO_VIEW: Final = key("in no view that was evaluated")
TOO_SMALL: Final = key(
    "smaller than the smallest difference looked for, which cannot be on it alone"
)
GIVEN_UP: Final = key(
    "a face that is left out by name (`not_inspected`) is given up: dents, scratches and stains on "
    "it are looked for by nobody; what pictures show against it counts all the same"
)
NOTHING: Final[Mapping[int, str]] = MappingProxyType({})
NO_PLAN: Final[Mapping[str, BoolArray]] = MappingProxyType({})
EDGES: Final = "edges"


@dataclass(frozen=True, slots=True)
class FaceVerdict:
    """Verdict on one surface.

    Attributes
    ----------
    face_id, label : number and name of the surface
    area_mm2 : its area
    compared_fraction : share of its samples that any check of any evaluated view compared
    verdict : outcome
    views : views that compared any of it
    reason : why it failed or was not compared
    by_check : share of its samples compared, by name of the check; under `EDGES` by the edges
        beside them, or where its edges verify it as a whole, the share of them that is in place
    rest : share of its samples not compared, by reason, largest first
    is_by_edges : True if its edges verify it, and too little of its surface was compared
    """

    face_id: int
    label: str
    area_mm2: float
    compared_fraction: float
    verdict: Verdict
    views: tuple[str, ...]
    reason: str
    by_check: tuple[tuple[str, float], ...] = ()
    rest: tuple[tuple[str, float], ...] = ()
    is_by_edges: bool = False


@dataclass(frozen=True, slots=True)
class PartVerdict:
    """Verdict on one part.

    Attributes
    ----------
    verdict : outcome
    reasons : sentences, most important first
    faces : one entry per surface; their areas add up to the whole
    compared_fraction : share of the whole area compared in evaluated views
    in_sight_fraction : share of the whole area in sight of these views, compared or not
    findings : differences from the CAD, place by place
    claim : coverage and limits of the checks, as a sentence without a subject
    detections : detectable size and place by kind of defect
    short_faces : ids of faces compared too little, which prevents a PASS
    compared_U : expanded uncertainty (k = 2) of `compared_fraction`, from the samples' spacing
    verified_fraction : share of what can be seen that is compared, or on a face that its edges
        verify; faces that the recipe leaves out count where they are compared, and codes not at all
    """

    verdict: Verdict
    reasons: tuple[str, ...]
    faces: tuple[FaceVerdict, ...]
    compared_fraction: float
    findings: tuple[PlacedFinding, ...]
    in_sight_fraction: float = 0.0
    claim: str = ""
    detections: tuple[Detection, ...] = ()
    short_faces: tuple[int, ...] = ()
    compared_U: float = 0.0  # noqa: N815 (U is the symbol of the field)
    verified_fraction: float = 0.0


def judge(
    solid: Solid,
    samples: SurfaceSamples,
    views: Sequence[ViewResult],
    unseen_reasons: Mapping[int, str],
    min_coverage: float,
    limits: InspectionLimits,
    not_inspected: Mapping[int, str] = NOTHING,
    planned: Mapping[str, BoolArray] = NO_PLAN,
    edges: EdgeEvidence | None = None,
    find_mm: Mapping[str, float] = NOTHING_ASKED,
) -> PartVerdict:
    """Return the verdict on a part, from all its views.

    Parameters
    ----------
    solid : the part
    samples : n samples of its surface, by which coverage is counted
    views : results of the views
    unseen_reasons : reason, by face id, why the plan could not show (all of) a face; it explains a
        gap and excuses none
    min_coverage : share of what can be seen that must have been verified for a pass, above 0; what
        can be seen is in sight of an evaluated view, or the plan meant a view to show it
    limits : limits of the findings
    not_inspected : reason, by face id, why the recipe leaves a face out: the face need not be
        compared, but findings on it still count
    planned : mask, by view id, of the samples (n,) that the plan meant the view to show
    edges : evidence from the part's edges; None for none
    find_mm : size to be found, by kind of defect, where the recipe names one

    Raises
    ------
    ValueError : `min_coverage` is not above 0, or above 1
    """
    if not 0 < min_coverage <= 1:
        raise ValueError(f"min_coverage {min_coverage}: a pass must rest on something, up to 1")
    evaluated = [view for view in views if view.evaluated]
    compared = _any(samples, (view.compared for view in evaluated))
    beside = _any(samples, iter([edges.compared] if edges is not None else []))
    compared |= beside
    in_sight = _any(samples, (view.in_sight for view in evaluated)) | compared
    compared_share, in_sight_share = (
        float(samples.areas_mm2[mask].sum() / samples.areas_mm2.sum())
        for mask in (compared, in_sight)
    )
    placed = gather(confirm(evaluated, samples, limits, find_mm))
    found: dict[int, PlacedFinding] = {}
    for one in placed:  # proven findings first
        found = dict.fromkeys(one.face_ids, one) | found
    excuses = _unjudged(samples, evaluated)
    faces = tuple(
        _face(
            solid, samples, i, compared, excuses, evaluated, found.get(i),
            unseen_reasons.get(i, ""), not_inspected.get(i, ""), limits, beside,
            None if edges is None else edges.faces.get(i),
        )
        for i in range(len(solid.faces))
    )  # fmt: skip
    is_asked = ~np.isin(samples.face_ids, list(not_inspected))
    is_asked &= excuses != Unjudged.CODE.number
    verified_share = _verified(samples, edges, compared, in_sight, planned, is_asked)
    claim = _claim(evaluated)
    short = [
        f
        for f in faces
        if f.verdict is Verdict.NOT_EVALUATED
        and f.face_id not in not_inspected
        and f.reason != TOO_SMALL
    ]
    stops = [
        *_too_little_verified(evaluated, verified_share, min_coverage),
        *_not_made_good(samples, views, planned),
        *_too_little(short),
    ]
    passed = say(
        "{compared_percent:.1f} % of the surface compared in {evaluated_count} views: {claim}",
        compared_percent=100 * compared_share,
        evaluated_count=len(evaluated),
        claim=claim,
    )
    verdict, reasons = _decided(solid, placed, stops, [passed, *_by_edges(faces)])
    reasons += [failure for view in views for failure in view.failures]
    reasons += _cautions(samples, faces, limits, not_inspected)
    return PartVerdict(
        verdict, tuple(reasons), faces, compared_share, placed, in_sight_share, claim,
        short_faces=tuple(f.face_id for f in short), compared_U=uncertainty_of(samples, compared),
        verified_fraction=verified_share,
    )  # fmt: skip


def _decided(
    solid: Solid, placed: Sequence[PlacedFinding], stops: Sequence[str], passed: Sequence[str]
) -> tuple[Verdict, list[str]]:
    """Return the verdict and its reasons: findings against the part first, whatever else is open.

    Parameters
    ----------
    solid : the part
    placed : all findings
    stops : what else stops a PASS, in sentences
    passed : what a PASS rests on, in sentences
    """
    failed = [one.sentence(solid) for one in placed if one.verdict is Verdict.FAIL]
    if failed:
        return Verdict.FAIL, failed
    if placed or stops:
        open_ones = (say("unconfirmed: {sentence}", sentence=one.sentence(solid)) for one in placed)
        return Verdict.INDETERMINATE, [*open_ones, *stops]
    return Verdict.PASS, list(passed)


def _too_little_verified(
    evaluated: Sequence[ViewResult], verified_share: float, min_coverage: float
) -> list[str]:
    """Return what stops a PASS: a share verified that is not what is required, as a sentence."""
    if evaluated and verified_share >= min_coverage:
        return []
    return [
        say(
            "{verified_percent:.1f} % of what can be seen is verified, "
            "{min_coverage_percent:.1f} % is required",
            verified_percent=100 * verified_share,
            min_coverage_percent=100 * min_coverage,
        )
    ]


def _too_little(short: Sequence[FaceVerdict]) -> list[str]:
    """Return what stops a PASS: faces compared too little, in sentences."""
    named = [
        say(
            "{label}: {compared_percent:.0f} % compared, {min_face_percent:.0f} "
            "% is required; {reason}",
            label=f.label,
            compared_percent=100 * f.compared_fraction,
            min_face_percent=100 * MIN_FACE_SHARE,
            reason=f.reason,
        )
        for f in short
    ]
    return [*named, GIVEN_UP] if named else []


def _by_edges(faces: Sequence[FaceVerdict]) -> list[str]:
    """Return a sentence on the faces that their edges verify; none where there are none."""
    by_edges = [f for f in faces if f.is_by_edges]
    if not by_edges:
        return []
    return [
        say(
            "{by_edges_count} of {faces_count} faces, {percent} of the "
            "surface, are verified by their edges, not by their surface",
            by_edges_count=len(by_edges),
            faces_count=len(faces),
            percent=_percent(by_edges, faces),
        )
    ]


def _cautions(
    samples: SurfaceSamples,
    faces: Sequence[FaceVerdict],
    limits: InspectionLimits,
    not_inspected: Mapping[int, str],
) -> list[str]:
    """Return what limits any verdict: sparse samples, and faces that the recipe leaves out."""
    out = []
    counted = count_caution(samples, limits.smallest_defect_mm)
    if counted:
        out.append(counted)
    if not_inspected:
        left = [f for f in faces if f.face_id in not_inspected]
        out.append(
            say(
                "the recipe leaves out {not_inspected_count} of {faces_count} "
                "faces, {percent} of the surface",
                not_inspected_count=len(not_inspected),
                faces_count=len(faces),
                percent=_percent(left, faces),
            )
        )
    return out


def _percent(some: Sequence[FaceVerdict], faces: Sequence[FaceVerdict]) -> str:
    share = sum(f.area_mm2 for f in some) / sum(f.area_mm2 for f in faces)
    return say("{percent:.1f} %", percent=100 * share)


def _verified(
    samples: SurfaceSamples,
    edges: EdgeEvidence | None,
    compared: BoolArray,
    in_sight: BoolArray,
    planned: Mapping[str, BoolArray],
    is_asked: BoolArray,
) -> float:
    """Return the share of what can be seen, and is asked for, that is verified (`PartVerdict`)."""
    can_be_seen = (in_sight | _any(samples, iter(planned.values()))) & is_asked | compared
    evidence = edges.faces if edges is not None else {}
    by_edges = np.isin(samples.face_ids, [i for i, one in evidence.items() if one.is_verified])
    whole = float(samples.areas_mm2[can_be_seen].sum())
    is_verified = (compared | by_edges) & can_be_seen
    return float(samples.areas_mm2[is_verified].sum()) / whole if whole else 0.0


def _any(samples: SurfaceSamples, masks: Iterator[BoolArray]) -> BoolArray:
    out = np.zeros(len(samples.points_mm), dtype=bool)
    for mask in masks:
        out |= mask
    return out


def _claim(views: Sequence[ViewResult]) -> str:
    """Return a sentence on the coverage and the limits of all checks combined."""
    made = [c for view in views for c in view.checks if not c.reason and c.compared.any()]
    outlines = [c for c in made if c.name == OUTLINE]
    lit = [c for c in made if c.name != OUTLINE]
    parts = []
    if outlines:
        parts.append(
            say(
                "no outline off by {size_mm:.1f} mm or more over {length_mm:.1f} "
                "mm, beyond the tolerances of its faces",
                size_mm=max(c.size_mm for c in outlines),
                length_mm=max(c.length_mm for c in outlines),
            )
        )
    if lit:
        parts.append(
            say(
                "no area of {size_mm:g} mm or more half as bright as predicted, or twice as bright",
                size_mm=max(c.size_mm for c in lit),
            )
        )
    if not parts:
        return key("no difference found")
    return joined("; ", parts)


def confirm(
    views: Sequence[ViewResult],
    samples: SurfaceSamples,
    limits: InspectionLimits,
    find_mm: Mapping[str, float],
) -> list[tuple[str, Finding, Verdict]]:
    """Return the findings that are proven or still open; refuted ones are left out.

    Parameters
    ----------
    views : evaluated views
    samples : samples of the surface
    limits : limits of the findings
    find_mm : size asked for, by kind of defect

    Returns
    -------
    view, finding and verdict of each
    """
    every = [(view, f) for view in views for f in view.findings]
    seconds = every + [(view, f) for view in views for f in view.hints]
    dirt = {id(f) for view, f in seconds if _is_on_lens(view, f, seconds)}
    seconds = [(view, f) for view, f in seconds if id(f) not in dirt]
    out: list[tuple[str, Finding, Verdict]] = []
    for view, finding in every:
        seconded = finding.is_sure or any(
            other is not finding
            and not {finding.kind, other.kind} & UNPROVEN
            and _is_other_look(view, finding, other_view, other, limits)
            and _is_same_place(finding, other)
            for other_view, other in seconds
        )
        if id(finding) not in dirt and seconded:
            out.append((view.view_id, finding, Verdict.FAIL))
        elif id(finding) in dirt or not _is_argued_away(
            view, finding, views, samples, _asked_mm(limits, find_mm)
        ):
            out.append((view.view_id, finding, Verdict.INDETERMINATE))
    return out


def _is_on_lens(
    view: ViewResult, finding: Finding, others: Sequence[tuple[ViewResult, Finding]]
) -> bool:
    """Return True if another pose shows something in the same pixels, elsewhere on the part.

    Dirt on the lens keeps its pixels as the part turns; a mark on a face leaves them. The depth of
    a finding at the outline is unknown, so only lit pictures can decide.
    """
    if not finding.kind.is_lit:
        return False
    x0, y0, x1, y1 = finding.box_px
    reach = max(SAME_PIXELS_PX, SAME_PIXELS_SHARE * float(np.hypot(x1 - x0, y1 - y0)))
    return any(
        other.kind.is_lit
        and _is_turned(view, other_view)
        and np.hypot(*np.subtract(finding.at_px, other.at_px)) <= reach
        and not _is_same_place(finding, other)
        for other_view, other in others
    )


def _is_turned(view: ViewResult, other: ViewResult) -> bool:
    """Return True if the part is turned between two evaluated views: another look."""
    T, T_other = view.T_world_part_measured, other.T_world_part_measured
    return T is not None and T_other is not None and is_turned(T, T_other)


def _asked_mm(limits: InspectionLimits, find_mm: Mapping[str, float]) -> float:
    """Return the smallest mark that the recipe asks to be found [mm]."""
    return min([limits.smallest_defect_mm, *(find_mm[kind] for kind in MARKS if kind in find_mm)])


def _is_argued_away(
    view: ViewResult,
    finding: Finding,
    views: Sequence[ViewResult],
    samples: SurfaceSamples,
    asked_mm: float,
) -> bool:
    """Return True if other looks would have shown a mark and did not: it is a reflection.

    A mark on the part keeps its place as the part turns. A dent may be invisible under one lamp, so
    more than one look is needed; a mark far stronger than any texture is never dismissed. A mark
    that appears smaller than the size asked for may be a larger one seen badly: looks that would
    have shown that size with a probability of 90 % refute it (ADR 79).
    """
    if not finding.kind.is_mark or finding.evidence >= PLAIN:
        return False
    kind = "scratch" if finding.is_long else "dent"
    enough_mm = finding.size_mm
    if not finding.is_long and finding.size_mm < asked_mm:
        enough_mm = max(enough_mm, asked_mm / NEXT_WIDTH)
        kind = "stain" if finding.kind is FindingKind.STAIN else kind
    nearest = int(np.argmin(np.linalg.norm(samples.points_mm - finding.p_part_mm, axis=1)))
    looks = 0
    for other in views:
        if not _is_turned(view, other):
            continue
        marks = [f for f in (*other.findings, *other.hints) if _is_same_place(finding, f)]
        for check in other.checks:
            widths = check.smallest_mm.get(kind)
            if widths is None or check.reason or any(f.lamp == check.name for f in marks):
                continue
            looks += bool(widths[nearest] <= enough_mm)
    return looks >= SEEN_AGAIN_COUNT


def _is_other_look(
    view: ViewResult,
    finding: Finding,
    other_view: ViewResult,
    other: Finding,
    limits: InspectionLimits,
) -> bool:
    """Return True if no single error explains two findings.

    Two lamps in one pose share the error of that pose and of its prediction. An error of the pose
    moves when the part is turned. An error in the light model of a finish does not, so two lit
    pictures decide only where both are predicted well all over. A mark is found against its own
    face, without the model; it decides with any other look at the turned part, except where both
    lie in the same pixels, as dirt on the lens does. Two lamps in one pose decide on a dent whose
    bright side turns with the lamp, and on a mark that no good part showed under either lamp.
    Outline and shading in one pose share only the pose, which both checks have confirmed. Together
    they decide where both findings are too large for a pose error within the limits.
    """
    if finding.kind.is_mark or other.kind.is_mark:
        if view.view_id == other_view.view_id:
            return _turns_with_the_lamp(finding, other) or _is_no_good_part(view, finding, other)
        away = np.hypot(*np.subtract(finding.at_px, other.at_px))
        is_other = _is_turned(view, other_view)
        return is_other and bool(away > SAME_PIXELS_PX)
    is_lit = finding.kind.is_lit and other.kind.is_lit
    if is_lit and max(_misfit(view, finding), _misfit(other_view, other)) > EVEN_MISFIT:
        return False  # the finish may cause the same in both views
    if _is_turned(view, other_view):
        return True
    least = SURE_AREA * limits.min_area_mm2
    is_both = finding.kind.is_lit != other.kind.is_lit
    return is_both and min(finding.area_mm2, other.area_mm2) >= least


def _turns_with_the_lamp(finding: Finding, other: Finding) -> bool:
    """Return True if the direction from a mark's dark to its bright side turns with the lamp."""
    if finding.lamp == other.lamp:
        return False
    lengths = [float(np.hypot(*f.dipole_px)) for f in (finding, other)]
    if min(lengths) == 0.0 or min(finding.evidence, other.evidence) < 1.0:
        return False
    cosine = float(np.dot(finding.dipole_px, other.dipole_px)) / (lengths[0] * lengths[1])
    return cosine < float(np.cos(OTHER_SIDE_RAD))


def _is_no_good_part(view: ViewResult, finding: Finding, other: Finding) -> bool:
    """Return True if two lamps show a mark that no good part showed there.

    The effects of light on good parts in this view are known, so a mark under two lamps is on the
    part.
    """
    lamps = {finding.lamp, other.lamp}
    learned = {c.name for c in view.checks if c.learned_from and not c.reason}
    return len(lamps) == 2 and lamps <= learned and min(finding.evidence, other.evidence) >= 1.0


def _misfit(view: ViewResult, finding: Finding) -> float:
    return max((c.misfit for c in view.checks if c.name == finding.lamp), default=0.0)


def _is_same_place(finding: Finding, other: Finding) -> bool:
    is_mark = finding.kind.is_mark and other.kind.is_mark
    mm, share = (MARK_PLACE_MM, MARK_PLACE_SHARE) if is_mark else (SAME_PLACE_MM, SAME_PLACE_SHARE)
    reach = mm + share * (finding.size_mm + other.size_mm)
    return bool(np.linalg.norm(other.p_part_mm - finding.p_part_mm) < reach)


def _not_made_good(
    samples: SurfaceSamples, views: Sequence[ViewResult], planned: Mapping[str, BoolArray]
) -> list[str]:
    """Return what stops a PASS: views with failed checks whose surface no other has in sight."""
    out: list[str] = []
    for view in views:
        if not view.failures:
            continue
        others = _any(samples, (v.in_sight for v in views if v is not view))
        if view.evaluated:
            others |= view.in_sight  # another lamp's picture of the same pose
            wanted = view.unobstructed if len(view.unobstructed) else view.compared
        else:
            wanted = planned.get(view.view_id, np.ones(len(samples.points_mm), dtype=bool))
        whole = float(samples.areas_mm2[wanted].sum())
        if whole and float(samples.areas_mm2[wanted & others].sum()) < MADE_GOOD_SHARE * whole:
            failed = say("view {view_id} failed", view_id=view.view_id)
            out.append(
                say("{view_id}: no other view made good what it was to show", view_id=failed)
            )
    return out


def _unjudged(samples: SurfaceSamples, views: Sequence[ViewResult]) -> NDArray[np.uint8]:
    """Return the reasons for samples in sight not compared, (n,), as in `ViewResult.unjudged`.

    Of several views, the one that came closest to a comparison counts: the latest reason in the
    order of `Unjudged`.
    """
    out = np.zeros(len(samples.points_mm), dtype=np.uint8)
    holder = Unjudged.HOLDER.number
    for view in views:
        if len(view.beside_gripper):
            out[view.beside_gripper & (out == 0)] = holder
        if len(view.unjudged):
            out = np.maximum(out, view.unjudged)
    return out


def _face(
    solid: Solid,
    samples: SurfaceSamples,
    face_id: int,
    compared: BoolArray,
    excuses: NDArray[np.uint8],
    views: Sequence[ViewResult],
    found: PlacedFinding | None,
    plan_reason: str,
    recipe_reason: str,
    limits: InspectionLimits,
    beside: BoolArray,
    edges: FaceEdges | None,
) -> FaceVerdict:
    face = solid.faces[face_id]
    mine = samples.face_ids == face_id
    areas = np.where(mine, samples.areas_mm2, 0.0)
    whole = float(areas.sum())
    fraction = float(areas[compared].sum() / whole) if whole else 0.0
    by = tuple(v.view_id for v in views if (v.compared & mine).any())
    rest = _rest(np.where(compared, 0.0, areas), whole, excuses, plan_reason or NO_VIEW)
    reason = rest[0][0] if rest else ""
    verdict = Verdict.NOT_EVALUATED
    by_check = _by_check(areas, views, beside)
    is_by_edges = False
    if found is not None and found.verdict is Verdict.FAIL:
        verdict, reason = found.verdict, key("differs from the CAD")
    elif found is not None:
        verdict = found.verdict
        reason = key("one comparison differs from the CAD, no second one confirms it")
    elif fraction >= MIN_FACE_SHARE:
        verdict = Verdict.PASS
        if rest:
            reason = say(
                "{percent:.0f} % of it not compared: {reason}",
                percent=100 * (1 - fraction),
                reason=reason,
            )
    elif recipe_reason:
        reason = say("left out by the recipe: {recipe_reason}", recipe_reason=recipe_reason)
    elif edges is not None and edges.is_verified:
        verdict, is_by_edges = Verdict.PASS, True
        by_check = (*(one for one in by_check if one[0] != EDGES), (EDGES, edges.share))
        reason = say(
            "surface not compared; {percent:.0f} % {how} in place",
            percent=100 * edges.share,
            how=edges.how,
        )
    elif face.area_mm2 < (limits.min_area_mm2 if face.concave else limits.defect_area_mm2):
        # a hole as small is asked for all the same, down to half of that
        reason = TOO_SMALL
    elif edges is not None and edges.why:
        # Light is no reason where edges could have shown a difference and did not.
        reason = edges.why
    return FaceVerdict(
        face_id, face.label, face.area_mm2, fraction, verdict, by, reason, by_check, rest,
        is_by_edges,
    )  # fmt: skip


def _by_check(
    areas: FloatArray, views: Sequence[ViewResult], beside: BoolArray
) -> tuple[tuple[str, float], ...]:
    """Return each check's compared share of a face; areas (n,) are 0 off the face."""
    mine, compared = areas > 0.0, dict[str, BoolArray]()
    if (beside & mine).any():
        compared[EDGES] = beside & mine
    for check in (check for view in views for check in view.checks if not check.reason):
        here = check.compared & mine
        if here.any():
            compared[check.name] = compared.get(check.name, np.zeros_like(mine)) | here
    whole = float(areas.sum())
    return tuple(
        (name, float(areas[mask].sum()) / whole) for name, mask in sorted(compared.items())
    )


def _rest(
    areas: FloatArray, whole: float, excuses: NDArray[np.uint8], otherwise: str
) -> tuple[tuple[str, float], ...]:
    """Return the share of a face not compared, by reason; compared areas (n,) are 0."""
    if not areas.any():
        return ()
    words = [otherwise, *(reason.value for reason in Unjudged)]
    sums = np.bincount(excuses, areas, minlength=len(words))
    shares = [
        (word, float(sum_mm2) / whole)
        for word, sum_mm2 in zip(words, sums.tolist(), strict=True)
        if sum_mm2 > 0.0
    ]
    return tuple(sorted(shares, key=lambda item: -item[1]))
