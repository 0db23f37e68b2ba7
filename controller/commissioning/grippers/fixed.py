"""The pose of the fixed gripper, out of every camera's sight, from what the arm touches there.

Every observation is one point on one plane: a point that the arm knows (of its own pads, or of the
plate in its jaws, whose pose pictures have shown) lies on a plane of the fixed gripper. Which of
its six freedoms a touch shows, its plane decides:

- The plate between the fixed jaws is parallel to their pads and in the middle between them. The
  arm's jaws closing on it stop at its faces: planes along y. Touches at several places of the plate
  show the offset along y and both angles of the jaws' plane.
- The plate's edge against the side of a finger: planes along z, for the offset along z. A finger is
  too short a lever for the angle about y, which is left as it was set up.
- The plate's edge against the finger tips: a plane along x, for the offset along the approach.

A hand-off depends on the first three only: the other freedoms are along the pads, where the arm
takes a part back from where it has brought it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.commissioning.kinematics import CellFit
from controller.commissioning.kinematics.layout import POSE, moved
from controller.commissioning.kinematics.uncertainty import radius_u

_OBSERVED: Final = 0.5  # a freedom is observed if its spread shrinks to this share
_OUTLIER_SIGMA: Final = 5.0
_ROUNDS: Final = 6
_STEP: Final = 1e-4


class TouchError(Exception):
    """The touches contradict each other; the message says which, and what to do about it."""


class Axis(IntEnum):
    """An axis of the fixed gripper's TCP frame, along which a plane of it is known."""

    X = 0  # the finger tips end at 0
    Y = 1  # along which the jaws open
    Z = 2  # across the fingers


@dataclass(frozen=True, slots=True, eq=False)
class Touch:
    """A contact at the fixed gripper.

    Attributes
    ----------
    name : for messages
    q : (6,) joints at the contact, as the counters had them
    point_mm : (3,) what touched, in the arm's TCP frame
    axis, at_mm : the plane that was touched, in the fixed gripper's TCP frame
    std_mm : of the contact: how late it is noticed, how much gives in
    """

    name: str
    q: FloatArray
    point_mm: FloatArray
    axis: Axis
    at_mm: float
    std_mm: float = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class FixedGripperFit:
    """The fixed gripper as touched.

    Attributes
    ----------
    T_world_tcp : (4, 4)
    cov : (6, 6) of rotation [rad] and position [mm], about its own axes
    u_mm, u_rad : half the radius that holds 95 %
    observed, held : its freedoms by name, in its own frame
    rms_sigma : of the touches from their planes, in standard deviations
    """

    T_world_tcp: FloatArray
    cov: FloatArray
    u_mm: float
    u_rad: float
    observed: tuple[str, ...]
    held: tuple[str, ...]
    rms_sigma: float


def plate_touch(
    name: str, q: FloatArray, opening_mm: float, side: int, pad_x_mm: float, thickness_mm: float
) -> Touch:
    """Return the contact of one pad with the plate that the fixed gripper holds alone.

    The arm's jaws are off the plate's middle on purpose, so that it is known which pad touches.

    Parameters
    ----------
    name : for messages
    q : (6,) joints
    opening_mm : of the arm's jaws when they stopped, zero corrected
    side : of the arm's pad that touched, 1 or -1 along its y
    pad_x_mm : the middle of the pads, from the TCP
    thickness_mm : of the plate

    Notes
    -----
    Both grippers' y point the same way, up to less than a right angle; a pad at positive y of the
    arm touches the plate's face at positive y of the fixed gripper.
    """
    return Touch(
        name,
        np.asarray(q, dtype=np.float64),
        np.array([pad_x_mm, side * opening_mm / 2.0, 0.0]),
        Axis.Y,
        side * thickness_mm / 2.0,
    )


