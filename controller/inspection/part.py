"""Inspection of a part from all its views: for the cell, stored pictures and a replay.

Views come with their pictures, so that results that one view alone cannot give (the place of the
part in the jaws, a dimension) are found from all of them.

Most of the work is view by view, once the pose of the grasp is known. `work_ahead` does it for
finished grasps while the arm still shows other views, and `inspect_part` takes it from the cache
(ADR 81).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.cad import SurfaceSamples

from ._judge import NO_PLAN, NOTHING, PartVerdict, judge
from ._pose import PosedPart
from ._types import OUTLINE, InspectionLimits, PicturedView, Verdict, ViewResult
from .characteristics import Characteristic, Measured, standing_of, worse
from .detection import NOTHING_ASKED, detections, in_words, stops
from .dimensions import BACKLIT, MeasuringSettings, PosedView, measure, measure_ahead
from .edge_evidence import EdgeEvidence, EdgeView, find_evidence, look_ahead
from .grasp_pose import (
    GraspPose,
    OutlinedView,
    PoseSettings,
    Rival,
    ViewPose,
    find_rival,
    fit_grasp,
    is_suspect,
)
from .integrity import Allowances
from .kept import Kept
from .lit import Appearance, Polish, gloss_of
from .view import ComparedView, NotEvaluated, Strictness, compare_view, outline_view


@dataclass(frozen=True, eq=False, slots=True)
class ViewSet:
    """All views of one part.

    Attributes
    ----------
    part, samples : the CAD model and its surface samples
    views : in the order taken
    """

    part: PosedPart
    samples: SurfaceSamples
    views: tuple[PicturedView, ...]


@dataclass(frozen=True, eq=False, slots=True)
class PartSettings:
    """Strictness with which a part is judged.

    Attributes
    ----------
    limits : limits of differences
    min_coverage : share of the surface that must have been compared for a pass
    not_inspected : reason, by face id, why the recipe leaves a face out
    unseen_reasons : reason, by face id, why the plan could not show all of a face
    planned : mask, by view id, of the samples (n,) that the plan meant the view to show
    allowances : allowed deviations of the outline of a good part
    pose : prior knowledge of arm, parts and light
    measuring : prior knowledge of lens, scale and temperature
    find_mm : by kind of defect the size that has to be found for a pass; of other kinds the size
        is stated
    appearance : of good parts, which decides on surfaces in views that it serves; None where none
        was learned
    """

    limits: InspectionLimits
    min_coverage: float = 0.5
    not_inspected: Mapping[int, str] = field(default_factory=lambda: NOTHING)
    unseen_reasons: Mapping[int, str] = field(default_factory=lambda: NOTHING)
    planned: Mapping[str, BoolArray] = field(default_factory=lambda: NO_PLAN)
    allowances: Allowances = field(default_factory=Allowances)
    pose: PoseSettings = field(default_factory=PoseSettings)
    measuring: MeasuringSettings = field(default_factory=MeasuringSettings)
    find_mm: Mapping[str, float] = field(default_factory=lambda: NOTHING_ASKED)
    appearance: Appearance | None = None


@dataclass(frozen=True, eq=False, slots=True)
class PartFinding:
    """A difference of the part from the CAD model: one place, one finding.

    Attributes
    ----------
    kind : missing, extra, chip, burr, dimension, missing_edge, dent, pit, scratch, stain, surface
        or identity
    view_id, lamp : picture that shows it best
    p_part_mm : (3,) CAD frame
    size_mm : longest extent
    faces : ids of the surfaces it lies on
    verdict : FAIL where it is proven, INDETERMINATE where it may be something else
    box_px : x0, y0, x1, y1 in that picture; None if it is not known there
    outline_px : (k, 2) border of the difference in that picture, for the report
    area_mm2 : largest visible area; None for the whole part
    at_px : (x, y) of its centre in that picture; None if unknown
    pictures : every view and lamp that shows it
    """

    kind: str
    view_id: str
    lamp: str
    p_part_mm: FloatArray
    size_mm: float
    faces: tuple[int, ...]
    verdict: Verdict
    box_px: tuple[int, int, int, int] | None = None
    outline_px: FloatArray | None = None
    area_mm2: float | None = None
    at_px: tuple[float, float] | None = None
    pictures: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class ViewOff:
    """Disagreement of arm and camera in one view of a held part.

    Attributes
    ----------
    view_id : name of the view
    grasp : number of the grasp, from 0
    mm, rad : deviation from the joint pose of all views of the grasp
    """

    view_id: str
    grasp: int
    mm: float
    rad: float


@dataclass(frozen=True, eq=False, slots=True)
class PartInspection:
    """Inspection result of a part from all its views.

    Attributes
    ----------
    verdict : worst proven verdict; PASS where nothing is left open
    reasons : sentences, most important first
    views : results view by view
    measured : characteristics with their results
    findings : differences from the CAD model
    ledger : compared share of each surface, and the reasons for the rest
    unproven : characteristics that a PASS does not cover since they were not verified, in sentences
    off : disagreement of arm and camera, view by view
    """

    verdict: Verdict
    reasons: tuple[str, ...]
    views: tuple[ViewResult, ...]
    measured: tuple[Measured, ...]
    findings: tuple[PartFinding, ...]
    ledger: PartVerdict
    unproven: tuple[str, ...] = ()
    off: tuple[ViewOff, ...] = ()


def work_ahead(
    views: ViewSet,
    characteristics: tuple[Characteristic, ...],
    settings: PartSettings,
    kept: Kept,
    view_count: int,
) -> Iterator[None]:
    """Compute in advance what `inspect_part` will need of these views.

    Yields after each view. Of a grasp that is not over the pose will be another one, and all that
    follows from it: leave its views out.

    Parameters
    ----------
    views : of the grasps that are over, with their pictures
    characteristics : to be measured
    settings : how strictly
    kept : gets it
    view_count : how many views there will be; with another number outlines are compared again
    """
    for view in views.views:
        _outlined(view, kept)
        yield
    posed = pose_views(views, settings.pose, kept)
    yield
    strictness = Strictness(settings.allowances, settings.pose, view_count, settings.appearance)
    for _ in _results(views, posed, strictness, kept):
        yield
    for view in views.views:
        if (one := _posed_view(view, posed, kept)) is not None:
            measure_ahead(views.part, characteristics, one, settings.measuring, kept)
            yield
    results = inspect_views(views, posed, settings, kept, view_count)
    yield from look_ahead(
        views.part,
        _edge_views(views, posed, results, kept),
        settings.allowances,
        settings.measuring,
        kept,
    )


def inspect_part(
    views: ViewSet,
    characteristics: tuple[Characteristic, ...],
    settings: PartSettings,
    kept: Kept | None = None,
) -> PartInspection:
    """Return the inspection result of a part from all its views.

    Parameters
    ----------
    views : with their pictures
    characteristics : to be measured
    settings : how strictly
    kept : what of it was worked out before; None for nothing
    """
    kept = kept or Kept()
    posed = pose_views(views, settings.pose, kept)
    rival = posed.rival(views.part, settings.pose)
    results = inspect_views(views, posed, settings, kept)
    edges = inspect_edges(views, posed, results, settings, kept)
    results = tuple(
        replace(r, findings=(*r.findings, *edges.findings.get(r.view_id, ()))) for r in results
    )
    ledger = judge(
        views.part.solid,
        views.samples,
        results,
        settings.unseen_reasons,
        settings.min_coverage,
        settings.limits,
        settings.not_inspected,
        settings.planned,
        edges,
        settings.find_mm,
    )
    ledger = with_detections(views, results, ledger, settings)
    findings = tuple(
        PartFinding(
            kind=one.plainest.kind.name.lower(),
            view_id=one.view_id,
            lamp=one.plainest.lamp,
            p_part_mm=np.asarray(one.plainest.p_part_mm),
            size_mm=one.size_mm,
            faces=one.face_ids,
            verdict=one.verdict,
            area_mm2=one.area_mm2,
            at_px=one.plainest.at_px,
            box_px=one.plainest.box_px,
            outline_px=one.plainest.outline_px,
            pictures=tuple(dict.fromkeys((view_id, f.lamp) for view_id, f in one.looks)),
        )
        for one in ledger.findings
    )
    measured = measure_views(views, posed, characteristics, settings.measuring, kept)
    standing = standing_of(measured)
    verdict = worse(ledger.verdict, standing.verdict)
    reasons = (*standing.reasons, *ledger.reasons)
    if ledger.findings and standing.verdict is not Verdict.FAIL:
        reasons = (*ledger.reasons, *standing.reasons)  # what pictures show comes first
    if rival is not None:
        # what of this part is missing or too much says nothing more
        verdict = Verdict.FAIL
        findings = (_identity(views), *findings)
        reasons = (
            f"another part: {rival.name} explains {100 * rival.explained:.0f} % of the outlines, "
            f"this one {100 * rival.expected_explained:.0f} %",
            *reasons,
        )
    return PartInspection(
        verdict, reasons, results, measured, findings, ledger, standing.unproven, posed.off
    )


@dataclass(frozen=True, eq=False, slots=True)
class PosedViews:
    """Poses of the part in all views.

    Attributes
    ----------
    outlined : each view with its outline, by its id
    outlines : the views whose outline proves something, by grasp
    fits : the pose of each of these grasps; None where none was found
    """

    outlined: Mapping[str, OutlinedView | NotEvaluated]
    outlines: Mapping[int, list[OutlinedView]]
    fits: Mapping[int, GraspPose | None]

    def pose(self, view_id: str) -> ViewPose | None:
        """Return the part's pose in a view, None where it was not found."""
        found = (fit.view(view_id) for fit in self.fits.values() if fit is not None)
        return next((pose for pose in found if pose is not None), None)

    @property
    def off(self) -> tuple[ViewOff, ...]:
        """Disagreement of arm and camera, view by view."""
        return tuple(
            ViewOff(view.view_id, grasp, view.deviation_mm, view.deviation_rad)
            for grasp, fit in sorted(self.fits.items())
            if fit is not None
            for view in fit.views
            if not view.is_hidden
        )

    def rival(self, part: PosedPart, settings: PoseSettings) -> Rival | None:
        """Return the rival that the outlines show in place of the part, else None."""
        fits = list(self.fits.values())
        if not fits or not is_suspect(fits):
            return None
        return find_rival(part, list(self.outlines.values()), fits, settings)


