"""The pose of the fixed gripper, out of every camera's sight, from touches of the plate it holds.

A plate between the fixed jaws is parallel to their pads and in the middle between them. The arm's
jaws close on it off its middle on purpose, so that it is known which pad touches, and its finger is
tilted, so that the tip does. Each touch is one point of the arm on one face of the plate.

Touches of both faces at several places determine the position of the jaws' plane along its normal,
and both its angles. A hand-off depends on these three. The other freedoms are along the pads, where
the arm takes a part back from the place it brought it to; they keep their set-up values.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from messages import say

from ..kinematics.layout import POSE, moved
from ..kinematics.uncertainty import radius_u

_OBSERVED: Final = 0.5  # a freedom is observed if its spread shrinks to this share
_OUTLIER_SIGMA: Final = 5.0
_ROUNDS: Final = 6
_STEP: Final = 1e-5
_NORMAL: Final = 4  # index of a pose's normal: along y, which the jaws open along
_TILTS: Final = (0, 2)  # indices about x and z: the inclination of that plane
_DECIDED: Final = (*_TILTS, _NORMAL, "opening")  # unknowns decided by touches


class TouchError(Exception):
    """The touches contradict each other; the message names one, and what to do about it."""


@dataclass(frozen=True, slots=True, eq=False)
class Touch:
    """A contact of one of the arm's fingers with the plate.

    Attributes
    ----------
    name : for messages
    T_world_tcp : (4, 4) pose of the arm at the contact
    opening_mm : opening of its jaws when they stopped
    pad : pad of its fingers that touched, 1 or -1 along the arm's y
    face : touched face of the plate, 1 or -1 along the fixed gripper's y
    """

    name: str
    T_world_tcp: FloatArray
    opening_mm: float
    pad: int
    face: int


@dataclass(frozen=True, slots=True)
class TouchNoise:
    """Standard deviations of touches.

    Attributes
    ----------
    touch_mm : largest error of one touch by itself: counts, contact, compliance. The distance of
        the touches from the faces replaces it, down to `least_mm`
    least_mm : smallest error of one touch
    opening_mm : opening of all openings together, after the arm's calibration
    arm_mm, arm_rad : error of the arm's pose, common to all touches
    """

    touch_mm: float
    least_mm: float
    opening_mm: float
    arm_mm: float
    arm_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class FixedGripperFit:
    """The fixed gripper as touched.

    Attributes
    ----------
    T_world_tcp : (4, 4)
    cov : (6, 6) covariance of rotation [rad] and position [mm], about its own axes
    u_mm, u_rad : standard uncertainty of the jaws' plane at the TCP, along its normal; half the
        angle that holds 95 % of its tilt
    observed, held : its freedoms by name, in its own frame
    opening_off_mm : excess of the arm's opening over its reading
    rms_mm : rms distance of the touches from the plate's faces
    """

    T_world_tcp: FloatArray
    cov: FloatArray
    u_mm: float
    u_rad: float
    observed: tuple[str, ...]
    held: tuple[str, ...]
    opening_off_mm: float
    rms_mm: float


def locate_fixed_gripper(
    T_world_tcp: FloatArray,
    std: FloatArray,
    touches: Sequence[Touch],
    *,
    thickness_mm: float,
    finger_width_mm: float,
    noise: TouchNoise,
) -> FixedGripperFit:
    """Return the pose of the fixed gripper that agrees best with all touches.

    Parameters
    ----------
    T_world_tcp : (4, 4) as the cell file has it
    std : (6,) standard deviations of rotation [rad], then position [mm], about its own axes
    touches : on both faces of the plate
    thickness_mm : thickness of the plate
    finger_width_mm : width of the arm's fingers, whose tips' edges touch
    noise : noise of the touches

    Raises
    ------
    TouchError : a touch contradicts all others
    """
    spread = np.append(np.asarray(std, dtype=np.float64), noise.opening_mm)
    cov, y = np.diag(spread**2), np.zeros(7)
    after, off = cov, np.zeros(0)

    def off_mm(at: FloatArray) -> FloatArray:
        T = _placed(T_world_tcp, at[:6])
        shape = (thickness_mm, finger_width_mm)
        return np.array([_off_mm(T, touch, at[6], *shape) for touch in touches])

    touch_mm = noise.touch_mm
    if touches:
        for number in range(2 * _ROUNDS):
            off = off_mm(y)
            if number == _ROUNDS:
                _check(touches, off / touch_mm)
                free = max(1, len(off) - len(_DECIDED))
                touch_mm = max(noise.least_mm, float(np.sqrt(np.sum(off**2) / free)))
            steps = _STEP * np.diag(np.where(spread > 0, spread, 1.0))
            jac = np.stack([(off_mm(y + d) - off_mm(y - d)) / (2 * d.sum()) for d in steps], axis=1)
            across = jac @ cov
            gain = np.linalg.solve(across @ jac.T + touch_mm**2 * np.eye(len(off)), across).T
            y = gain @ (jac @ y - off)
            after = cov - gain @ across
        off = off_mm(y)
    own = (after[:6, :6] + after[:6, :6].T) / 2.0
    left = np.sqrt(np.diag(own)) / std
    if touches:
        common = np.zeros(6)
        common[[*_TILTS, _NORMAL]] = noise.arm_rad, noise.arm_rad, noise.arm_mm
        own = own + np.diag(common**2)
    names = np.array(POSE)
    return FixedGripperFit(
        _placed(T_world_tcp, y[:6]),
        own,
        float(np.sqrt(own[_NORMAL, _NORMAL])),
        radius_u(own[np.ix_(_TILTS, _TILTS)]),
        tuple(names[left < _OBSERVED].tolist()),
        tuple(names[left >= _OBSERVED].tolist()),
        float(y[6]),
        float(np.sqrt(np.mean(off**2))) if len(off) else 0.0,
    )


def _placed(T: FloatArray, d: FloatArray) -> FloatArray:
    """Return a pose turned and moved by (6,) about and along its own axes."""
    out: FloatArray = T @ moved(np.eye(4), d)
    return out


def _off_mm(
    T_world_fixed: FloatArray,
    touch: Touch,
    wider_mm: float,
    thickness_mm: float,
    finger_width_mm: float,
) -> float:
    """Return how far the nearest point of a finger's tip is off the plate's face, outwards."""
    across = touch.pad * (touch.opening_mm + wider_mm) / 2.0
    half = finger_width_mm / 2.0
    tip = np.array([[0.0, across, -half], [0.0, across, half]])
    T = touch.T_world_tcp
    tip = tip @ T[:3, :3].T + T[:3, 3]
    height = (tip - T_world_fixed[:3, 3]) @ T_world_fixed[:3, 1]
    return float((touch.face * height).min()) - thickness_mm / 2.0


def _check(touches: Sequence[Touch], off_sigma: FloatArray) -> None:
    worst = int(np.abs(off_sigma).argmax())
    if abs(off_sigma[worst]) > _OUTLIER_SIGMA:
        raise TouchError(
            say(
                "{name} is {off_sigma:.0f} standard deviations off the plane of "
                "the other touches, {outlier_sigma:g} are allowed; something else "
                "was touched, or the plate moved: clean the pads, repeat it",
                name=touches[worst].name,
                off_sigma=abs(off_sigma[worst]),
                outlier_sigma=_OUTLIER_SIGMA,
            )
        )