def locate_fixed_gripper(
    fit: CellFit, T_world_tcp: FloatArray, std: FloatArray, touches: Sequence[Touch]
) -> FixedGripperFit:
    """Return the pose of the fixed gripper that agrees best with all touches.

    Parameters
    ----------
    fit : of the cell; its covariance is what the arm itself leaves uncertain
    T_world_tcp : (4, 4) as the cell file has it
    std : (6,) how far off that is, rotation [rad] then position [mm]
    touches : points on planes

    Raises
    ------
    TouchError : a touch contradicts all others
    """
    size = fit.layout.size
    cov = np.zeros((size + 6, size + 6))
    cov[:size, :size] = fit.cov
    # the freedoms are about the gripper's own axes: what a touch shows is along one of them
    cov[size:, size:] = np.diag(np.asarray(std, dtype=np.float64) ** 2)
    first = np.concatenate([fit.x, np.zeros(6)])
    y, after, off = first, cov, np.zeros(0)
    for _ in range(_ROUNDS):
        parts = [_predicted(fit, T_world_tcp, touch, y) for touch in touches]
        if not parts:
            break
        off = np.array([part[0] for part in parts])
        jac = np.array([part[1] for part in parts])
        across = jac @ cov
        gain = np.linalg.solve(across @ jac.T + np.eye(len(off)), across).T
        y = first + gain @ (jac @ (y - first) - off)
        after = cov - gain @ across
    _check(touches, off)
    own = (after[size:, size:] + after[size:, size:].T) / 2.0
    left = np.sqrt(np.diag(own)) / std
    names = np.array(POSE)
    return FixedGripperFit(
        _placed(T_world_tcp, y[size:]),
        own,
        radius_u(own[3:, 3:]),
        radius_u(own[:3, :3]),
        tuple(names[left < _OBSERVED].tolist()),
        tuple(names[left >= _OBSERVED].tolist()),
        float(np.sqrt(np.mean(off**2))) if len(off) else 0.0,
    )


def _placed(T: FloatArray, d: FloatArray) -> FloatArray:
    """Return a pose turned and moved by (6,) about and along its own axes."""
    out: FloatArray = T @ moved(np.eye(4), d)
    return out


def _predicted(
    fit: CellFit, T_world_fixed: FloatArray, touch: Touch, y: FloatArray
) -> tuple[float, FloatArray]:
    """Return how far a touch is off its plane, and the derivatives (m + 6,), by its deviation."""
    layout = fit.layout
    arm, q = layout.prior.arm, np.asarray(touch.q, dtype=np.float64)

    def off_mm(at: FloatArray, joints: FloatArray) -> float:
        x = at[: layout.size]
        T = layout.T_world_arm(x) @ arm.tcp(joints[None], layout.arm_values(x))[0]
        p_world = T[:3, :3] @ touch.point_mm + T[:3, 3]
        fixed = _placed(T_world_fixed, at[layout.size :])
        return float((p_world - fixed[:3, 3]) @ fixed[:3, int(touch.axis)]) - touch.at_mm

    by = np.zeros(len(y))
    scale = np.concatenate([layout.std, [1e-2] * 3, [1.0] * 3])
    columns = [*range(layout.size, len(y))]
    for key in ("base", "arm"):
        at = layout.where(key)
        columns += range(at.start, at.stop)
    for i in columns:
        d = np.zeros(len(y))
        d[i] = _STEP * scale[i]
        by[i] = (off_mm(y + d, q) - off_mm(y - d, q)) / (2.0 * d[i])
    by_joints = np.array([(off_mm(y, q + d) - off_mm(y, q - d)) / 2e-5 for d in 1e-5 * np.eye(6)])
    std_mm = float(np.hypot(touch.std_mm, np.linalg.norm(by_joints * fit.joint_std)))
    return off_mm(y, q) / std_mm, by / std_mm


def _check(touches: Sequence[Touch], off: FloatArray) -> None:
    for touch, sigma in zip(touches, off, strict=True):
        if abs(sigma) > _OUTLIER_SIGMA:
            raise TouchError(
                f"{touch.name} is {abs(sigma):.0f} standard deviations off the plane of the other "
                f"touches, {_OUTLIER_SIGMA:g} are allowed; something else was touched, repeat it"
            )
