"""Whether the arm itself stands between the camera and the part it shows."""

from __future__ import annotations

import numpy as np

from controller.planning.boxes import BoolArray, segments_hit
from controller.planning.layout import Box, CellLayout, FloatArray

AROUND_N = 8  # points round the part's outline that the camera has to see, beside its middle


def links_in_sight(layout: CellLayout, q: FloatArray, radius_mm: float) -> BoolArray:
    """Tell of configurations (n, 6) whether carriage or links hide the part: (n,) bool.

    The part is taken as the ball of that radius about the station, so a link that only grazes a
    corner of it counts too: such a picture would be of little use.
    """
    if len(q) == 0:
        return np.zeros(0, dtype=bool)
    eye, station = layout.inspection.position_mm, np.asarray(layout.station_mm, float)
    towards = (eye - station) / np.linalg.norm(eye - station)
    right = np.cross(towards, np.eye(3)[int(np.argmin(np.abs(towards)))])
    right /= np.linalg.norm(right)
    over = np.cross(towards, right)
    angle = 2 * np.pi * np.arange(AROUND_N) / AROUND_N
    ring = np.cos(angle)[:, None] * right + np.sin(angle)[:, None] * over
    points = np.vstack([station[None], station + radius_mm * ring])
    hidden = np.zeros(len(q), dtype=bool)
    for box, T in zip(_links(layout), _poses(layout, q), strict=True):
        turn = np.swapaxes(T[:, :3, :3], 1, 2)
        start = np.einsum("nij,npj->npi", turn, points[None] - T[:, None, :3, 3])
        end = np.einsum("nij,nj->ni", turn, eye - T[:, :3, 3])
        hit = segments_hit(
            start.reshape(-1, 3), np.repeat(end, len(points), axis=0), [box], 0.0
        ).reshape(len(q), -1)
        hidden |= hit.any(axis=1)
    return hidden


def _links(layout: CellLayout) -> tuple[Box, Box, Box]:
    return layout.carriage, layout.upper, layout.fore


def _poses(layout: CellLayout, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return world poses (n, 4, 4) of carriage, upper arm and forearm frames."""
    zero = np.zeros(len(q))
    x = layout.arm.upper_mm * np.cos(q[:, 0])
    y = layout.arm.upper_mm * np.sin(q[:, 0])
    out = []
    for angle, dx, dy in ((zero, zero, zero), (q[:, 0], zero, zero), (q[:, 0] + q[:, 1], x, y)):
        T = np.zeros((len(q), 4, 4))
        T[:, 3, 3] = T[:, 2, 2] = 1.0
        T[:, 0, 0] = T[:, 1, 1] = np.cos(angle)
        T[:, 1, 0], T[:, 0, 1] = np.sin(angle), -np.sin(angle)
        T[:, 0, 3], T[:, 1, 3] = dx, dy
        T[:, 2, 3] = layout.arm.wrist_height_mm + q[:, 3]
        out.append(np.asarray(layout.T_world_arm @ T))
    return out[0], out[1], out[2]
