"""Turns plans, sightings, view results, measured values and verdicts into rows of the journal."""

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from controller import inspection as inspecting
from controller.arrays import FloatArray
from controller.cell.journal import rows
from controller.inspection.characteristics import (
    Characteristic,
    CharacteristicKind,
    EdgePairGeometry,
    Look,
    Measured,
    RimGeometry,
)
from controller.planning import Plan
from controller.recognition import Sighting
from controller.setup.turns import turn_section

from .holds import matrix
from .part import merged

# Number of looks per characteristic whose edge points the row keeps, twice the number that a report
# draws. All of them would be 9 MB for a part, which holds the event loop for half a second; a
# replay finds them again.
DRAWN_LOOK_COUNT: Final = 6


def plan_row(plan: Plan, *, is_ahead: bool = False) -> rows.PlanMade:
    """Return the row of a plan.

    Parameters
    ----------
    plan : just made, or taken up
    is_ahead : True if it was made while the arm still had the part before
    """
    more = {"is_ahead": True} if is_ahead else {}
    return rows.PlanMade(
        steps=tuple(label for label, _ in plan.seconds_by_step),
        seconds=tuple(round(seconds, 2) for _, seconds in plan.seconds_by_step),
        forecast_s=round(plan.forecast_s, 1),
        covered_fraction=round(plan.covered_fraction, 4),
        covered_U=round(plan.covered_U, 5),
        reachable_fraction=round(plan.reachable_fraction, 4),
        unseen=tuple(
            rows.UnseenFields(face=u.face_id, area_fraction=u.area_fraction, reason=u.reason)
            for u in plan.unseen
        ),
        **more,
    )


def sightings_row(sightings: tuple[Sighting, ...]) -> rows.Sightings:
    """Return the row of all sightings of a look at the table."""
    return rows.Sightings(sightings=tuple(_sighting(s) for s in sightings))


def _sighting(s: Sighting) -> rows.SightingFields:
    is_measured = s.covariance is not None
    return rows.SightingFields(
        part=s.part,
        pose_index=s.pose_index,
        R=None if s.R is None else s.R.tolist(),
        x_mm=round(s.x_mm, 3),
        y_mm=round(s.y_mm, 3),
        theta_deg=round(float(np.degrees(s.theta_rad)), 3),
        score=round(s.score, 4),
        sigma_mm=round(s.sigma_mm, 4) if is_measured else None,
        sigma_deg=round(float(np.degrees(s.sigma_rad)), 4) if is_measured else None,
        residual_px=round(s.residual_px, 3) if np.isfinite(s.residual_px) else None,
        ambiguous_with=tuple(
            rows.OtherHypothesis(
                part=a.part,
                pose_index=a.pose_index,
                theta_deg=float(np.degrees(a.theta_rad)),
                T_world_part=matrix(a.T_world_part),
            )
            for a in s.ambiguous_with
        ),
        box_px=s.box_px,
        reason=s.reason,
        T_world_part=None if s.T_world_part is None else matrix(s.T_world_part),
        free_share=round(s.free_share, 3),
        touching_count=s.touching_count,
        is_cut=s.is_cut,
        lies_on=s.lies_on,
        is_covered=s.is_covered,
        free_turn=turn_section(s.free_turn),
    )


