"""Strength of a grasp against the part's weight, by friction and pad width, in any attitude.

Two soft contacts of a known force: slip and twist together within the ellipse of the limit
surface, tipping within the pads' edges (planning-facts.md 2.2, step 4).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from controller.arrays import BoolArray, FloatArray

from ...model import GraspRules
from ._pads import EDGE_DIRECTIONS, Contacts, PadGrid, edges

GRAVITY_N_PER_KG = 9.81
# pitch -98..+4 deg with any roll and heading: gravity may come from anywhere but from more than
# 4 degrees ahead of the palm, so along the approach it is never less than this
MIN_ALONG_APPROACH = -float(np.sin(np.radians(4.0)))


def loads(
    contacts: Contacts,
    grid: PadGrid,
    centroid_mm: FloatArray,
    weight_n: float,
    force_n: float,
    inner: BoolArray,
    rules: GraspRules,
    gravities: Sequence[FloatArray] | None = None,
) -> FloatArray:
    """Return the load of each grasp (n,): the weight over strength, worst attitude.

    With ``d`` the centre of mass seen from the middle of both contacts, weight ``W``, pad force
    ``N``, friction ``m``, mean contact radius ``r`` and wall slope ``t``, the largest of

    - slip and twist: ``hypot(W g_t / 2N + t, W (d x g).y / 2 N r) / m``, on the limit surface at 1;
    - tipping: pressure in both pads moves to carry the moment about axes in the pads' plane, and
      the vector between both centres of pressure, ``W (g_y d_t - d_y g_t) / N``, must stay within
      what the outlines of the contacts allow;
    - pull along the jaws' axis: ``W |g_y| / 2N``, a pad comes off at 1.

    Parameters
    ----------
    contacts : n, closed
    grid : the rays of a pad they were closed with
    centroid_mm : (3,) CAD frame
    weight_n : weight of the part
    force_n : force of the pads
    inner : (n,) the pads are the fingers' backs
    rules : friction
    gravities : unit vectors (3,) in the TCP frame it may point along; None: whatever the arm's
        joints allow, the exact worst of each term
    """
    R = contacts.T[:, :3, :3]
    middle = contacts.middle.mean(axis=0)
    at = contacts.T[:, :3, 3] + R[:, :, 0] * middle[:, :1] + R[:, :, 2] * middle[:, 1:]
    d = np.einsum("nji,nj->ni", R, centroid_mm - at)
    in_plane, along = d[:, [0, 2]], d[:, 1]
    r = np.maximum(contacts.radius, 1.0)
    per_pad = weight_n / (2 * force_n)
    a, b = edges(contacts.touch[0], grid), edges(contacts.touch[1], grid)
    half = len(EDGE_DIRECTIONS) // 2
    # how far apart the centres of pressure may be, in each direction of the pads' plane
    room = np.where(
        inner[:, None],
        np.roll(a, half, axis=1) + b,
        a + np.roll(b, half, 1),
    )
    room = np.where(room > 1e-6, room, 1e-6)
    if gravities is None:
        twist = per_pad * np.linalg.norm(in_plane, axis=1) / r
        holds = np.hypot(per_pad + contacts.slope, twist) / rules.friction
        toppling = (2 * per_pad * _farthest_pressure(in_plane, along) / room).max(axis=1)
        return np.asarray(np.maximum(np.maximum(holds, toppling), per_pad))
    worst = np.zeros(len(d))
    for g in gravities:
        g_t, g_y = g[[0, 2]], float(g[1])
        twist = per_pad * np.abs(in_plane[:, 0] * g_t[1] - in_plane[:, 1] * g_t[0]) / r
        slip = per_pad * float(np.linalg.norm(g_t)) + contacts.slope
        holds = np.hypot(slip, twist) / rules.friction
        moved = 2 * per_pad * (in_plane * g_y - np.outer(along, g_t)) @ EDGE_DIRECTIONS.T
        toppling = (moved / room).max(axis=1)
        worst = np.maximum(worst, np.maximum(np.maximum(holds, toppling), per_pad * abs(g_y)))
    return worst


def still_gravities(T_world_tcp: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return gravity's direction in the TCP frame of a still jaw, and turned over: unit (3,).

    The same holds for the grasp turned over, half a turn about the approach.
    """
    down = T_world_tcp[:3, :3].T @ np.array([0.0, 0.0, -1.0])
    return down, down * np.array([1.0, -1.0, -1.0])


def _farthest_pressure(in_plane: FloatArray, along: FloatArray) -> FloatArray:
    """Return the largest of ``(g_y d_t - d_y g_t) . e`` over every gravity the arm allows (n, e).

    Linear in gravity, so the largest is its gradient's length, or, where the gradient points ahead
    of the palm farther than the wrist turns, lies on the rim of the allowed cap.
    """
    g_x = -along[:, None] * EDGE_DIRECTIONS[:, 0]
    g_z = -along[:, None] * EDGE_DIRECTIONS[:, 1]
    g_y = in_plane @ EDGE_DIRECTIONS.T
    length = np.sqrt(g_x**2 + g_y**2 + g_z**2)
    least = MIN_ALONG_APPROACH
    rim = least * g_x + np.sqrt(1 - least**2) * np.hypot(g_y, g_z)
    return np.asarray(np.where(g_x >= least * length, length, rim))


def least_load(
    d_mm: FloatArray, weight_n: float, force_n: float, grid: PadGrid, rules: GraspRules
) -> FloatArray:
    """Return a lower bound on the load of any contact of the pads (n,).

    The load is a share of the friction limit.

    Parameters
    ----------
    d_mm : (n,) from the centre of mass to the jaws' axis
    weight_n : weight of the part
    force_n : force of the pads
    grid : the rays of a pad; gives its size
    rules : friction
    """
    r = float(np.linalg.norm(grid.points - grid.points.mean(axis=0), axis=1).max())
    per_pad = weight_n / (2 * force_n)
    return np.asarray(np.hypot(per_pad, per_pad * d_mm / r) / rules.friction)
