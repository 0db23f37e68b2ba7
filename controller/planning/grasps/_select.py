"""Choice of grasps to plan with: few, sure, different; planning-facts.md 2.2, step 7."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.cad import Solid, StablePose

from ..geometry import lowest_z, stack
from ..model import TABLE_MARGIN_MM, Grasp, Jaw
from .clearance import STEEPEST


def resting_pose(
    solid: Solid, pose: StablePose, x_mm: float = 0.0, y_mm: float = 0.0, theta_rad: float = 0.0
) -> FloatArray:
    """Return T_world_part (4, 4) of a part in a stable pose (conventions.md 4).

    Parameters
    ----------
    solid : the part
    pose : the stable pose
    x_mm, y_mm : position of the centre of mass in the world
    theta_rad : anticlockwise about +z
    """
    c, s = np.cos(theta_rad), np.sin(theta_rad)
    T = np.eye(4)
    T[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ pose.R
    hull = solid.hull_mm
    turned = (hull - solid.centroid_mm) @ T[:3, :3].T
    T[:3, 3] = np.array([x_mm, y_mm, -turned[:, 2].min()]) - T[:3, :3] @ solid.centroid_mm
    return T


def clear_of_table(T_world_part: FloatArray, grasps: Sequence[Grasp], jaw: Jaw) -> FloatArray:
    """Return a mask (n,) of the grasps from above whose open gripper clears the table.

    Parameters
    ----------
    T_world_part : (4, 4) pose of the part on the table
    grasps : at least one
    jaw : the gripper, with fingers and body
    """
    T = T_world_part @ np.stack([g.T_part_tcp for g in grasps])
    ok = T[:, 2, 0] <= STEEPEST
    for k in np.flatnonzero(ok).tolist():
        T_box, half = stack([*jaw.body, *jaw.fingers(grasps[k].open_gap_mm(jaw))])
        ok[k] = lowest_z(T[k] @ T_box, half).min() >= TABLE_MARGIN_MM
    return np.asarray(ok)


def cover(
    T: FloatArray, score: FloatArray, picks: BoolArray, count: int, per_pose: int
) -> list[int]:
    """Return the indices of a diverse set of reliable grasps.

    First those that take the part from above in each stable pose, then from all round;
    farthest-point selection in approach, jaws' axis and position, larger scores a little nearer
    (planning-facts.md 2.2, step 7).

    Parameters
    ----------
    T : (n, 4, 4) T_part_tcp
    score : (n,) larger is surer
    picks : (k, n) picks of each stable pose, which grasps take the part from the table
    count : at most so many in all; with no more than that to choose from, all are returned
    per_pose : at most so many for each stable pose
    """
    if len(T) <= count:
        return list(range(len(T)))
    share = min(per_pose, max(1, count // (2 * max(1, len(picks)))))
    chosen: list[int] = []
    features = _features(T)
    for able in picks:
        members = np.flatnonzero(able)
        chosen += members[_unlike(features[members], score[members], share, [])].tolist()
    chosen = list(dict.fromkeys(chosen))
    return _unlike(features, score, count, chosen)


def spread(grasps: Sequence[Grasp], members: Sequence[int], count: int) -> list[int]:
    """Return some of the members: reliable ones first, then those most unlike the chosen.

    Parameters
    ----------
    grasps : all grasps
    members : numbers of those to choose from
    count : at most so many
    """
    if len(members) == 0:
        return []
    features = _features(np.stack([grasps[k].T_part_tcp for k in members]))
    score = np.array([grasps[k].score for k in members])
    return [members[k] for k in _unlike(features, score, count, [])]


def _features(T: FloatArray) -> FloatArray:
    axis = T[:, :3, 1]
    return np.hstack(
        [
            T[:, :3, 0],
            np.einsum("ni,nj->nij", axis, axis).reshape(-1, 9),  # blind to the axis' sign
            T[:, :3, 3] / 40.0,
        ]
    )


def _unlike(features: FloatArray, score: FloatArray, count: int, chosen: list[int]) -> list[int]:
    """Return `chosen` extended up to `count` by the member farthest from all chosen."""
    if len(features) == 0:
        return []
    chosen = chosen or [int(np.argmax(score))]
    distance = np.full(len(features), np.inf)
    for k in chosen:
        distance = np.minimum(distance, np.linalg.norm(features - features[k], axis=1))
    while len(chosen) < min(count, len(features)):
        k = int(np.argmax(distance * (0.4 + score)))
        if distance[k] < 1e-6:
            break
        chosen.append(k)
        distance = np.minimum(distance, np.linalg.norm(features - features[k], axis=1))
    return chosen


def select_arm_grasps(
    solid: Solid,
    poses: Sequence[StablePose],
    grasps: Sequence[Grasp],
    jaw: Jaw,
    per_pose: int,
    others: int,
) -> list[Grasp]:
    """Return grasps to pick each stable pose with, and grasps from all round for hand-offs.

    Parameters
    ----------
    solid : the part
    poses : its stable poses
    grasps : grasps of the arm gripper, to choose from
    jaw : the arm gripper
    per_pose : at most so many for each stable pose
    others : at most so many from all round
    """
    chosen: list[int] = []
    for pose in poses:
        able = np.flatnonzero(clear_of_table(resting_pose(solid, pose), grasps, jaw))
        chosen += spread(grasps, [int(k) for k in able], per_pose)
    anywhere = [k for k, grasp in enumerate(grasps) if not grasp.on_table]
    chosen += spread(grasps, anywhere, others)
    return [grasps[k] for k in dict.fromkeys(chosen)]


def turned_over(grasp: Grasp) -> Grasp:
    """Return the same grasp with the gripper turned half a turn about its approach."""
    T = grasp.T_part_tcp @ np.diag([1.0, -1.0, -1.0, 1.0])
    return replace(grasp, id=f"{grasp.id}'", T_part_tcp=T)
