"""What is known of the part at hand and of the run, and how the journal keeps it."""

import asyncio
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller import inspection as inspecting
from controller.planning import Grip, Look, Plan, Present
from controller.recognition import Alternative, Sighting

from .clocks import Speed
from .custody import Custody
from .recovery import PartFault, Recovery, merged

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Grey = NDArray[np.uint8]


@dataclass(slots=True)
class Progress:
    """What the operator sees of the run at a moment."""

    state: str = "stopped"
    step: int = 0
    step_count: int = 0
    label: str = ""
    part_pose: str = ""
    remaining_s: float | None = None
    custody: Custody = Custody.NONE
    speed: Speed | None = None


@dataclass(slots=True, eq=False)
class Hold:
    """How the hand has the part, from one closing of its jaws to their next opening.

    Attributes
    ----------
    grip : as planned
    T_part_hand : (4, 4) as planned, or as measured once `is_seen`
    width_mm : of the jaws on the part
    is_seen : a view has confirmed it
    doubts : views in a row that could not
    """

    grip: Grip
    T_part_hand: Array
    width_mm: float
    is_seen: bool = False
    doubts: int = 0


@dataclass(slots=True, eq=False)
class Shown:
    """A view that is being judged.

    Attributes
    ----------
    hold : under which it was taken, None where it lay on the table
    q : (6,) where the arm stood; expected : (4, 4) where the part should have been
    backlit : its picture before the glowing panel
    """

    view: str
    hold: Hold | None
    q: Array
    expected: Array
    holder: tuple[inspecting.WorldBox, ...]
    backlit: Grey
    task: asyncio.Task[inspecting.ViewResult]


@dataclass(slots=True)
class PartRecord:
    """All that is known of the part at hand.

    Attributes
    ----------
    pictures, picture_names, look_count : of the last look at the table, and how many there were
    candidates : what else it may be, as far as the pictures of the table tell
    plan, plan_count, next_step : the plan in work, how many were made, where it stands
    hold : of the hand, None where it is empty
    fixture_grip : how the fixed gripper has the part, as measured; None where it is empty
    results : of all views, whatever plan they were part of: they are facts
    planned : by view, which samples (n,) it was meant to show
    recoveries : what the cell has set out to get over by itself
    avoid : ids of grips that have failed
    """

    number: int
    custody: Custody = Custody.ON_TABLE
    pictures: dict[str, Grey] = field(default_factory=dict)
    picture_names: dict[str, str] = field(default_factory=dict)
    look_count: int = 0
    sighting: Sighting | None = None
    candidates: tuple[Alternative, ...] = ()
    plan: Plan | None = None
    plan_count: int = 0
    next_step: int = 0
    hold: Hold | None = None
    fixture_grip: Grip | None = None
    pending: list[Shown] = field(default_factory=list)
    results: list[inspecting.ViewResult] = field(default_factory=list)
    planned: dict[str, Mask] = field(default_factory=dict)
    recoveries: list[Recovery] = field(default_factory=list)
    avoid: set[str] = field(default_factory=set)
    verdict: inspecting.PartVerdict | None = None
    tray: str | None = None

    @property
    def seen(self) -> Mask | None:
        """Return which samples (n,) views have truly shown; None before the first view.

        Shown, not compared: what no check can compare, another view like it cannot either.
        """
        return merged([result.shown for result in self.results if result.evaluated])

    @property
    def promised(self) -> Mask | None:
        """Return what the views of the present plan were to show (n,)."""
        plan = self.plan
        if plan is None:
            return None
        return merged([s.seen for s in plan.steps if isinstance(s, Present | Look)])

    def has_had(self, fault: PartFault) -> bool:
        """Return whether the part has had a fault before."""
        return any(one.fault is fault for one in self.recoveries)


