"""Where in a picture light can jump: the edges of moving things, drawn as lines.

Between edges a surface is smooth, so that few rays tell its light. Edges are where facets meet at
an angle that shading shows, and where a curved surface turns away from the camera; hidden ones
are drawn, too, and cost some rays.
"""

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ._layout import Array, CameraLayout
from ._optics import project
from ._poses import transform
from ._scene import CREASE_COS, Surface

BLOCK_PX: Final = 4
_LINE_PX: Final = 5  # of the lines: two pixels either side, more than a lens bends a short edge
_LONG_PX: Final = 100.0  # edges longer than this are drawn in pieces
_NEAR_MM: Final = 20.0
_SHIFT: Final = 3  # fractional bits of OpenCV's line ends


class Edges:
    """The edges of one surface."""

    def __init__(self, surface: Surface) -> None:
        faces = surface.faces.astype(np.int64)
        self._vertices_mm = surface.vertices_mm
        a, b, c = (surface.vertices_mm[faces[:, i]] for i in range(3))
        cross = np.cross(b - a, c - a)
        self._normals = cross / np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), 1e-12)
        self._points = a
        sides = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        owner = np.repeat(np.arange(len(faces)), 3)
        order = np.lexsort((sides[:, 1], sides[:, 0]))
        sides, owner = sides[order], owner[order]
        first = np.ones(len(sides), bool)
        first[1:] = (sides[1:] != sides[:-1]).any(axis=1)
        start = np.flatnonzero(first)
        count = np.diff(np.append(start, len(sides)))
        pair = start[count == 2]
        self._pairs = np.stack((owner[pair], owner[pair + 1]), axis=1)
        self._sides = sides[pair]
        dot = np.einsum("ij,ij->i", *(self._normals[self._pairs[:, i]] for i in range(2)))
        self._is_crease = dot < CREASE_COS + 0.01
        # an edge of one facet, or of three, is always drawn
        self._open = sides[start[count != 2]]

    def draw(self, mask: NDArray[np.uint8], camera: CameraLayout, T_world: Array) -> bool:
        """Draw the edges that may be seen; False if some reach behind the camera."""
        eye_mm = T_world[:3, :3].T @ (camera.T_world_cam[:3, 3] - T_world[:3, 3])
        front = np.einsum("ij,ij->i", self._normals, eye_mm - self._points) > 0.0
        one, two = front[self._pairs[:, 0]], front[self._pairs[:, 1]]
        turns_away: NDArray[np.bool_] = np.not_equal(one, two)
        drawn: NDArray[np.bool_] = turns_away | (self._is_crease & (one | two))
        sides = np.concatenate((self._sides[drawn], self._open))
        pixels, depth = project(camera, transform(T_world, self._vertices_mm))
        if (depth < _NEAR_MM).any():
            return False
        ends = pixels[sides]
        height, width = mask.shape
        low, high = ends.min(axis=1), ends.max(axis=1)
        inside = (high >= -_LINE_PX).all(axis=1)
        inside &= (low[:, 0] < width + _LINE_PX) & (low[:, 1] < height + _LINE_PX)
        sides, ends = sides[inside], ends[inside]
        long = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > _LONG_PX
        lines = [np.rint(ends[~long] * 2**_SHIFT).astype(np.int32)]
        if long.any():
            lines.append(self._in_pieces(camera, T_world, sides[long]))
        together = np.concatenate(lines)
        cv2.polylines(mask, list(together), False, 1, _LINE_PX, cv2.LINE_8, _SHIFT)
        return True

    def _in_pieces(
        self, camera: CameraLayout, T_world: Array, sides: NDArray[np.int64]
    ) -> NDArray[np.int32]:
        """Return long edges as short lines that follow the lens' bend, (n, 2, 2)."""
        ends = transform(T_world, self._vertices_mm[sides].reshape(-1, 3)).reshape(-1, 2, 3)
        share = np.linspace(0.0, 1.0, 17)[None, :, None]
        points = ends[:, :1] * (1.0 - share) + ends[:, 1:] * share
        pixels = project(camera, points.reshape(-1, 3))[0].reshape(-1, 17, 2)
        pieces = np.stack((pixels[:, :-1], pixels[:, 1:]), axis=2).reshape(-1, 2, 2)
        near = np.clip(pieces, -20_000.0, 20_000.0)
        return np.rint(near * 2**_SHIFT).astype(np.int32)


def fine_blocks(edges: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return the blocks of a picture that an edge crosses, (h / 4, w / 4).

    A block reaches to the first pixels of its right and lower neighbours, whose light its own is
    interpolated from; so blocks at the picture's right and lower border count as crossed.
    """
    reach = edges.astype(bool)
    wide = reach.copy()
    wide[:, :-1] |= reach[:, 1:]
    wide[:-1] |= reach[1:]
    wide[:-1, :-1] |= reach[1:, 1:]
    blocks = any_in_blocks(wide)
    blocks[-1], blocks[:, -1] = True, True
    return blocks


def any_in_blocks(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which blocks hold a set pixel, (h, w) -> (h / 4, w / 4)."""
    height, width = mask.shape
    folded = mask.reshape(height // BLOCK_PX, BLOCK_PX, width // BLOCK_PX, BLOCK_PX)
    blocks: NDArray[np.bool_] = folded.any(axis=(1, 3))
    return blocks


def spread() -> NDArray[np.float32]:
    """Return the weights of a block's four corners for its pixels, (4, 16), bilinear."""
    t = np.arange(BLOCK_PX) / BLOCK_PX
    y, x = (one.ravel() for one in np.meshgrid(t, t, indexing="ij"))
    weights = np.stack(((1 - y) * (1 - x), (1 - y) * x, y * (1 - x), y * x))
    return weights.astype(np.float32)