def view_row(
    r: inspecting.ViewResult, before: Sequence[inspecting.ViewResult] = ()
) -> rows.ViewJudged:
    """Return the row of a view's result.

    Parameters
    ----------
    r : the result
    before : results of the earlier views of the part; faces are counted with them
    """
    faces = _faces_compared((*before, r))
    more = {"faces": faces} if faces else {}
    return rows.ViewJudged(
        view=r.view_id,
        evaluated=r.evaluated,
        reason=r.reason,
        T_world_part=r.T_world_part_known.tolist(),
        shift_mm=round(r.shift_mm, 3),
        turn_deg=round(float(np.degrees(r.turn_rad)), 3),
        residual_px=round(r.residual_px, 3) if np.isfinite(r.residual_px) else None,
        compared_samples=int(r.compared.sum()),
        in_sight_samples=int(r.in_sight.sum()),
        checks=tuple(
            rows.CheckMade(
                check=c.name,
                reason=c.reason,
                compared_samples=int(c.compared.sum()),
                size_mm=round(c.size_mm, 2),
                length_mm=round(c.length_mm, 2),
                misfit=round(c.misfit, 3),
            )
            for c in r.checks
        ),
        outline_px=np.round(r.outline_px[::3]).astype(int).tolist(),
        findings=tuple(
            rows.FindingFields(
                kind=f.kind.value,
                lamp=f.lamp,
                area_mm2=round(f.area_mm2, 2),
                size_mm=round(f.size_mm, 2),
                at_px=(round(f.at_px[0], 1), round(f.at_px[1], 1)),
                box_px=f.box_px,
                p_part_mm=np.round(f.p_part_mm, 2).tolist(),
                faces=f.face_ids,
            )
            for f in r.findings
        ),
        **more,
    )


def _faces_compared(
    results: Sequence[inspecting.ViewResult],
) -> tuple[tuple[int, int, int], ...]:
    """Return each face with samples: number, samples compared in some view, all samples."""
    of = results[-1].face_ids
    compared = merged([one.compared for one in results if len(one.compared) == len(of)])
    if compared is None:
        return ()
    total, done = np.bincount(of), np.bincount(of[compared])
    return tuple((f, int(done[f]), int(total[f])) for f in np.flatnonzero(done).tolist())


def verdict_row(v: inspecting.PartVerdict) -> rows.PartJudged:
    """Return the row of a verdict."""
    return rows.PartJudged(
        verdict=v.verdict.value,
        reasons=v.reasons,
        compared_fraction=round(v.compared_fraction, 4),
        compared_U=round(v.compared_U, 5),
        in_sight_fraction=round(v.in_sight_fraction, 4),
        claim=v.claim,
        confirmed=tuple(
            rows.ConfirmedFinding(
                view=f.view_id, kind=f.plainest.kind.value, lamp=f.plainest.lamp, faces=f.face_ids
            )
            for f in v.findings
            if f.verdict is inspecting.Verdict.FAIL
        ),
        faces=tuple(
            rows.FaceJudged(
                face=f.face_id,
                label=f.label,
                area_mm2=round(f.area_mm2, 2),
                compared_fraction=round(f.compared_fraction, 4),
                by_check={name: round(share, 4) for name, share in f.by_check},
                rest={reason: round(share, 4) for reason, share in f.rest},
                verdict=f.verdict.value,
                views=f.views,
                reason=f.reason,
            )
            for f in v.faces
        ),
        found=tuple(
            rows.DetectionFields(
                kind=d.kind,
                size_mm=d.size_mm,
                share=round(d.share, 4),
                half_mm=None if d.half_mm is None else round(d.half_mm, 3),
                is_asked=d.is_asked,
                open_faces=tuple(face for face, _ in d.open_faces),
            )
            for d in v.detections
        ),
    )


def measured_row(measured: Sequence[Measured]) -> rows.PartMeasured:
    """Return the row of the characteristics of a part."""
    return rows.PartMeasured(characteristics=tuple(_characteristic(m) for m in measured))


def views_posed_row(off: Sequence[inspecting.ViewOff]) -> rows.ViewsPosed:
    """Return the row on the disagreement of arm and camera from view to view."""
    return rows.ViewsPosed(
        views=tuple(
            rows.ViewOffFields(
                view=one.view_id,
                grasp=one.grasp,
                off_mm=round(one.mm, 4),
                off_deg=round(float(np.degrees(one.rad)), 4),
            )
            for one in off
        )
    )


