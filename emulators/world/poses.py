"""Poses as 4x4 matrices in mm, and those of the arm's links; umi_rtx.md 6, read a second time."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .layout import ArmLayout, Array


class Joints(Protocol):
    """The true joints of the arm; umi_rtx.md 6.2, 6.3 (``yaw_rad`` is the yaw motor's)."""

    @property
    def shoulder_rad(self) -> float:
        """Angle of the shoulder."""

    @property
    def elbow_rad(self) -> float:
        """Angle of the elbow."""

    @property
    def yaw_rad(self) -> float:
        """Angle of the yaw motor."""

    @property
    def zed_mm(self) -> float:
        """Height of the carriage, 0 at the top."""

    @property
    def pitch_rad(self) -> float:
        """Angle of the wrist about its cross axis."""

    @property
    def roll_rad(self) -> float:
        """Angle of the wrist about the approach."""

    @property
    def jaw_opening_mm(self) -> float:
        """Distance between the pads."""


@dataclass(frozen=True, slots=True)
class JointValues:
    """Joint values by themselves, without an arm model."""

    shoulder_rad: float = 0.0
    elbow_rad: float = 0.0
    yaw_rad: float = 0.0
    zed_mm: float = 0.0
    pitch_rad: float = 0.0
    roll_rad: float = 0.0
    jaw_opening_mm: float = 85.0

    @property
    def of_links(self) -> tuple[float, ...]:
        """All values but the jaws'."""
        return (
            self.shoulder_rad, self.elbow_rad, self.yaw_rad,
            self.zed_mm, self.pitch_rad, self.roll_rad,
        )  # fmt: skip


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
    """Return the links' poses ``T_world_*``: carriage, upper, fore and arm gripper.

    Heading psi = shoulder + elbow / 2 + yaw, R = Rz(psi) Ry(-pitch) Rx(roll); umi_rtx.md 6.4.
    """
    s, e = joints.shoulder_rad, joints.elbow_rad
    z_mm = arm.wrist_height_mm + joints.zed_mm
    ex, ey = arm.upper_mm * math.cos(s), arm.upper_mm * math.sin(s)
    wx, wy = ex + arm.fore_mm * math.cos(s + e), ey + arm.fore_mm * math.sin(s + e)
    psi = s + e / 2.0 + joints.yaw_rad
    c, k = math.cos(psi), math.sin(psi)
    cp, sp = math.cos(joints.pitch_rad), math.sin(joints.pitch_rad)
    cr, sr = math.cos(joints.roll_rad), math.sin(joints.roll_rad)
    approach = (c * cp, k * cp, sp)
    reach = arm.tool_mm
    T_base_tcp = np.array(
        (
            (approach[0], -k * cr - c * sp * sr, k * sr - c * sp * cr, wx + reach * approach[0]),
            (approach[1], c * cr - k * sp * sr, -c * sr - k * sp * cr, wy + reach * approach[1]),
            (approach[2], cp * sr, cp * cr, z_mm + reach * approach[2]),
            (0.0, 0.0, 0.0, 1.0),
        )
    )
    base = arm.T_world_base
    off_y, off_z = arm.tool_off_mm
    T_base_tcp[:3, 3] += off_y * T_base_tcp[:3, 1] + off_z * T_base_tcp[:3, 2]
    return {
        "carriage": base @ turn_z(0.0, 0.0, 0.0, z_mm),
        "upper": base @ turn_z(s, 0.0, 0.0, z_mm),
        "fore": base @ turn_z(s + e, ex, ey, z_mm),
        "arm gripper": base @ T_base_tcp,
    }


# How one motor count (here: a small angle or length) changes the joints; wrist motors act together
MOTOR_EFFECT: Mapping[str, Mapping[str, float]] = {
    "shoulder": {"shoulder_rad": 1.0},
    "elbow": {"elbow_rad": 1.0},
    "yaw": {"yaw_rad": 1.0},
    "zed": {"zed_mm": 1.0},
    "wrist1": {"pitch_rad": 0.5, "roll_rad": 0.5},
    "wrist2": {"pitch_rad": 0.5, "roll_rad": -0.5},
}


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
