"""What is known of the part at hand and of the run, and how the journal keeps it."""

import asyncio
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller import inspection as inspecting
from controller.planning import Plan
from controller.recognition import Sighting

from .custody import Custody

Array = NDArray[np.float64]
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


@dataclass(slots=True)
class PartRecord:
    """All that is known of the part at hand."""

    number: int
    custody: Custody = Custody.ON_TABLE
    pictures: dict[str, Grey] = field(default_factory=dict)
    sighting: Sighting | None = None
    plan: Plan | None = None
    next_step: int = 0
    grip_tries: int = 0
    gripped_mm: float = 0.0
    T_part_hand: Array | None = None
    is_hold_seen: bool = False
    pending: list[tuple[Array, asyncio.Task[inspecting.ViewResult]]] = field(default_factory=list)
    results: list[inspecting.ViewResult] = field(default_factory=list)
    verdict: inspecting.PartVerdict | None = None
    tray: str | None = None


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
                "verdict": f.verdict.value,
                "views": list(f.views),
                "reason": f.reason,
            }
            for f in v.faces
        ],
    }
