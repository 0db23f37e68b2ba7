"""Check whether the arm itself is between the camera and the part that it shows."""

from __future__ import annotations

import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.planning.geometry import Box, segments_hit
from controller.planning.model import CellLayout
from controller.planning.motion import link_boxes

AROUND_COUNT = 8  # points round the part's outline that the camera must see, besides its middle


def links_in_sight(layout: CellLayout, q: FloatArray, radius_mm: float) -> BoolArray:
    """Return a mask (n,) of the configurations in which carriage or links hide the part.

    The part is taken as a ball about the station, so a link that would hide only a corner counts,
    too: such a picture would be of little use.

    Parameters
    ----------
    layout : the cell, with inspection camera and station
    q : (n, 6) rows of joints
    radius_mm : radius of the ball
    """
    if len(q) == 0:
        return np.zeros(0, dtype=bool)
    eye, station = layout.inspection.position_mm, np.asarray(layout.station_mm, float)
    towards = (eye - station) / np.linalg.norm(eye - station)
    right = np.cross(towards, np.eye(3)[int(np.argmin(np.abs(towards)))])
    right /= np.linalg.norm(right)
    over = np.cross(towards, right)
    angle = 2 * np.pi * np.arange(AROUND_COUNT) / AROUND_COUNT
    ring = np.cos(angle)[:, None] * right + np.sin(angle)[:, None] * over
    points = np.vstack([station[None], station + radius_mm * ring])
    hidden = np.zeros(len(q), dtype=bool)
    T_links, half_mm = link_boxes(layout, q)
    for k in range(T_links.shape[1]):
        R, centre = T_links[:, k, :3, :3], T_links[:, k, :3, 3]
        start = np.einsum("nji,npj->npi", R, points[None] - centre[:, None])
        end = np.einsum("nji,nj->ni", R, eye - centre)
        box = Box(np.eye(4), half_mm[0, k])
        hit = segments_hit(
            start.reshape(-1, 3), np.repeat(end, len(points), axis=0), [box], 0.0
        ).reshape(len(q), -1)
        hidden |= hit.any(axis=1)
    return hidden
