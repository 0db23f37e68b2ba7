"""Straight Cartesian ways as joint waypoints."""

from __future__ import annotations

import numpy as np

from controller.arrays import FloatArray, IntArray

from ..model import CellLayout
from ._kinematics import inverse_rows, tip_pose


def same_branch(layout: CellLayout, T: FloatArray, branch: IntArray) -> FloatArray:
    """Return joints (n, k, 6) of poses (n, k, 4, 4) on branch (n,); NaN where it does not exist."""
    n, k = T.shape[:2]
    index, found, q = inverse_rows(layout, T.reshape(-1, 4, 4))
    out = np.full((n * k, 6), np.nan)
    match = found == np.repeat(branch, k)[index]
    out[index[match]] = q[match]
    return out.reshape(n, k, 6)


def fewest_waypoints(layout: CellLayout, q: FloatArray, sag_mm: float = 1.5) -> FloatArray:
    """Thin a straight Cartesian way (k, 6) to the joint waypoints that keep it straight."""
    kept = [0]
    while kept[-1] < len(q) - 1:
        a = kept[-1]
        b = len(q) - 1
        while b > a + 1 and _sag(layout, q[a : b + 1]) > sag_mm:
            b -= 1
        kept.append(b)
    return q[kept]


def _sag(layout: CellLayout, q: FloatArray) -> float:
    share = np.linspace(0, 1, len(q))[:, None]
    straight = tip_pose(layout, q[0] + share * (q[-1] - q[0]))[:, :3, 3]
    return float(np.linalg.norm(straight - tip_pose(layout, q)[:, :3, 3], axis=1).max())