def pose_views(views: ViewSet, settings: PoseSettings, kept: Kept | None = None) -> PosedViews:
    """Return the poses of the part in all its views, one fit for each grasp.

    Parameters
    ----------
    views : with their pictures
    settings : what is known of arm, parts and light
    kept : what of it was worked out before; None for nothing
    """
    kept = kept or Kept()
    outlined = {view.task.view_id: _outlined(view, kept) for view in views.views}
    by_grasp: dict[int, list[OutlinedView]] = {}
    for one in outlined.values():
        if isinstance(one, OutlinedView):
            by_grasp.setdefault(one.view.grasp, []).append(one)
    fits = {
        grasp: kept.once(
            partial(fit_grasp, views.part, every, settings), fit_grasp, *every, settings
        )
        for grasp, every in by_grasp.items()
    }
    return PosedViews(outlined, by_grasp, fits)


def _outlined(view: PicturedView, kept: Kept) -> OutlinedView | NotEvaluated:
    return kept.once(partial(outline_view, view), outline_view, view)


def inspect_views(
    views: ViewSet,
    posed: PosedViews,
    settings: PartSettings,
    kept: Kept,
    view_count: int | None = None,
) -> tuple[ViewResult, ...]:
    """Return each view's result at its pose.

    Parameters
    ----------
    views : with their pictures
    posed : where the part is in them
    settings : how strictly
    kept : what of it was worked out before
    view_count : how many views there will be; None for these
    """
    strictness = Strictness(
        settings.allowances, settings.pose, view_count or len(views.views), settings.appearance
    )
    results = {one.view_id: one for one in _results(views, posed, strictness, kept) if one}
    return tuple(results[view.task.view_id] for view in views.views)


