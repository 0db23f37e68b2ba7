"""Flat parts drawn twice: as a picture by counting samples, and as the CAD room's line drawing."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.cad import DrawnEdge, LineView

Array = NDArray[np.float64]
SAMPLES = 4  # a side of a pixel


@dataclass(frozen=True, eq=False)
class Plate:
    """A flat part: corners (n, 2) anticlockwise, holes (m, 3) centre and radius, all mm."""

    corners: Array
    holes: Array

    def placed(self, turn_rad: float, shift_mm: Array, scale: float = 1.0) -> "Plate":
        """Return the plate turned, then moved; its image is larger by ``scale`` if it is high."""
        c, s = np.cos(turn_rad), np.sin(turn_rad)
        R = np.array([[c, -s], [s, c]])
        holes = self.holes.copy()
        holes[:, :2] = (self.holes[:, :2] @ R.T + shift_mm) * scale
        holes[:, 2] *= scale
        return Plate((self.corners @ R.T + shift_mm) * scale, holes)

    def mirrored(self) -> "Plate":
        """Return its mirror image."""
        return Plate(self.corners[::-1] * [-1, 1], self.holes * [-1, 1, 1])


def plate(corners: list[tuple[float, float]], holes: list[tuple[float, float, float]]) -> Plate:
    """Return a plate of lists."""
    return Plate(np.array(corners, float), np.array(holes, float).reshape(-1, 3))


L_PLATE = plate(
    [(-25, -15), (25, -15), (25, 0), (-5, 0), (-5, 20), (-25, 20)], [(-15, 12, 3.0), (18, -8, 4.0)]
)


def covered(shape: Plate, size: tuple[int, int], mm_per_px: tuple[float, float]) -> Array:
    """Return how much of each pixel (height, width) a plate covers; see `to_plane` for where."""
    width, height = size
    step = np.array([(i + 0.5) / SAMPLES - 0.5 for i in range(SAMPLES)])
    u = (np.arange(width)[:, None] + step).ravel()
    v = (np.arange(height)[:, None] + step).ravel()
    x, y = np.meshgrid((u - (width - 1) / 2) * mm_per_px[0], ((height - 1) / 2 - v) * mm_per_px[1])
    inside = np.zeros(x.shape, dtype=bool)
    rows = y[:, 0]
    for (x0, y0), (x1, y1) in zip(shape.corners, np.roll(shape.corners, -1, axis=0), strict=True):
        between = np.flatnonzero((y0 <= rows) != (y1 <= rows))
        if len(between):
            at = slice(between[0], between[-1] + 1)
            inside[at] ^= x[at] < x0 + (y[at] - y0) * (x1 - x0) / (y1 - y0)
    for hx, hy, r in shape.holes:
        inside &= (x - hx) ** 2 + (y - hy) ** 2 > r * r
    return inside.reshape(height, SAMPLES, width, SAMPLES).mean(axis=(1, 3))


def shown(
    cover: Array, *, table: float, part: float, noise: float, seed: int = 1
) -> NDArray[np.uint8]:
    """Return a camera's picture of it: blurred by a lens, noisy, in whole levels."""
    light = cv2.GaussianBlur(table + (part - table) * cover, (0, 0), 0.8)
    light = light + np.random.default_rng(seed).normal(0.0, noise, light.shape)
    return np.clip(np.round(light), 0, 255).astype(np.uint8)


class Plane:
    """The way to the plane: the picture's middle is the origin, y upwards."""

    def __init__(self, size: tuple[int, int], mm_per_px: tuple[float, float]) -> None:
        self._middle = (np.array(size) - 1) / 2
        self._scale = np.array(mm_per_px) * [1, -1]

    def __call__(self, pixels: Array) -> Array:
        return np.asarray((pixels - self._middle) * self._scale)


def drawing(shape: Plate, height_mm: float = 0.0, eye_mm: float = 1.0) -> LineView:
    """Return the line drawing of a plate, y up; of one at a height as an eye above sees it."""
    edges = []
    for a, b in zip(shape.corners, np.roll(shape.corners, -1, axis=0), strict=True):
        edges.append(np.array([a, b]))
    for x, y, r in shape.holes:
        angle = np.linspace(0, 2 * np.pi, 49)
        edges.append(np.stack([x + r * np.cos(angle), y + r * np.sin(angle)], axis=1))
    scale = eye_mm / (eye_mm - height_mm) if height_mm else 1.0
    drawn = tuple(
        DrawnEdge(
            points=p * scale,
            points_mm=np.column_stack([p, np.full(len(p), height_mm)]),
            edge=n,
            face=-1,
            kind="sharp",
            on_outline=n < len(shape.corners),
            starts_phantom=False,
            ends_phantom=False,
        )
        for n, p in enumerate(edges)
    )
    return LineView((), drawn, 0.0, 0.0, np.zeros(2), np.eye(2))
