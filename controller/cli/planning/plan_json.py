"""A plan as conventions.md 7 defines it: one JSON object; poses are nested row-major lists."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.cad import Solid, SurfaceSamples, face_shares
from controller.planning import CellLayout, Certificate, Plan
from controller.planning.motion import tcp_pose
from controller.results.moments import Moment, MomentKind, moments, view_count
from controller.setup.planner import PlannerSetup

from .drive_json import (
    Deeds,
    arm_json,
    grasps_json,
    grippers_json,
    samples_json,
    trays_json,
)

# Raised when a key changes its meaning or goes; new keys do not raise it.
FORMAT = 1


def plan_json(
    solid: Solid,
    samples: SurfaceSamples,
    layout: CellLayout,
    plan: Plan,
    not_inspected: Mapping[int, str],
) -> dict[str, Any]:
    """Return all keys of a plan.

    A step's `q` and `T_world_part` belong to its main instant: the closing of the jaws, the
    picture, or the release. `seen_fraction` is the share of the whole surface that a step shows,
    `new_fraction` the share that no earlier step has shown. The actions of a step are in `actions`,
    in order (`docs/planning.md`).

    Parameters
    ----------
    solid : the part, for the names of its faces
    samples : its surface samples; their areas are the weights of coverage
    layout : the cell that was planned in
    plan : the plan
    not_inspected : reason of the recipe for leaving a face out, by face id
    """
    weights = samples.areas_mm2 / samples.areas_mm2.sum()
    seen = np.zeros(len(weights), dtype=bool)
    steps = []
    deeds = Deeds(layout, layout.park_q)
    at_trays = deeds
    for moment in moments(plan, layout):
        if moment.kind is MomentKind.PLACE:
            at_trays = deeds.branched()
        body = _step_json(moment, layout, weights, seen)
        steps.append(body | deeds.step_json(moment.step))
        if moment.in_sight is not None:
            seen |= moment.in_sight
    proof = plan.proof
    return {
        "format": FORMAT,
        "arm": arm_json(layout),
        "grippers": grippers_json(layout),
        "grasps": grasps_json(plan.grasps),
        "samples": samples_json(solid, samples),
        "steps": steps,
        "trays": trays_json(plan, at_trays),
        "forecast_s": plan.forecast_s,
        "covered_fraction": plan.covered_fraction,
        "covered_U": plan.covered_U,
        "faces": _faces_json(solid, samples, seen),
        "reachable_fraction": plan.reachable_fraction,
        "regrips": plan.regrasp_count,
        "proof": {
            "cost_s": proof.cost_s,
            "bound_s": proof.bound_s,
            "gap": proof.gap,
            "optimal": proof.cost_s > 0 and proof.is_optimal,
            "scope": proof.scope,
        },
        "views": [
            {"view": p.view_id, "direction_part": p.direction_part.tolist(), "q": p.q.tolist()}
            for p in plan.presents
        ],
        "not_inspected": {str(face): reason for face, reason in sorted(not_inspected.items())},
        "unseen": [
            {
                "face": u.face_id,
                "label": solid.faces[u.face_id].label,
                "area_fraction": u.area_fraction,
                "kind": u.kind.value,
                "reason": u.reason,
                "remedy": u.advice,
                "not_inspected": not_inspected.get(u.face_id),
                "samples": list(u.samples),
            }
            for u in plan.unseen
        ],
    }


def _faces_json(solid: Solid, samples: SurfaceSamples, seen: BoolArray) -> list[dict[str, Any]]:
    """Return the share of each face in sight of some view, with its uncertainty."""
    shares, uncertain = face_shares(samples, seen, len(solid.faces))
    return [
        {
            "face": face.id,
            "label": face.label,
            "area_mm2": face.area_mm2,
            "covered_fraction": float(shares[face.id]),
            "covered_U": float(uncertain[face.id]),
        }
        for face in solid.faces
    ]


def _step_json(
    moment: Moment, layout: CellLayout, weights: FloatArray, seen_before: BoolArray
) -> dict[str, Any]:
    body: dict[str, Any] = {
        "kind": moment.kind.value,
        "label": moment.step.label,
        "seconds": moment.step.seconds,
        "q": moment.q.tolist(),
        "T_world_tcp": tcp_pose(layout, moment.q).tolist(),
        "T_world_part": moment.T_world_part.tolist(),
        "grip": moment.grasp.id if moment.grasp else None,
        "fixture_grip": moment.fixed_grasp.id if moment.fixed_grasp else None,
        "view_id": moment.view_id,
    }
    if moment.in_sight is not None:
        body["seen_fraction"] = float(weights[moment.in_sight].sum())
        body["samples"] = np.flatnonzero(moment.in_sight).tolist()
        body["new_fraction"] = float(weights[moment.in_sight & ~seen_before].sum())
    return body


def certificate_json(certificate: Certificate, setup: PlannerSetup) -> dict[str, Any]:
    """Return a certificate.

    `pickable` is the share of positions where the part can be grasped; `same_as` the pose that a
    symmetry of the part makes this one, null for none; `heaviest_g_cm3` the density up to which the
    plan's grasps hold.

    Parameters
    ----------
    certificate : certificate of a stable pose
    setup : setup it was made with
    """
    body: dict[str, Any] = {
        "pose": certificate.pose_index,
        "probability": certificate.probability,
        "pickable": certificate.pickable,
        "planned": certificate.plan is not None,
        "same_as": certificate.same_as if certificate.same_as >= 0 else None,
        "density_g_cm3": setup.density_g_cm3,
        "density_from": setup.density_from,
    }
    if certificate.plan is None:
        return body | {"reason": certificate.reason}
    return body | {
        "complete": certificate.is_complete,
        "views": view_count(certificate.plan),
        "regrips": certificate.plan.regrasp_count,
        "forecast_s": certificate.plan.forecast_s,
        "covered_fraction": certificate.plan.covered_fraction,
        "covered_U": certificate.plan.covered_U,
        "reachable_fraction": certificate.plan.reachable_fraction,
        "heaviest_g_cm3": setup.heaviest_g_cm3(certificate.plan),
    }
