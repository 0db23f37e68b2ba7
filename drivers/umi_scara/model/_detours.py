"""Joint paths round obstacles. This arm goes over the top.

Zed lifts arm and part above most objects of a cell; there the gripper may hang straight down, or
the elbow may draw the arm in.
"""

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .kinematics import Q_ORDER

__all__ = ["detours", "lifts"]

Floats = NDArray[np.float64]
JointPath = list[Floats]

RAISED_MM: Final = (-20.0, -120.0, -250.0, -350.0)  # zed of the paths over the top
VIA_SHARES: Final = (0.0, 0.25, 0.5, 0.75, 1.0)  # shares of the line for its one raised point
ELBOWS_RAD: Final = tuple(np.radians([-140.0, -90.0, 90.0, 140.0]).tolist())
TOP_MM: Final = -20.0
_ELBOW, _YAW, _ZED, _PITCH = (
    Q_ORDER.index(name) for name in ("elbow_rad", "yaw_rad", "zed_mm", "pitch_rad")
)


def detours(q_from: Floats, q_to: Floats) -> Iterator[Sequence[JointPath]]:
    """Yield joint paths from (6,) to (6,): over one point, then over the top in several turns."""
    yield _over_one_point(q_from, q_to)
    yield _over_the_top(q_from, q_to)


def lifts(q: Floats, count: int) -> Floats:
    """Return joints (n, 6) at `count` heights from their own to the top: (n, count, 6)."""
    out = np.repeat(q[:, None], count, axis=1)
    top_mm = np.maximum(TOP_MM, q[:, _ZED])
    out[..., _ZED] = np.linspace(q[:, _ZED], top_mm, count, axis=1)
    return out


def _over_one_point(a: Floats, b: Floats) -> list[JointPath]:
    """Return paths through one point above the line, and straight up and straight down."""
    paths: list[JointPath] = []
    for zed in RAISED_MM:
        up_a, up_b = _raised(a, zed), _raised(b, zed)
        vias = [up_a + share * (up_b - up_a) for share in VIA_SHARES]
        paths += [[via] for via in vias]
        paths += [[_hanging(via)] for via in vias[1:-1]]
        paths.append([up_a, up_b])
    return [_without_stops([a, *middle, b]) for middle in paths]


def _over_the_top(a: Floats, b: Floats) -> list[JointPath]:
    """Return paths that rise, turn and come down.

    With the gripper hanging down, which at the top is above everything that stands in the cell, and
    with the arm drawn in.
    """
    paths: list[JointPath] = []
    for zed in RAISED_MM[:3]:
        up_a, up_b = _raised(a, zed), _raised(b, zed)
        hang_a, hang_b = _hanging(up_a), _hanging(up_b)
        paths.append([up_a, hang_a, hang_b, up_b])
        for elbow in ELBOWS_RAD:
            drawn_a, drawn_b = _drawn_in(up_a, elbow), _drawn_in(up_b, elbow)
            paths.append([up_a, drawn_a, drawn_b, up_b])
            drawn_a, drawn_b = _drawn_in(hang_a, elbow), _drawn_in(hang_b, elbow)
            paths.append([up_a, hang_a, drawn_a, drawn_b, hang_b, up_b])
    return [_without_stops([a, *middle, b]) for middle in paths]


def _raised(q: Floats, zed_mm: float) -> Floats:
    out = q.copy()
    out[_ZED] = max(zed_mm, q[_ZED])
    return out


def _hanging(q: Floats) -> Floats:
    out = q.copy()
    out[_PITCH] = -np.pi / 2
    return out


def _drawn_in(q: Floats, elbow_rad: float) -> Floats:
    """Return `q` with another elbow, the gripper keeping its orientation to the forearm."""
    out = q.copy()
    out[_YAW] += (elbow_rad - q[_ELBOW]) / 2
    out[_ELBOW] = elbow_rad
    return out


def _without_stops(path: JointPath) -> JointPath:
    kept = [path[0]]
    for q in path[1:]:
        if np.abs(q - kept[-1]).max() > 1e-9:
            kept.append(q)
    return kept
