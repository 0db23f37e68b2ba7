"""Why a piece of surface is not seen: lift one limit at a time (planning.md 1.3)."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from drivers.umi_scara.kinematics import inverse, limit_report

from .boxes import BoolArray
from .layout import CellLayout
from .motion import Scene, inverse_rows
from .plan import Reason, Unseen
from .prepared import PreparedPart
from .views import view_poses

LEAST_SHARE = 2e-4  # of the surface; less than this is single samples on edges


def unseen_pieces(
    part: PreparedPart,
    layout: CellLayout,
    seen: BoolArray,
    used: Sequence[int],
    within_reach: Collection[int],
) -> tuple[Unseen, ...]:
    """Return what is not seen (n,) per face with its reason.

    Parameters
    ----------
    used : arm grips of the plan; within_reach : arm grips any hand-off from here leads to
    """
    weights = part.weights
    by_part = ~part.visible.any(axis=0)
    shown_somewhere = np.any([s.any(axis=0) for s in part.shown], axis=0)
    coverable = part.covered.any(axis=0)
    here = (
        part.covered[sorted(within_reach)].any(axis=0) if within_reach else np.zeros_like(coverable)
    )
    in_grips = part.covered[sorted(set(used))].any(axis=0)
    angle = part.options.max_incidence_deg
    classes = [
        (
            Reason.HIDDEN_BY_PART,
            by_part,
            f"hidden by the part itself at {angle:.0f} degrees of incidence or less",
        ),
        (Reason.FINGERS, ~by_part & ~shown_somewhere, "hidden by the fingers in every grip"),
        (Reason.REACH, shown_somewhere & ~coverable, ""),
        (
            Reason.NO_REGRASP_PATH,
            coverable & ~here,
            "no re-grip path from this pose to a grip that shows it",
        ),
        (
            Reason.LEFT_OUT,
            here & ~in_grips,
            "under the fingers or out of reach in the chosen grips; "
            "a further hand-off would show it",
        ),
        (
            Reason.LEFT_OUT,
            in_grips,
            f"left out: one more view would add less than {part.options.least_gain:.1%} "
            "of the surface, or the arm itself is in the way",
        ),
    ]
    found = []
    for kind, mask, reason in classes:
        missing = mask & ~seen
        for face_id in np.unique(part.samples.face_ids[missing]):
            piece = missing & (part.samples.face_ids == face_id)
            share = float(weights[piece].sum())
            if share >= LEAST_SHARE:
                text = reason or _reach_reason(part, layout, piece)
                found.append(Unseen(int(face_id), share, text, kind))
    return tuple(sorted(found, key=lambda u: (-u.area_fraction, u.face_id, u.reason)))


def _reach_reason(part: PreparedPart, layout: CellLayout, piece: BoolArray) -> str:
    """Name the limit that stands between the arm and the best view of a piece."""
    gains = np.stack([s[:, piece].sum(axis=1) for s in part.shown])
    grip, view = np.unravel_index(int(np.argmax(gains)), gains.shape)
    T, inside = view_poses(part.solid, layout, part.directions.vectors[view : view + 1])
    if not inside.any():
        return "out of the picture: the part is larger than the camera's field at the station"
    T_tip = T[0][inside[0]] @ part.arm_grips[int(grip)].T_part_hand
    index, _, q = inverse_rows(layout, T_tip)
    if len(index):
        held = part.arm_grips[int(grip)]
        scene = Scene(layout, held.opening_mm, layout.fixture_open_mm, part.carried_box(held))
        blockers = {scene.names()[k] for k in scene.contacts(q) if k >= 0}
        return f"out of reach: the arm would touch {', '.join(sorted(blockers)) or 'nothing'}"
    every, _ = inverse(np.linalg.inv(layout.T_world_arm) @ T_tip, layout.arm)
    every = every.reshape(-1, 6)
    every = every[np.isfinite(every).all(axis=1)]
    return (
        f"out of reach: {limit_report(every[0]) if len(every) else 'beyond the outstretched arm'}"
    )
