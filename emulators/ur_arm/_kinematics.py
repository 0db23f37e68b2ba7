"""Kinematics of the e-Series: link poses, inverse in closed form; universal_robots.md 1.

Poses are (4, 4) [mm]. A *pose vector* is what the wires carry: position [m] and rotation vector
[rad], in the base's frame.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ._facts import DH_ALPHA_RAD, JOINT_COUNT, Joints6, UrFacts

Array = NDArray[np.float64]

MM_PER_M: Final = 1000.0
_TURN: Final = 2.0 * math.pi
# Below this sine of wrist 2 the axes of wrist 1 and wrist 3 count as one: only their sum is known.
_WRIST_SINGULAR: Final = 1e-9
_ROUND: Final = 1e-9  # by how much rounding may carry a sine past 1


def link_poses(facts: UrFacts, q_rad: Sequence[float]) -> list[Array]:
    """Return the six frames ``T_base_link`` (4, 4) [mm], read-only; the last is the flange."""
    return list(_chain(facts, tuple(q_rad)))


@lru_cache(maxsize=8)  # a package of state asks for the same joints five times
def _chain(facts: UrFacts, q_rad: tuple[float, ...]) -> tuple[Array, ...]:
    T = np.eye(4)
    poses = []
    for q, a, d, alpha in zip(q_rad, facts.dh_a_mm, facts.dh_d_mm, DH_ALPHA_RAD, strict=True):
        T = T @ _dh(q, a, d, alpha)
        T.flags.writeable = False  # shared by all who ask
        poses.append(T)
    return tuple(poses)


def _dh(q: float, a: float, d: float, alpha: float) -> Array:
    c, s = math.cos(q), math.sin(q)
    ca, sa = math.cos(alpha), math.sin(alpha)
    return np.array(
        (
            (c, -s * ca, s * sa, a * c),
            (s, c * ca, -c * sa, a * s),
            (0.0, sa, ca, d),
            (0.0, 0.0, 0.0, 1.0),
        )
    )


def flange_pose(facts: UrFacts, q_rad: Sequence[float]) -> Array:
    """Return ``T_base_flange`` (4, 4) [mm], read-only."""
    return link_poses(facts, q_rad)[-1]


def inverse(facts: UrFacts, T_base_flange: Array, near_rad: Sequence[float]) -> list[Joints6]:
    """Return all joint positions that reach a pose, each turned next to ``near_rad``.

    Parameters
    ----------
    facts : the arm
    T_base_flange : (4, 4) [mm]
    near_rad : (6,) of full turns, and of wrist 3 where only its sum with wrist 1 is determined,
        the nearest to these are taken

    Returns
    -------
    up to eight joint positions [rad] within the joints' limits, nearest first
    """
    found = []
    wrist = T_base_flange @ np.array((0.0, 0.0, -facts.d6_mm, 1.0))
    for q1 in _bases(facts, wrist):
        s1, c1 = math.sin(q1), math.cos(q1)
        height = T_base_flange[0, 3] * s1 - T_base_flange[1, 3] * c1 - facts.d4_mm
        cosine = height / facts.d6_mm
        if abs(cosine) > 1.0 + _ROUND:
            continue
        bent = math.acos(max(-1.0, min(1.0, cosine)))
        for q5 in {bent, -bent}:
            q6 = _wrist3(T_base_flange, s1, c1, math.sin(q5), near_rad[5])
            found += _arms(facts, T_base_flange, (q1, q5, q6))
    turned = [_turned(q, near_rad, facts.limits_rad) for q in found]
    reached = [q for q in turned if q is not None]
    return sorted(reached, key=lambda q: max(abs(a - b) for a, b in zip(q, near_rad, strict=True)))


def _bases(facts: UrFacts, wrist: Array) -> list[float]:
    x, y = float(wrist[0]), float(wrist[1])
    reach = math.hypot(x, y)
    if reach < facts.d4_mm:
        return []
    side = math.acos(facts.d4_mm / reach)
    heading = math.atan2(y, x) + math.pi / 2
    return [heading + side, heading - side]


def _wrist3(T: Array, s1: float, c1: float, s5: float, near: float) -> float:
    if abs(s5) < _WRIST_SINGULAR:
        return near
    sine = (-T[0, 1] * s1 + T[1, 1] * c1) / s5
    cosine = (T[0, 0] * s1 - T[1, 0] * c1) / s5
    return math.atan2(sine, cosine)


def _arms(facts: UrFacts, T: Array, wrist: tuple[float, float, float]) -> list[Joints6]:
    """Return the joints of both elbows for given base, wrist 2 and wrist 3."""
    q1, q5, q6 = wrist
    a = facts.dh_a_mm
    T_01 = _dh(q1, a[0], facts.d1_mm, DH_ALPHA_RAD[0])
    T_45 = _dh(q5, a[4], facts.d5_mm, DH_ALPHA_RAD[4])
    T_56 = _dh(q6, a[5], facts.d6_mm, DH_ALPHA_RAD[5])
    T_14 = np.linalg.inv(T_01) @ T @ np.linalg.inv(T_45 @ T_56)
    # the origin of link 3, in the plane of upper arm and forearm
    x, y = (T_14 @ np.array((0.0, -facts.d4_mm, 0.0, 1.0)))[:2]
    span = math.hypot(x, y)
    cosine = (span**2 - a[1] ** 2 - a[2] ** 2) / (2.0 * a[1] * a[2])
    if abs(cosine) > 1.0 + _ROUND:
        return []
    bent = math.acos(max(-1.0, min(1.0, cosine)))
    arms: list[Joints6] = []
    for q3 in {bent, -bent}:
        q2 = math.atan2(y, x) - math.atan2(a[2] * math.sin(q3), a[1] + a[2] * math.cos(q3))
        T_12 = _dh(q2, a[1], 0.0, 0.0)
        T_23 = _dh(q3, a[2], 0.0, 0.0)
        T_34 = np.linalg.inv(T_12 @ T_23) @ T_14
        q4 = math.atan2(T_34[1, 0], T_34[0, 0])
        arms.append((q1, q2, q3, q4, q5, q6))
    return arms


def _turned(
    q_rad: Joints6, near_rad: Sequence[float], limits_rad: Sequence[float]
) -> Joints6 | None:
    turned = []
    for q, near, limit in zip(q_rad, near_rad, limits_rad, strict=True):
        best = q + _TURN * round((near - q) / _TURN)
        if abs(best) > limit + _ROUND:
            best -= math.copysign(_TURN, best)
        if abs(best) > limit + _ROUND:
            return None
        turned.append(best)
    one, two, three, four, five, six = turned
    return one, two, three, four, five, six


def jacobian(facts: UrFacts, q_rad: Sequence[float], T_flange_tcp: Array) -> Array:
    """Return the geometric Jacobian of the TCP.

    Parameters
    ----------
    facts : the arm
    q_rad : (6,) joints
    T_flange_tcp : (4, 4) [mm]

    Returns
    -------
    (6, 6) [mm/rad, rad/rad], in the base's frame
    """
    poses = np.array([np.eye(4), *_chain(facts, tuple(q_rad))])
    tip = (poses[-1] @ T_flange_tcp)[:3, 3]
    axes, arms = poses[:-1, :3, 2], tip - poses[:-1, :3, 3]
    columns = np.empty((6, JOINT_COUNT))
    for row in range(3):  # np.cross takes ten times as long for six small vectors
        one, two = (row + 1) % 3, (row + 2) % 3
        columns[row] = axes[:, one] * arms[:, two] - axes[:, two] * arms[:, one]
    columns[3:] = axes.T
    return columns


def pose_vector(T: Array) -> Joints6:
    """Return the pose vector (m, rad) of a pose (4, 4) [mm]."""
    R = T[:3, :3]
    cosine = max(-1.0, min(1.0, (float(np.trace(R)) - 1.0) / 2.0))
    angle = math.acos(cosine)
    twist = np.array((R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]))
    if angle < 1e-9:
        vector = twist / 2.0
    elif math.pi - angle < 1e-6:  # half a turn: the axis is the longest column of R + 1
        columns = R + np.eye(3)
        axis = columns[:, int(np.argmax(np.linalg.norm(columns, axis=0)))]
        vector = angle * axis / np.linalg.norm(axis)
    else:
        vector = twist * (angle / (2.0 * math.sin(angle)))
    x, y, z = (float(value) / MM_PER_M for value in T[:3, 3])
    rx, ry, rz = (float(value) for value in vector)
    return x, y, z, rx, ry, rz


def pose_of(vector: Sequence[float]) -> Array:
    """Return the pose (4, 4) [mm] of a pose vector (m, rad)."""
    T = np.eye(4)
    T[:3, 3] = np.asarray(vector[:3], dtype=float) * MM_PER_M
    w = np.asarray(vector[3:6], dtype=float)
    angle = float(np.linalg.norm(w))
    if angle > 0.0:
        k = w / angle
        K = np.array(((0.0, -k[2], k[1]), (k[2], 0.0, -k[0]), (-k[1], k[0], 0.0)))
        T[:3, :3] = np.eye(3) + math.sin(angle) * K + (1.0 - math.cos(angle)) * (K @ K)
    return T
