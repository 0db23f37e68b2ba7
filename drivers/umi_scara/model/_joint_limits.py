"""The limits of umi_rtx.md 5.2 in terms of the joints, for every target within limits."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .kinematics import counts_to_q
from .limits import LIMITS

__all__ = ["JointLimit", "joint_limits"]


@dataclass(frozen=True, slots=True, eq=False)
class JointLimit:
    """One linear limit: ``low <= weights @ q <= high`` [rad, mm]."""

    name: str
    weights: NDArray[np.float64]
    low: float
    high: float


def joint_limits() -> tuple[JointLimit, ...]:
    """Return the limits on joints, half a count of each motor wider: the arm rounds its targets.

    Weights are scaled so that the largest is 1.
    """
    counts_per_q = np.linalg.inv(counts_to_q(np.eye(6)))
    found = []
    for limit in LIMITS:
        weights = counts_per_q @ np.array(limit.weights)
        unit = float(np.abs(weights).max())
        half = 0.5 * float(np.abs(limit.weights).sum())
        low, high = (limit.low - half) / unit, (limit.high + half) / unit
        found.append(JointLimit(limit.name, np.round(weights / unit, 12), low, high))
    return tuple(found)
