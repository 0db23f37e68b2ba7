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


def samples(shape: Shape, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Return which of the fine samples a shape covers; pixel (0, 0) has its centre there."""
    width, height = size
    u = (np.arange(width * FINE) + 0.5) / FINE - 0.5
    v = (np.arange(height * FINE) + 0.5) / FINE - 0.5
    return shape(u[None, :], v[:, None])


def share_of(inside: NDArray[np.bool_]) -> Array:
    """Return how much of each pixel (height, width) its samples cover."""
    rows = inside.reshape(inside.shape[0], -1, FINE).sum(axis=2, dtype=np.uint8)
    return rows.reshape(-1, FINE, rows.shape[1]).sum(axis=1) / FINE**2


def coverage(shape: Shape, size: tuple[int, int]) -> Array:
    """Return how much of each pixel (height, width) a shape covers."""
    return share_of(samples(shape, size))


def picture(
    layers: list[tuple[Shape, float]],
    ground: float | Array,
    size: tuple[int, int] = (320, 256),
    noise: float = 0.0,
    seed: int = 5,
) -> Grey:
    """Return shapes of given levels on a ground, later ones on top, blurred, noisy, clipped."""
    width, height = size
    light = np.zeros((height, width))
    free = np.ones((height * FINE, width * FINE), dtype=np.bool_)
    for shape, level in reversed(layers):
        inside = samples(shape, size)
        light += level * share_of(inside & free)
        free &= ~inside
    light += share_of(free) * ground
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
