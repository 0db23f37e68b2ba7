"""The regions of a camera's picture that things and their shadows may reach: no rays.

Only there is a picture cast anew. An outline may be too large, never too small.
"""

from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ...layout import CameraLayout
from ...shapes import Array
from ..geometry import Mover, project
from .lamps import Lamps

Outline = NDArray[np.int32]

_MARGIN_PX: Final = 4  # above the bend by the lens of an edge that spans the picture
_FAR_PX: Final = 20_000  # limit of coordinates, for OpenCV's sake
_NEAR_MM: Final = 20.0
_HIGHEST: Final = 0.98  # share of a lamp's height; higher things throw their shadow far away


class Reach:
    """The regions of one camera's picture that things reach, themselves and by their shadows."""

    def __init__(self, camera: CameraLayout, lamps: Lamps) -> None:
        self._camera, self._lamps = camera, lamps

    def outline(self, points_mm: Array) -> Outline | None:
        """Return the convex outline of points in the picture, (n, 2) px; None if outside of it."""
        pixels, depth = project(self._camera, points_mm)
        height, width = (self._camera.height_px, self._camera.width_px)
        if np.all(depth < _NEAR_MM):
            return None
        if np.any(depth < _NEAR_MM):  # behind the lens: it may be anywhere in the picture
            return np.array(((0, 0), (width, 0), (width, height), (0, height)), np.int32)
        low, high = pixels.min(axis=0) - _MARGIN_PX, pixels.max(axis=0) + _MARGIN_PX
        if high[0] < 0 or high[1] < 0 or low[0] >= width or low[1] >= height:
            return None
        near = np.clip(np.rint(pixels), -_FAR_PX, _FAR_PX).astype(np.int32)
        return np.asarray(cv2.convexHull(near)[:, 0], np.int32)

    def shadow_outlines(self, mover: Mover, lit: Sequence[int]) -> list[Outline]:
        """Return outlines around a thing's shadows on table and panels, soft borders included."""
        outlines = []
        for lamp in lit:
            source = self._lamps.sources[lamp]
            if source is None:
                continue
            corners_mm = source.outline_mm()
            for point, normal in self._screens():
                outline = self._shadow_outline(corners_mm, mover.corners_mm, point, normal)
                if outline is not None:
                    outlines.append(outline)
        return outlines

    def _screens(self) -> list[tuple[Array, Array]]:
        table = (np.zeros(3), np.array((0.0, 0.0, 1.0)))
        standing = [
            (lamp.centre_mm, lamp.normal)
            for lamp in self._lamps.lamps
            if lamp.kind == "panel" and abs(lamp.normal[2]) < 0.99
        ]
        return [table, *standing]

    def _shadow_outline(
        self, source: Array, corners: Array, point: Array, normal: Array
    ) -> Outline | None:
        lamp_height = float(((source - point) @ normal).min())
        between = _slab(corners, (corners - point) @ normal, _HIGHEST * lamp_height)
        if lamp_height <= 0.0 or len(between) == 0:
            return None
        height = (between - point) @ normal
        over = (source - point) @ normal
        scale = over[:, None] / (over[:, None] - height)
        shadow = source[:, None] + (between - source[:, None]) * scale[..., None]
        return self.outline(shadow.reshape(-1, 3))


def fill(mask: NDArray[np.uint8], outline: Outline | None) -> None:
    """Mark the inside of an outline, and a margin for lens distortion."""
    if outline is not None:
        cv2.fillConvexPoly(mask, outline, 1)
        cv2.polylines(mask, [outline], isClosed=True, color=1, thickness=2 * _MARGIN_PX + 1)


def _slab(corners: Array, height: Array, highest: float) -> Array:
    """Return corners that bound what of a convex thing is between height 0 and the highest."""
    for sign, limit in ((1.0, highest), (-1.0, 0.0)):
        over = sign * (height - limit)
        inside, outside = np.flatnonzero(over <= 0.0), np.flatnonzero(over > 0.0)
        i, o = (one.ravel() for one in np.meshgrid(inside, outside))
        share = (over[i] / (over[i] - over[o]))[:, None]
        cut = corners[i] * (1.0 - share) + corners[o] * share
        corners = np.concatenate((corners[inside], cut))
        height = np.concatenate((height[inside], np.full(len(cut), limit)))
    return corners
