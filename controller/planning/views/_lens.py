"""Regions before a camera without need of its lens: surely in the picture, or fine.

Projection with distortion is dear. Most points are far from the picture's border and have many
pixels more than are required; for these a rectangle and a product are enough.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.imaging import Camera

from .visibility import PICTURE_MARGIN_PX

GRID_COUNT = 33  # places along each side of the picture at which the lens is evaluated
STEP = 1e-4  # step in tangents by which the lens's magnification is measured
RESERVE = 0.97  # factor for the lens between the places where it is evaluated
INSET = 1e-3  # tangents


@dataclass(frozen=True, slots=True)
class SureRegion:
    """A rectangle in the plane at depth 1, all of it in the picture, and how the lens magnifies.

    Attributes
    ----------
    low, high : (x, y) corners [tangents, camera frame]; low is not below high where there is none
    focal_px : pixels of a unit of that plane at any place in the picture, at least and at most
    """

    low: tuple[float, float]
    high: tuple[float, float]
    focal_px: tuple[float, float]

    @classmethod
    def of(cls, camera: Camera) -> Self:
        """Return the region of a camera with its lens."""
        width, height = camera.size_px
        m = PICTURE_MARGIN_PX
        u = np.linspace(m, width - 1 - m, GRID_COUNT)
        v = np.linspace(m, height - 1 - m, GRID_COUNT)
        pixels = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
        lines = camera.sight_lines(pixels)
        across, down = camera.T_world_cam[:3, 0], camera.T_world_cam[:3, 1]
        x, y = (np.reshape(lines @ axis, (GRID_COUNT, GRID_COUNT)) for axis in (across, down))
        rates = [
            (
                camera.project(camera.position_mm + lines + STEP * axis)
                - camera.project(camera.position_mm + lines - STEP * axis)
            )
            / (2 * STEP)
            for axis in (across, down)
        ]
        return cls(
            (float(x[0].max()) + INSET, float(y[:, 0].max()) + INSET),
            (float(x[-1].min()) - INSET, float(y[:, -1].min()) - INSET),
            (RESERVE * float(stretches(*rates).min()), float(stretches(*rates).max()) / RESERVE),
        )

    def holds(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Return a mask (n,) of the points of the plane (n,) in the rectangle."""
        (x0, y0), (x1, y1) = self.low, self.high
        return np.asarray((x >= x0) & (x <= x1) & (y >= y0) & (y <= y1))


def stretches(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the singular values (2, n) of matrices whose columns are a and b (n, 2)."""
    half = ((a * a).sum(axis=1) + (b * b).sum(axis=1)) / 2.0
    area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    apart = np.sqrt(np.maximum(half**2 - area**2, 0.0))
    return np.asarray(np.sqrt(np.maximum(np.stack([half - apart, half + apart]), 0.0)))
