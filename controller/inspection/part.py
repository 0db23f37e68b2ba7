"""Inspection of a part from all its views: for the cell, stored pictures and a replay.

Views come with their pictures, so that results that one view alone cannot give (the place of the
part in the jaws, a dimension) are found from all of them.

Most of the work is view by view, once the pose of the grasp is known. `work_ahead` does it for
finished grasps while the arm still shows other views, and `inspect_part` takes it from the cache
(ADR 81). Both go through the same stages, in `stages.py`.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from messages import say

from ._gathered import PlacedFinding
from ._judge import PartVerdict, judge
from ._part_types import PartFinding, PartInspection, PartSettings, ViewSet
from ._types import Verdict, ViewResult
from .characteristics import Characteristic, Measured, standing_of, worse
from .detection import detections, in_words, stops
from .dimensions import put_together
from .edge_evidence import EdgeEvidence, find_evidence
from .grasp_pose import Rival
from .kept import Kept
from .stages import (
    PosedViews,
    compare_views,
    dimensions_sought,
    edges_seen,
    looks_at_dimensions,
    looks_at_edges,
    outlined_view,
    pose_views,
)


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
        outlined_view(kept, view)
        yield
    posed = pose_views(views, settings.pose, kept)
    yield
    for _ in compare_views(views, posed, settings, kept, view_count):
        yield
    results = _results(views, posed, settings, kept, view_count)
    measuring = settings.measuring
    for _ in looks_at_dimensions(views.part, characteristics, posed.known(kept), measuring, kept):
        yield
    for _ in looks_at_edges(views.part, posed.known(kept, results), settings, kept):
        yield


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
    results = _results(views, posed, settings, kept, len(views.views))
    edges = _edge_evidence(views, posed, results, settings, kept)
    results = tuple(
        replace(r, findings=(*r.findings, *edges.findings.get(r.view_id, ()))) for r in results
    )
    measured = _measured(views, posed, characteristics, settings, kept)
    ledger = _ledger(views, results, edges, settings)
    return _concluded(views, posed, rival, results, measured, ledger)


def _results(
    views: ViewSet, posed: PosedViews, settings: PartSettings, kept: Kept, view_count: int
) -> tuple[ViewResult, ...]:
    """Return each view's result at its pose, in the order taken."""
    found = compare_views(views, posed, settings, kept, view_count)
    results = {one.view_id: one for one in found if one}
    return tuple(results[view.task.view_id] for view in views.views)


def _edge_evidence(
    views: ViewSet,
    posed: PosedViews,
    results: tuple[ViewResult, ...],
    settings: PartSettings,
    kept: Kept,
) -> EdgeEvidence:
    """Return the evidence of a part's edges, from all pictures that passed their self-checks."""
    passed = posed.known(kept, results)
    return find_evidence(
        views.part,
        views.samples,
        passed,
        edges_seen(views.part, passed, kept),
        list(looks_at_edges(views.part, passed, settings, kept)),
        settings.limits,
        settings.allowances,
        settings.measuring,
    )


def _measured(
    views: ViewSet,
    posed: PosedViews,
    characteristics: tuple[Characteristic, ...],
    settings: PartSettings,
    kept: Kept,
) -> tuple[Measured, ...]:
    """Return the characteristics measured in all views whose pose is known."""
    known, measuring = posed.known(kept), settings.measuring
    looks = list(looks_at_dimensions(views.part, characteristics, known, measuring, kept))
    sought = dimensions_sought(kept, views.part, characteristics)
    return put_together(characteristics, sought, looks, measuring)


def _ledger(
    views: ViewSet, results: tuple[ViewResult, ...], edges: EdgeEvidence, settings: PartSettings
) -> PartVerdict:
    """Return the verdict on the surfaces, with the defects that would have been found."""
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
    return with_detections(views, results, ledger, settings)


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


def _concluded(
    views: ViewSet,
    posed: PosedViews,
    rival: Rival | None,
    results: tuple[ViewResult, ...],
    measured: tuple[Measured, ...],
    ledger: PartVerdict,
) -> PartInspection:
    """Return the result: the worst of surfaces, dimensions and identity."""
    findings = tuple(_finding(one) for one in ledger.findings)
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
            say(
                "another part: {name} explains {explained_percent:.0f} % of the outlines, "
                "this one {expected_explained_percent:.0f} %",
                name=rival.name,
                explained_percent=100 * rival.explained,
                expected_explained_percent=100 * rival.expected_explained,
            ),
            *reasons,
        )
    return PartInspection(
        verdict, reasons, results, measured, findings, ledger, standing.unproven, posed.off
    )


def _finding(one: PlacedFinding) -> PartFinding:
    return PartFinding(
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
