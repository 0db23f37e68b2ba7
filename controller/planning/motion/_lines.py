"""Cartesian paths, straight lines of the TCP, as joint waypoints."""

from __future__ import annotations

import numpy as np

from controller.arrays import FloatArray, IntArray

from ..model import CellLayout
from ._kinematics import inverse_rows, tcp_pose


def same_branch(layout: CellLayout, T: FloatArray, branch: IntArray) -> FloatArray:
    """Return joints (n, k, 6) that stay on one branch; NaN where it does not exist.

    Parameters
    ----------
    layout : the cell
    T : (n, k, 4, 4) T_world_tcp along n lines
    branch : (n,) number of the inverse kinematics' branch
    """
    n, k = T.shape[:2]
    index, found, q = inverse_rows(layout, T.reshape(-1, 4, 4))
    out = np.full((n * k, 6), np.nan)
    match = found == np.repeat(branch, k)[index]
    out[index[match]] = q[match]
    return out.reshape(n, k, 6)


def fewest_waypoints(layout: CellLayout, q: FloatArray, sag_mm: float = 1.5) -> FloatArray:
    """Return the fewest waypoints (j, 6) of a straight Cartesian path that keep it straight.

    Parameters
    ----------
    layout : the cell
    q : (k, 6) joints along the path, dense; both ends are kept
    sag_mm : largest distance of the TCP from the line
    """
    tip_mm = tcp_pose(layout, q)[:, :3, 3]
    kept = [0]
    while kept[-1] < len(q) - 1:
        a = kept[-1]
        b = len(q) - 1
        while b > a + 1 and _sag(layout, q[a], q[b], tip_mm[a : b + 1]) > sag_mm:
            b -= 1
        kept.append(b)
    return q[kept]


def _sag(layout: CellLayout, q_begin: FloatArray, q_end: FloatArray, tip_mm: FloatArray) -> float:
    """Return the TCP's largest distance from (k, 3) positions on a straight joint path [mm]."""
    share = np.linspace(0, 1, len(tip_mm))[:, None]
    straight = tcp_pose(layout, q_begin + share * (q_end - q_begin))[:, :3, 3]
    return float(np.linalg.norm(straight - tip_mm, axis=1).max())