def measure_views(
    views: ViewSet,
    posed: PosedViews,
    characteristics: tuple[Characteristic, ...],
    settings: MeasuringSettings,
    kept: Kept,
) -> tuple[Measured, ...]:
    """Return the characteristics measured in all views whose pose is known.

    Parameters
    ----------
    views : with their pictures
    posed : where the part is in them
    characteristics : what is asked
    settings : what is uncertain before any picture
    kept : what of it was worked out before
    """
    known = [one for view in views.views if (one := _posed_view(view, posed, kept)) is not None]
    return measure(views.part, characteristics, known, settings, kept) if characteristics else ()


def inspect_edges(
    views: ViewSet,
    posed: PosedViews,
    results: tuple[ViewResult, ...],
    settings: PartSettings,
    kept: Kept,
) -> EdgeEvidence:
    """Return the evidence of a part's edges, from all pictures that passed their self-checks.

    Parameters
    ----------
    views : with their pictures
    posed : where the part is in them
    results : of each view, in the same order
    settings : how strictly
    kept : what of it was worked out before
    """
    return find_evidence(
        views.part,
        views.samples,
        _edge_views(views, posed, results, kept),
        settings.limits,
        settings.allowances,
        settings.measuring,
        kept,
    )


def _edge_views(
    views: ViewSet, posed: PosedViews, results: tuple[ViewResult, ...], kept: Kept
) -> list[EdgeView]:
    """Return the views whose edges count, with the pictures that passed their self-checks."""
    known = []
    for view, result in zip(views.views, results, strict=True):
        one = _posed_view(view, posed, kept)
        if one is None or not result.evaluated:
            continue
        lamps = (
            c.name for c in result.checks if not c.reason and not c.is_dark and c.name != OUTLINE
        )
        known.append(EdgeView(one, (BACKLIT, *lamps), view.counted))
    return known