def describe_plan(plan: Plan) -> dict[str, Any]:
    """Return a plan as the journal keeps it."""
    return {
        "steps": [label for label, _ in plan.seconds_by_step],
        "seconds": [round(seconds, 2) for _, seconds in plan.seconds_by_step],
        "forecast_s": round(plan.forecast_s, 1),
        "covered_fraction": round(plan.covered_fraction, 4),
        "reachable_fraction": round(plan.reachable_fraction, 4),
        "unseen": [
            {"face": u.face_id, "area_fraction": u.area_fraction, "reason": u.reason}
            for u in plan.unseen
        ],
    }


def describe_sighting(s: Sighting) -> dict[str, Any]:
    """Return a sighting as the journal keeps it."""
    return {
        "part": s.part,
        "pose_index": s.pose_index,
        "stable_pose_R": None if s.R is None else s.R.tolist(),
        "x_mm": round(s.x_mm, 3),
        "y_mm": round(s.y_mm, 3),
        "theta_deg": round(float(np.degrees(s.theta_rad)), 3),
        "score": round(s.score, 4),
        "sigma_mm": None if s.covariance is None else round(s.sigma_mm, 4),
        "sigma_deg": None if s.covariance is None else round(float(np.degrees(s.sigma_rad)), 4),
        "residual_px": None if not np.isfinite(s.residual_px) else round(s.residual_px, 3),
        "ambiguous_with": [
            {
                "part": a.part,
                "pose_index": a.pose_index,
                "theta_deg": float(np.degrees(a.theta_rad)),
            }
            for a in s.ambiguous_with
        ],
        "box_px": list(s.box_px),
        "reason": s.reason,
    }


def describe_view(r: inspecting.ViewResult) -> dict[str, Any]:
    """Return a view's result as the journal keeps it."""
    return {
        "view": r.view_id,
        "evaluated": r.evaluated,
        "reason": r.reason,
        "T_world_part": r.T_world_part.tolist(),
        "shift_mm": round(r.shift_mm, 3),
        "turn_deg": round(float(np.degrees(r.turn_rad)), 3),
        "residual_px": None if not np.isfinite(r.residual_px) else round(r.residual_px, 3),
        "seen_samples": int(r.seen.sum()),
        "in_sight_samples": int(r.shown.sum()),
        "checks": [
            {
                "check": c.name,
                "reason": c.reason,
                "compared_samples": int(c.compared.sum()),
                "size_mm": round(c.size_mm, 2),
                "length_mm": round(c.length_mm, 2),
                "misfit": round(c.misfit, 3),
            }
            for c in r.checks
        ],
        "outline_px": np.round(r.outline_px[::3]).astype(int).tolist(),
        "findings": [
            {
                "kind": f.kind.value,
                "lamp": f.lamp,
                "area_mm2": round(f.area_mm2, 2),
                "size_mm": round(f.size_mm, 2),
                "at_px": [round(v, 1) for v in f.at_px],
                "box_px": list(f.box_px),
                "p_part_mm": np.round(f.p_part_mm, 2).tolist(),
                "faces": list(f.face_ids),
            }
            for f in r.findings
        ],
    }


def describe_verdict(v: inspecting.PartVerdict) -> dict[str, Any]:
    """Return a verdict as the journal keeps it."""
    return {
        "verdict": v.verdict.value,
        "reasons": list(v.reasons),
        "covered_fraction": round(v.covered_fraction, 4),
        "in_sight_fraction": round(v.in_sight_fraction, 4),
        "claim": v.claim,
        "confirmed": [
            {"view": view_id, "kind": f.kind.value, "lamp": f.lamp, "faces": list(f.face_ids)}
            for view_id, f in v.confirmed
        ],
        "faces": [
            {
                "face": f.face_id,
                "label": f.label,
                "area_mm2": round(f.area_mm2, 2),
                "seen_fraction": round(f.seen_fraction, 4),
                "by_check": {name: round(share, 4) for name, share in f.by_check},
                "rest": {reason: round(share, 4) for reason, share in f.rest},
                "verdict": f.verdict.value,
                "views": list(f.views),
                "reason": f.reason,
            }
            for f in v.faces
        ],
    }
