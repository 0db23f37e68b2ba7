"""Turns plans, sightings, view results and verdicts into rows of the journal."""

import numpy as np

from controller import inspection as inspecting
from controller.cell.journal import rows
from controller.planning import Plan
from controller.recognition import Sighting


def plan_row(plan: Plan) -> rows.PlanMade:
    """Return the row of a plan."""
    return rows.PlanMade(
        steps=tuple(label for label, _ in plan.seconds_by_step),
        seconds=tuple(round(seconds, 2) for _, seconds in plan.seconds_by_step),
        forecast_s=round(plan.forecast_s, 1),
        covered_fraction=round(plan.covered_fraction, 4),
        reachable_fraction=round(plan.reachable_fraction, 4),
        unseen=tuple(
            rows.UnseenFields(face=u.face_id, area_fraction=u.area_fraction, reason=u.reason)
            for u in plan.unseen
        ),
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
                part=a.part, pose_index=a.pose_index, theta_deg=float(np.degrees(a.theta_rad))
            )
            for a in s.ambiguous_with
        ),
        box_px=s.box_px,
        reason=s.reason,
    )


def view_row(r: inspecting.ViewResult) -> rows.ViewJudged:
    """Return the row of a view's result."""
    return rows.ViewJudged(
        view=r.view_id,
        evaluated=r.evaluated,
        reason=r.reason,
        T_world_part=r.T_world_part.tolist(),
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
    )


def verdict_row(v: inspecting.PartVerdict) -> rows.PartJudged:
    """Return the row of a verdict."""
    return rows.PartJudged(
        verdict=v.verdict.value,
        reasons=v.reasons,
        compared_fraction=round(v.compared_fraction, 4),
        in_sight_fraction=round(v.in_sight_fraction, 4),
        claim=v.claim,
        confirmed=tuple(
            rows.ConfirmedFinding(view=view_id, kind=f.kind.value, lamp=f.lamp, faces=f.face_ids)
            for view_id, f in v.confirmed
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
    )
