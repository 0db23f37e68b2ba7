"""Boxes against boxes and segments against boxes, many at a time.

Links, hands, obstacles and (away from the fingers) the part are boxes, so the separating-axis
test is exact and, vectorised, cheaper per configuration than one call into a collision library.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .layout import Box, FloatArray

BoolArray = NDArray[np.bool_]
_EPS = 1e-9  # parallel edges make a zero cross product; this keeps such an axis from separating


def stack(boxes: list[Box] | tuple[Box, ...]) -> tuple[FloatArray, FloatArray]:
    """Return the poses (n, 4, 4) and half edges (n, 3) of boxes."""
    if not boxes:
        return np.zeros((0, 4, 4)), np.zeros((0, 3))
    return np.stack([b.T for b in boxes]), np.stack([b.half_mm for b in boxes])


def overlap(T_a: FloatArray, half_a: FloatArray, T_b: FloatArray, half_b: FloatArray) -> BoolArray:
    """Tell which pairs of boxes touch (n,): poses (n, 4, 4), half edges (n, 3) or (3,)."""
    result = np.zeros(len(T_a), dtype=bool)
    offset = T_b[:, :3, 3] - T_a[:, :3, 3]
    half_a = np.broadcast_to(half_a, offset.shape)
    half_b = np.broadcast_to(half_b, offset.shape)
    radius = np.linalg.norm(half_a, axis=1) + np.linalg.norm(half_b, axis=1)
    (near,) = np.nonzero(np.einsum("ij,ij->i", offset, offset) <= radius**2)
    if len(near):
        result[near] = _separating_axis(
            T_a[near, :3, :3], half_a[near], T_b[near, :3, :3], half_b[near], offset[near]
        )
    return result


def _separating_axis(
    R_a: FloatArray, a: FloatArray, R_b: FloatArray, b: FloatArray, offset: FloatArray
) -> BoolArray:
    """Gottschalk's 15 axes, all pairs at once."""
    turn = np.einsum("nki,nkj->nij", R_a, R_b)
    across = np.abs(turn) + _EPS
    t = np.einsum("nki,nk->ni", R_a, offset)
    apart = np.any(np.abs(t) > a + np.einsum("nij,nj->ni", across, b), axis=1)
    apart |= np.any(
        np.abs(np.einsum("nij,ni->nj", turn, t)) > b + np.einsum("nij,ni->nj", across, a), axis=1
    )
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            j1, j2 = (j + 1) % 3, (j + 2) % 3
            distance = np.abs(t[:, i2] * turn[:, i1, j] - t[:, i1] * turn[:, i2, j])
            reach = (
                a[:, i1] * across[:, i2, j]
                + a[:, i2] * across[:, i1, j]
                + b[:, j1] * across[:, i, j2]
                + b[:, j2] * across[:, i, j1]
            )
            apart |= distance > reach
    return np.asarray(~apart)


def segments_hit(
    start: FloatArray, end: FloatArray, boxes: list[Box] | tuple[Box, ...], grow_mm: float = 0.0
) -> BoolArray:
    """Tell which segments (n, 3) -> (n, 3) or (3,) pass through any of the boxes: (n,) bool."""
    hit = np.zeros(len(start), dtype=bool)
    end = np.broadcast_to(end, start.shape)
    for box in boxes:
        R, centre, half = box.T[:3, :3], box.T[:3, 3], box.half_mm + grow_mm
        origin = (start - centre) @ R
        step = (end - start) @ R
        step = np.where(np.abs(step) < 1e-12, 1e-12, step)
        t1, t2 = (-half - origin) / step, (half - origin) / step
        enter = np.minimum(t1, t2).max(axis=1)
        leave = np.maximum(t1, t2).min(axis=1)
        hit |= (enter <= leave) & (leave >= 0.0) & (enter <= 1.0)
    return hit


def lowest_z(T: FloatArray, half: FloatArray) -> FloatArray:
    """Return the height of the lowest corner [mm] of boxes (..., 4, 4), (..., 3)."""
    z: FloatArray = T[..., 2, 3] - np.einsum("...i,...i->...", np.abs(T[..., 2, :3]), half)
    return z