def findings_row(findings: Sequence[inspecting.PartFinding]) -> rows.PartFindings:
    """Return the row of the findings of a part."""
    return rows.PartFindings(
        findings=tuple(
            rows.PartFindingFields(
                kind=f.kind,
                view=f.view_id,
                lamp=f.lamp,
                p_part_mm=np.round(f.p_part_mm, 2).tolist(),
                size_mm=round(f.size_mm, 3),
                faces=f.faces,
                verdict=f.verdict.value,
                area_mm2=None if f.area_mm2 is None else round(f.area_mm2, 3),
                at_px=None if f.at_px is None else (round(f.at_px[0], 1), round(f.at_px[1], 1)),
                box_px=f.box_px,
                outline_px=_points(f.outline_px),
                pictures=f.pictures,
            )
            for f in findings
        )
    )


def _characteristic(m: Measured) -> rows.CharacteristicFields:
    asked = m.characteristic
    is_angle = asked.kind is CharacteristicKind.ANGLE

    def value(number: float | None) -> float | None:
        if number is None or not np.isfinite(number):
            return None
        return round(float(np.degrees(number)) if is_angle else float(number), 6)

    def limit(number: float) -> float:
        return float(np.degrees(number)) if is_angle else float(number)

    # those that count are drawn before those that do not, each in its order
    drawn = sorted(m.looks, key=lambda look: bool(look.reason))[:DRAWN_LOOK_COUNT]
    anchors, axis = _anchors(asked)
    rims = asked.geometry.rims if isinstance(asked.geometry, RimGeometry) else ()
    return rows.CharacteristicFields(
        id=asked.id,
        balloon=asked.balloon,
        kind=asked.kind.value,
        label=asked.label,
        unit="deg" if is_angle else "mm",
        nominal=limit(asked.nominal_mm),
        lower=limit(asked.lower_mm),
        upper=limit(asked.upper_mm),
        source=asked.source,
        faces=asked.faces,
        is_critical=asked.is_critical,
        measured=value(m.measured_mm),
        U=value(m.U_mm),
        verdict=m.verdict.value,
        views=m.views,
        reason=m.reason,
        anchors_mm=tuple(np.round(p, 4).tolist() for p in anchors),
        axis=None if axis is None else np.round(axis, 6).tolist(),
        rim_radius_mm=round(rims[0].radius_mm, 6) if rims else None,
        is_hole=rims[0].is_hole if rims else None,
        looks=tuple(_look(look, value, is_drawn=look in drawn) for look in m.looks),
    )


def _look(
    look: Look, value: Callable[[float | None], float | None], *, is_drawn: bool
) -> rows.LookFields:
    return rows.LookFields(
        view=look.view_id,
        lamp=look.lamp,
        measured=value(look.measured_mm),
        u=value(look.u_mm),
        reason=look.reason,
        budget={name: round(float(u), 6) for name, u in look.budget.items()},
        points_px=_points(look.points_px if is_drawn else None),
        accepted=_flags(look) if is_drawn else (),
        shape_px=_points(look.shape_px if is_drawn else None),
    )


def _anchors(asked: Characteristic) -> tuple[list[FloatArray], FloatArray | None]:
    """Return the points where a characteristic is measured, in the CAD frame, and its direction."""
    geometry = asked.geometry
    if isinstance(geometry, EdgePairGeometry):
        middles = [
            np.mean([(edge.start_mm + edge.end_mm) / 2 for edge in edges], axis=0)
            for edges in (geometry.one, geometry.other)
            if edges
        ]
        return middles, geometry.direction
    if not geometry.rims:
        return [], None
    return [geometry.rims[0].centre_mm], geometry.rims[0].axis


def _points(points: FloatArray | None) -> tuple[tuple[float, float], ...]:
    if points is None:
        return ()
    return tuple((round(float(x), 2), round(float(y), 2)) for x, y in points)


def _flags(look: Look) -> tuple[int, ...]:
    return () if look.accepted is None else tuple(int(a) for a in look.accepted)
