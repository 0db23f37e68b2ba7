"""Poses as 4x4 matrices in mm, and those of the arm's links."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .layout import ArmLayout
from .shapes import Array


class Joints(Protocol):
    """The true joints of an arm, and its jaws."""

    @property
    def q(self) -> Sequence[float]:
        """Values of the joints, in the order of its chain [rad, mm]."""
        ...

    @property
    def jaw_opening_mm(self) -> float:
        """Distance between the pads."""
        ...


@dataclass(frozen=True, slots=True)
class JointValues:
    """Joint values by themselves, without an arm model."""

    q: tuple[float, ...]
    jaw_opening_mm: float


def turn_z(angle_rad: float, x_mm: float = 0.0, y_mm: float = 0.0, z_mm: float = 0.0) -> Array:
    """Return the pose at (x, y, z) turned by an angle about z.

    Parameters
    ----------
    angle_rad : counter-clockwise, seen from +z
    x_mm, y_mm, z_mm : position of the origin

    Returns
    -------
    (4, 4) pose [mm]
    """
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array(((c, -s, 0.0, x_mm), (s, c, 0.0, y_mm), (0.0, 0.0, 1.0, z_mm), (0, 0, 0, 1.0)))


def forward(arm: ArmLayout, joints: Joints) -> dict[str, Array]:
    """Return the poses ``T_world_*`` of the arm's links, by name; the last is `chain.TCP`.

    Parameters
    ----------
    arm : the arm where it stands
    joints : its joints
    """
    return arm.chain.poses(arm.T_world_base, joints.q)


def invert(T: Array) -> Array:
    """Return the inverse of a pose."""
    inverse = np.eye(4)
    inverse[:3, :3] = T[:3, :3].T
    inverse[:3, 3] = -T[:3, :3].T @ T[:3, 3]
    return inverse


def transform(T: Array, points_mm: Array) -> Array:
    """Return points moved by a pose, (n, 3) -> (n, 3) [mm]."""
    moved: Array = points_mm @ T[:3, :3].T + T[:3, 3]
    return moved


def rotation_about(axis: Array, angle_rad: float) -> Array:
    """Return the rotation by an angle about a direction, (3, 3)."""
    k = axis / np.linalg.norm(axis)
    K = np.array(((0.0, -k[2], k[1]), (k[2], 0.0, -k[0]), (-k[1], k[0], 0.0)))
    R: Array = np.eye(3) + math.sin(angle_rad) * K + (1.0 - math.cos(angle_rad)) * (K @ K)
    return R


def rotation_angle(R: Array) -> float:
    """Return the angle of a rotation [rad]; exact for small angles too."""
    axis = np.array((R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]))
    return math.atan2(float(np.linalg.norm(axis)) / 2.0, (float(np.trace(R)) - 1.0) / 2.0)


def between(T_from: Array, T_to: Array, fraction: float) -> Array:
    """Return the pose at a fraction between one pose and another that is near it.

    Parameters
    ----------
    T_from, T_to : (4, 4) poses in one frame [mm], turned against each other by less than pi
    fraction : 0 gives the first pose, 1 the second

    Returns
    -------
    (4, 4) pose [mm]: the position on the straight line, the orientation about one fixed axis
    """
    R = T_from[:3, :3].T @ T_to[:3, :3]
    angle_rad = rotation_angle(R)
    T = np.eye(4)
    T[:3, :3] = T_from[:3, :3]
    if angle_rad > 1e-12:
        axis = np.array((R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]))
        T[:3, :3] = T_from[:3, :3] @ rotation_about(axis, fraction * angle_rad)
    T[:3, 3] = T_from[:3, 3] + fraction * (T_to[:3, 3] - T_from[:3, 3])
    return T


def quat_xyzw_of(R: Array) -> tuple[float, float, float, float]:
    """Return pybullet's quaternion of a rotation (Shepperd's method, the largest term first)."""
    m = R
    trace = m[0, 0] + m[1, 1] + m[2, 2]
    if trace > 0.0:
        s = 2.0 * math.sqrt(trace + 1.0)
        return (
            (m[2, 1] - m[1, 2]) / s,
            (m[0, 2] - m[2, 0]) / s,
            (m[1, 0] - m[0, 1]) / s,
            s / 4.0,
        )
    i = int(np.argmax(np.diag(m)))
    j, k = (i + 1) % 3, (i + 2) % 3
    s = 2.0 * math.sqrt(max(0.0, 1.0 + m[i, i] - m[j, j] - m[k, k]))
    q = [0.0, 0.0, 0.0, (m[k, j] - m[j, k]) / s]
    q[i], q[j], q[k] = s / 4.0, (m[j, i] + m[i, j]) / s, (m[k, i] + m[i, k]) / s
    return q[0], q[1], q[2], q[3]


def rotation_of(quat_xyzw: tuple[float, float, float, float]) -> Array:
    """Return the rotation of pybullet's quaternion, (3, 3)."""
    x, y, z, w = quat_xyzw
    return np.array(
        (
            (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
            (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
            (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
        )
    )
