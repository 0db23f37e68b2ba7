"""Drawn pictures for the segmentation's tests: shapes whose areas are known on paper."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]
Shape = Callable[[Array, Array], NDArray[np.bool_]]

FINE = 8  # samples to a pixel, each way
BLUR_PX = 0.8  # a lens's


def disc(x: float, y: float, radius: float) -> Shape:
    return lambda u, v: (u - x) ** 2 + (v - y) ** 2 <= radius**2


def ring(x: float, y: float, outer: float, inner: float) -> Shape:
    return lambda u, v: disc(x, y, outer)(u, v) & ~disc(x, y, inner)(u, v)


def bar(x: float, y: float, length: float, width: float, angle_rad: float = 0.0) -> Shape:
    c, s = np.cos(angle_rad), np.sin(angle_rad)

    def inside(u: Array, v: Array) -> NDArray[np.bool_]:
        along, across = (u - x) * c + (v - y) * s, (v - y) * c - (u - x) * s
        return (np.abs(along) <= length / 2) & (np.abs(across) <= width / 2)

    return inside


class Mixed:
    """The pixels that some shape's border may cross, and which fine samples each shape covers.

    The others are covered or not as their centres are: borders are sought 2 px about where
    centres change sides, and nothing drawn is narrower than that.
    """

    def __init__(self, shapes: list[Shape], size: tuple[int, int]) -> None:
        width, height = size
        columns, rows = (
            np.arange(width, dtype=float)[None, :],
            np.arange(height, dtype=float)[:, None],
        )
        self.whole = [shape(columns, rows) for shape in shapes]
        near = np.zeros((height, width), dtype=np.uint8)
        for whole in self.whole:
            near |= cv2.morphologyEx(
                whole.astype(np.uint8), cv2.MORPH_GRADIENT, np.ones((5, 5), np.uint8)
            )
        self.v, self.u = np.nonzero(near)
        step = (np.arange(FINE) + 0.5) / FINE - 0.5
        du, dv = (d.ravel() for d in np.meshgrid(step, step))
        self.fine = [shape(self.u[:, None] + du, self.v[:, None] + dv) for shape in shapes]


def coverage(shape: Shape, size: tuple[int, int]) -> Array:
    """Return how much of each pixel (height, width) a shape covers; (0, 0) has its centre there."""
    mixed = Mixed([shape], size)
    share = mixed.whole[0].astype(np.float64)
    share[mixed.v, mixed.u] = mixed.fine[0].mean(axis=1)
    return share


def picture(
    layers: list[tuple[Shape, float]],
    ground: float | Array,
    size: tuple[int, int] = (320, 256),
    noise: float = 0.0,
    seed: int = 5,
) -> Grey:
    """Return shapes of given levels on a ground, later ones on top, blurred, noisy, clipped."""
    width, height = size
    light = np.broadcast_to(np.asarray(ground, dtype=np.float64), (height, width)).copy()
    mixed = Mixed([shape for shape, _ in layers], size)
    fine = np.repeat(light[mixed.v, mixed.u][:, None], FINE**2, axis=1)
    for (_, level), whole, inside in zip(layers, mixed.whole, mixed.fine, strict=True):
        light[whole] = level
        fine[inside] = level
    light[mixed.v, mixed.u] = fine.mean(axis=1)
    light = cv2.GaussianBlur(light, (0, 0), BLUR_PX, borderType=cv2.BORDER_REPLICATE)
    if noise:
        light = light + np.random.default_rng(seed).normal(0.0, noise, light.shape)
    return np.clip(np.round(light), 0, 255).astype(np.uint8)


def fading(level: float, share: float, size: tuple[int, int] = (320, 256)) -> Array:
    """Return a ground that falls by a share from the middle to the corners, and slopes a little."""
    width, height = size
    x = np.linspace(-1, 1, width)[None, :]
    y = np.linspace(-1, 1, height)[:, None]
    return level * (1 - share * (x**2 + y**2) / 2) * (1 + 0.05 * x)