def _posed_view(view: PicturedView, posed: PosedViews, kept: Kept) -> PosedView | None:
    """Return a view with the part's pose, None where it was not found."""
    pose, outlined = posed.pose(view.task.view_id), posed.outlined[view.task.view_id]
    if pose is None or isinstance(outlined, NotEvaluated):
        return None
    scene = outlined.scene
    return kept.once(
        lambda: PosedView(
            view.task, view.pictures, pose.T_world_part, pose.covariance, view.grasp, scene
        ),
        PosedView,
        view,
        pose,
    )


def with_detections(
    views: ViewSet, results: tuple[ViewResult, ...], ledger: PartVerdict, settings: PartSettings
) -> PartVerdict:
    """Return a ledger with the detectable defects, which stop a PASS where they are too large.

    Parameters
    ----------
    views : of the part
    results : what they showed
    ledger : of its surfaces
    settings : with the sizes that have to be found
    """
    found = detections(
        views.part.solid,
        views.samples,
        results,
        settings.limits,
        settings.find_mm,
        settings.not_inspected,
    )
    if not found:
        return ledger
    words, too_little = in_words(found), stops(found, views.part.solid)
    reasons = (*ledger.reasons, words) if ledger.verdict is Verdict.PASS else ledger.reasons
    verdict = Verdict.INDETERMINATE if too_little and ledger.verdict is Verdict.PASS else None
    return replace(
        ledger,
        verdict=verdict or ledger.verdict,
        reasons=(*too_little, *reasons) if verdict else (*reasons, *too_little),
        detections=found,
    )


def _identity(views: ViewSet) -> PartFinding:
    solid = views.part.solid
    return PartFinding(
        kind="identity",
        view_id=views.views[0].task.view_id,
        lamp="backlit",
        p_part_mm=np.asarray(solid.centroid_mm),
        size_mm=float(np.ptp(solid.mesh.bounds, axis=0).max()),
        faces=(),
        verdict=Verdict.FAIL,
    )


def _results(
    views: ViewSet, posed: PosedViews, strictness: Strictness, kept: Kept
) -> Iterator[ViewResult | None]:
    """Yield each view's result on the samples that it counts for, and None while at work.

    How polished a finish is, pictures tell together: those of a grasp and of the grasps before it,
    which do not change as more follow.
    """
    evidence: list[Polish] = []
    for grasp in dict.fromkeys(view.grasp for view in views.views):
        mine = [view for view in views.views if view.grasp == grasp]
        yield from _of_grasp(views, mine, posed, strictness, evidence, kept)


def _of_grasp(
    views: ViewSet,
    mine: Sequence[PicturedView],
    posed: PosedViews,
    strictness: Strictness,
    evidence: list[Polish],
    kept: Kept,
) -> Iterator[ViewResult | None]:
    """Yield the results of a grasp's views; their evidence is added to that of earlier grasps."""
    built: dict[str, ComparedView | NotEvaluated] = {}

    def at_pose(view: PicturedView) -> ComparedView | NotEvaluated:
        view_id = view.task.view_id
        if view_id not in built:
            outlined, pose = posed.outlined[view_id], posed.pose(view_id)
            built[view_id] = compare_view(views.part, views.samples, outlined, pose, strictness)
        return built[view_id]

    def polish(view: PicturedView) -> tuple[Polish, ...]:
        one = at_pose(view)
        return () if isinstance(one, NotEvaluated) else one.lit.polish

    def judged(view: PicturedView, gloss: float) -> ViewResult:
        one = at_pose(view)
        return one.result(views.samples) if isinstance(one, NotEvaluated) else one.judged(gloss)

    for view in mine:
        key = (view, posed.pose(view.task.view_id), strictness)
        evidence += kept.once(partial(polish, view), Polish, *key)
        yield None
    gloss = gloss_of(evidence)
    for view in mine:
        key = (view, posed.pose(view.task.view_id), strictness)
        result = kept.once(partial(judged, view, gloss), ComparedView, *key, gloss)
        built.pop(view.task.view_id, None)  # what it was judged by is large
        yield result if view.counted is None else result.within(view.counted)
