"""Play of the gears, and repeatability of homing: the same counts approached in several ways.

Both compare pictures of one stop with each other, so that errors of the cell's model are the same
in all of them and drop out: each stop gets a free pose of its board. The rest is caused by the
gears. A motor that comes from above leaves its joint higher than one from below, by all of the
play; the arm's model has the joints that each motor turns (a wrist motor turns pitch and roll).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.arrays import BoolArray, FloatArray
from messages import say

from ._types import BoardPicture, KinematicsError
from .layout import PictureTerms, UnknownsLayout
from .noise import corner_noise_px, in_line, whitening
from .uncertainty import radius_u

_OUTLIER_SIGMA: Final = 5.0
_NOISE_MIN_PX: Final = 0.02
_U_MAX_RAD: Final = np.radians(0.1)  # a play with a larger uncertainty is not reported
_HOMINGS_MIN: Final = 3


@dataclass(frozen=True, slots=True, eq=False)
class StopPicture:
    """A picture of a stop.

    Attributes
    ----------
    stop : number of the stop; all pictures of one have the same counts, but for a few
    above : motors that came from above; all others came from below
    """

    picture: BoardPicture
    stop: str
    above: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True)
class Play:
    """Play of one motor's gears, from one flank to the other, with its standard uncertainty.

    Both are angles of the motor's own scale.
    """

    rad: float
    u_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class HomingScatter:
    """Difference of the arm from itself after another homing.

    Attributes
    ----------
    joint_std : (6,) standard deviation of each joint's zero [rad, mm]
    tcp_mm, tcp_rad : standard uncertainty of the TCP, half the radius that holds 95 %
    homing_count : number of homings of the homings compared
    """

    joint_std: FloatArray
    tcp_mm: float
    tcp_rad: float
    homing_count: int


def measure_play(
    layout: UnknownsLayout,
    x: FloatArray,
    stops: Sequence[StopPicture],
    motors: Mapping[str, FloatArray],
) -> dict[str, Play]:
    """Return the play of each motor's gears.

    Nothing for an arm without geared motors.

    Parameters
    ----------
    layout, x : the cell as it is known, roughly is enough
    stops : for each motor at least one stop that it came to from above, and from below
    motors : rates of the joints for each motor, per radian of its own scale

    Raises
    ------
    KinematicsError : the pictures do not show a motor's play
    ValueError : a picture shows a board that lies on the table
    """
    if not motors:
        return {}
    for motor in motors:
        _check_both_sides(motor, stops)
    terms, noise_px, used = _measured(layout, x, [s.picture for s in stops])
    places = sorted({s.stop for s in stops})
    names = list(motors)
    size = len(names) + 6 * len(places)
    normal, pull = np.zeros((size, size)), np.zeros(size)
    rows_count, square = 0, 0.0
    for stop, one, keep in zip(stops, terms, used, strict=True):
        white = whitening(one, keep, noise_px, layout.prior.joint_std)
        if one.by_joints is None:
            raise ValueError(f"{stop.picture.name} shows no board in the gripper")
        by = np.zeros((2 * len(keep), size))
        turned = one.by_joints.reshape(-1, 6)
        for i, name in enumerate(names):
            side = 0.5 if name in stop.above else -0.5
            by[:, i] = side * (turned @ motors[name])
        at = len(names) + 6 * places.index(stop.stop)
        by[:, at : at + 6] = one.by_board.reshape(-1, 6)
        by, r = white.apply(by), white.apply(-one.residual_px.ravel())
        normal += by.T @ by
        pull += by.T @ r
        square += float(r @ r)
        rows_count += 2 * int(keep.sum())
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-30))
    inverse = np.linalg.pinv(normal * np.outer(scale, scale), rcond=1e-12) * np.outer(scale, scale)
    found = inverse @ pull
    misfit = max(0.0, square - float(pull @ found)) / max(1, rows_count - size)
    u = np.sqrt(np.diag(inverse) * max(1.0, misfit))
    for i, name in enumerate(names):
        if u[i] > _U_MAX_RAD:
            raise KinematicsError(
                say(
                    "the pictures show the play of {name} to {degrees:.2f} deg only; "
                    "take stops at which it turns the board more",
                    name=name,
                    degrees=np.degrees(u[i]),
                )
            )
    return {name: Play(float(found[i]), float(u[i])) for i, name in enumerate(names)}


def measure_homing(
    layout: UnknownsLayout, x: FloatArray, stops: Sequence[StopPicture], homings: Sequence[int]
) -> HomingScatter:
    """Return the repeatability of homing.

    Parameters
    ----------
    layout, x : the cell as it is known, roughly is enough
    stops : the same stops after each homing, all gone to in the same way
    homings : (n,) number of the homing before each picture

    Raises
    ------
    KinematicsError : fewer than three homings
    """
    count = len(set(homings))
    if count < _HOMINGS_MIN:
        raise KinematicsError(
            say(
                "{count} homings cannot show how well homing repeats; {homings_min} are required",
                count=count,
                homings_min=_HOMINGS_MIN,
            )
        )
    terms, noise_px, used = _measured(layout, x, [s.picture for s in stops])
    shifts: dict[int, list[FloatArray]] = {n: [] for n in sorted(set(homings))}
    tcp: dict[int, list[FloatArray]] = {n: [] for n in shifts}
    for stop in sorted({s.stop for s in stops}):
        at = [i for i, s in enumerate(stops) if s.stop == stop]
        joints = np.array([_joint_shift(layout, terms[i], used[i], noise_px) for i in at])
        joints -= joints.mean(axis=0)
        q = np.array([stops[i].picture.q for i in at], dtype=np.float64)
        T, by = layout.arm_derivatives(x, q[:1])
        by_joint = by[-6:, 0]
        spin = np.einsum("kij,lj->kil", by_joint[:, :3, :3], T[0, :3, :3])
        turned = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
        for i, d in zip(at, joints, strict=True):
            shifts[homings[i]].append(d)
            tcp[homings[i]].append(np.concatenate([d @ turned, d @ by_joint[:, :3, 3]]))
    means = np.array([np.mean(one, axis=0) for one in shifts.values()])
    poses = np.array([np.mean(one, axis=0) for one in tcp.values()])
    cov = np.cov(poses.T)
    return HomingScatter(
        means.std(axis=0, ddof=1), radius_u(cov[3:, 3:]), radius_u(cov[:3, :3]), count
    )


def _check_both_sides(motor: str, stops: Sequence[StopPicture]) -> None:
    """Raise KinematicsError unless some stop was approached from both sides of a motor."""
    for stop in {s.stop for s in stops}:
        if len({motor in s.above for s in stops if s.stop == stop}) == 2:
            return
    raise KinematicsError(
        say(
            "no stop was gone to from both sides of {motor}, so its play cannot be measured",
            motor=motor,
        )
    )


def _measured(
    layout: UnknownsLayout, x: FloatArray, pictures: Sequence[BoardPicture]
) -> tuple[list[PictureTerms], float, list[BoolArray]]:
    """Return the pictures' terms, the noise of their corners [px], and which corners count."""
    terms = layout.evaluate(x, pictures)
    used = [np.ones(len(t.residual_px), dtype=bool) for t in terms]
    noise_px = _NOISE_MIN_PX
    for _ in range(2):
        noise_px = max(_NOISE_MIN_PX, corner_noise_px(terms, used))
        used = [in_line(t, u, noise_px, _OUTLIER_SIGMA) for t, u in zip(terms, used, strict=True)]
    return terms, noise_px, used


def _joint_shift(
    layout: UnknownsLayout, terms: PictureTerms, used: BoolArray, noise_px: float
) -> FloatArray:
    """Return the difference between the joints (6,) and their counters in one picture.

    Joints that the picture hardly shows are held near 0, within the bounds of the arm's zeros.
    """
    if terms.by_joints is None:
        raise ValueError("a homing is compared by pictures of a board in the gripper")
    keep = np.repeat(used, 2)
    held = np.array([0.02, 0.02, 0.02, 5.0, 0.02, 0.02])  # far wider than homing ever is
    by = terms.by_joints.reshape(-1, 6)[keep] * held / noise_px
    r = terms.residual_px.ravel()[keep] / noise_px
    out: FloatArray = held * np.linalg.solve(by.T @ by + np.eye(6), -by.T @ r)
    return out
