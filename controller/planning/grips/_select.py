"""Which of many grips to plan with: few, sure, and unlike each other (planning.md 2.2, step 7)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from controller.cad import Solid, StablePose

from ..boxes import lowest_z, stack
from ..grip import TABLE_MARGIN_MM, Grip
from ..layout import FloatArray, Jaw

STEEPEST = -0.5  # z of the approach direction at a pick: within 60 degrees of straight down


def resting_pose(
    solid: Solid, pose: StablePose, x_mm: float = 0.0, y_mm: float = 0.0, theta_rad: float = 0.0
) -> FloatArray:
    """Return T_world_part of a part lying in a stable pose, its centre of mass over (x, y)."""
    c, s = np.cos(theta_rad), np.sin(theta_rad)
    T = np.eye(4)
    T[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ pose.R
    hull = np.asarray(solid.mesh.convex_hull.vertices)
    turned = (hull - solid.centroid_mm) @ T[:3, :3].T
    T[:3, 3] = np.array([x_mm, y_mm, -turned[:, 2].min()]) - T[:3, :3] @ solid.centroid_mm
    return T


def clear_of_table(T_world_part: FloatArray, grips: Sequence[Grip], jaw: Jaw) -> FloatArray:
    """Tell which grips keep the open hand off the table and come from above: (n,) bool."""
    T = T_world_part @ np.stack([g.T_part_hand for g in grips])
    ok = T[:, 2, 0] <= STEEPEST
    for k in np.flatnonzero(ok).tolist():
        T_box, half = stack([*jaw.body, *jaw.fingers(grips[k].pre_open_mm)])
        ok[k] = lowest_z(T[k] @ T_box, half).min() >= TABLE_MARGIN_MM
    return np.asarray(ok)


def spread(grips: Sequence[Grip], members: Sequence[int], count: int) -> list[int]:
    """Return up to `count` of the members, sure ones first, then by how unlike the chosen."""
    if len(members) == 0:
        return []
    T = np.stack([grips[k].T_part_hand for k in members])
    score = np.array([grips[k].score for k in members])
    axis = T[:, :3, 1]
    features = np.hstack(
        [
            T[:, :3, 0],
            np.einsum("ni,nj->nij", axis, axis).reshape(-1, 9),  # blind to the axis' sign
            T[:, :3, 3] / 40.0,
        ]
    )
    chosen = [int(np.argmax(score))]
    distance = np.linalg.norm(features - features[chosen[0]], axis=1)
    while len(chosen) < min(count, len(members)):
        k = int(np.argmax(distance * (0.4 + score)))
        if distance[k] < 1e-6:
            break
        chosen.append(k)
        distance = np.minimum(distance, np.linalg.norm(features - features[k], axis=1))
    return [members[k] for k in chosen]


def select_arm_grips(
    solid: Solid,
    poses: Sequence[StablePose],
    grips: Sequence[Grip],
    jaw: Jaw,
    per_pose: int,
    others: int,
) -> list[Grip]:
    """Return grips to pick each stable pose with, and grips from all round for after a hand-off."""
    chosen: list[int] = []
    for pose in poses:
        able = np.flatnonzero(clear_of_table(resting_pose(solid, pose), grips, jaw))
        chosen += spread(grips, [int(k) for k in able], per_pose)
    chosen += spread(grips, range(len(grips)), others)
    return [grips[k] for k in dict.fromkeys(chosen)]


def turned_over(grip: Grip) -> Grip:
    """Return the same grip with the hand turned half a turn about its approach."""
    T = grip.T_part_hand @ np.diag([1.0, -1.0, -1.0, 1.0])
    return replace(grip, id=f"{grip.id}'", T_part_hand=T)
