"""The places in a picture where light can jump: the edges of moving things, drawn as lines.

Between edges a surface is smooth, so that few rays are enough for its light. Edges are where facets
meet at an angle that shading shows or are of different materials, and where a curved surface turns
away from the camera; hidden ones are drawn, too, and cost some rays.
"""

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ...layout import CameraLayout
from ...poses import invert, transform
from ...shapes import Array
from .optics import distort
from .scene import CREASE_COS, Surface

BLOCK_PX: Final = 4
_LINE_PX: Final = 5  # width of a line: two pixels either side, more than a lens bends a short edge
_LONG_PX: Final = 100.0  # edges longer than this are drawn in pieces
_NEAR_MM: Final = 20.0
_PIECES: Final = 64
_FAR_PX: Final = 20_000.0  # limit of coordinates, for OpenCV's sake
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
        one, other = (surface.material[self._pairs[:, i]] for i in range(2))
        self._is_crease = (dot < CREASE_COS + 0.01) | (one != other)
        # an edge of one facet, or of three, is always drawn
        self._open = sides[start[count != 2]]

    def draw(self, mask: NDArray[np.uint8], camera: CameraLayout, T_world: Array) -> None:
        """Draw the edges that may be seen into a picture's mask.

        Parameters
        ----------
        mask : (height, width) uint8, changed in place: 1 along an edge
        camera : the camera whose picture it is
        T_world : (4, 4) pose of the surface [mm]
        """
        T_cam = invert(camera.T_world_cam) @ T_world
        eye_mm = -T_cam[:3, :3].T @ T_cam[:3, 3]
        front = np.einsum("ij,ij->i", self._normals, eye_mm - self._points) > 0.0
        one, two = front[self._pairs[:, 0]], front[self._pairs[:, 1]]
        drawn = np.logical_xor(one, two) | (self._is_crease & np.logical_or(one, two))
        sides = np.concatenate((self._sides[np.asarray(drawn)], self._open))
        ends = _before_lens(transform(T_cam, self._vertices_mm)[sides])
        ends = ends[_may_be_seen(_pixels(camera, ends), mask.shape)]
        pixels = _pixels(camera, ends)
        long = np.linalg.norm(pixels[:, 1] - pixels[:, 0], axis=1) > _LONG_PX
        pieces = _pixels(camera, _in_pieces(ends[long]))
        lines = np.concatenate((pixels[~long], pieces[_may_be_seen(pieces, mask.shape)]))
        near = np.clip(lines, -_FAR_PX, _FAR_PX)
        whole = np.rint(near * 2**_SHIFT).astype(np.int32)
        cv2.polylines(mask, list(whole), False, 1, _LINE_PX, cv2.LINE_8, _SHIFT)


def _before_lens(ends_mm: Array) -> Array:
    """Return the parts of lines that are before the camera, (n, 2, 3) in its frame."""
    depth = ends_mm[..., 2]
    ends_mm = ends_mm[(depth > _NEAR_MM).any(axis=1)]
    depth = ends_mm[..., 2]
    cut = ends_mm.copy()
    for this, other in ((0, 1), (1, 0)):
        behind = np.flatnonzero(depth[:, this] < _NEAR_MM)
        share = (_NEAR_MM - depth[behind, other]) / (depth[behind, this] - depth[behind, other])
        way = ends_mm[behind, this] - ends_mm[behind, other]
        cut[behind, this] = ends_mm[behind, other] + share[:, None] * way
    return cut


def _pixels(camera: CameraLayout, ends_mm: Array) -> Array:
    """Return the ends of lines in the picture, (n, 2, 3) in the camera's frame -> (n, 2, 2)."""
    xy = distort(ends_mm[..., :2] / ends_mm[..., 2:], camera.distortion)
    pixels: Array = xy * camera.focal_px + np.array(camera.centre_px)
    return pixels


def _may_be_seen(ends_px: Array, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    low, high = ends_px.min(axis=1), ends_px.max(axis=1)
    limit = np.array((shape[1], shape[0])) + _LINE_PX
    inside: NDArray[np.bool_] = np.all((high > -_LINE_PX) & (low < limit), axis=1)
    return inside


def _in_pieces(ends_mm: Array) -> Array:
    """Return long lines as short ones, equal in the picture, which follow the lens' bend."""
    share = np.linspace(0.0, 1.0, _PIECES + 1)[None, :, None]
    inverse = 1.0 / ends_mm[..., 2:]  # linear along a line in the picture, as x / z and y / z are
    flat = np.concatenate((ends_mm[..., :2] * inverse, inverse), axis=2)
    points = flat[:, :1] * (1.0 - share) + flat[:, 1:] * share
    points = np.concatenate((points[..., :2] / points[..., 2:], 1.0 / points[..., 2:]), axis=2)
    pieces: Array = np.stack((points[:, :-1], points[:, 1:]), axis=2).reshape(-1, 2, 3)
    return pieces


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
    """Return a mask of the blocks that hold a set pixel, (h, w) -> (h / 4, w / 4)."""
    height, width = mask.shape
    folded = mask.reshape(height // BLOCK_PX, BLOCK_PX, width // BLOCK_PX, BLOCK_PX)
    blocks: NDArray[np.bool_] = np.any(folded, axis=(1, 3))
    return blocks


def spread() -> NDArray[np.float32]:
    """Return the weights of a block's four corners for its pixels, (4, 16), bilinear."""
    t = np.arange(BLOCK_PX) / BLOCK_PX
    y, x = (one.ravel() for one in np.meshgrid(t, t, indexing="ij"))
    weights = np.stack(((1 - y) * (1 - x), (1 - y) * x, y * (1 - x), y * x))
    return weights.astype(np.float32)
