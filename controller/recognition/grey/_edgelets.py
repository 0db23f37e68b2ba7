"""Short pieces of edges of a grey picture, in the table plane.

Edge points of one direction in one cell of the table are one edgelet, whatever line or curve they
are part of.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from controller.arrays import FloatArray, Grey

from ..fitting import GreyMeasure, ImageEdges

ToPlane = Callable[[FloatArray], FloatArray]

EDGELET_MM: Final = 1.5  # a piece of edge that counts as one: shorter than the smallest feature
SECTORS: Final = 16  # directions told apart in a cell: two edges that cross are two edgelets
MIN_POINTS: Final = 2  # a single point's direction is its noise
PLAIN: Final = 0.4  # share of a plain edge's strength from which an edge counts as plain
FAINTEST: Final = 0.15  # weight of the weakest edge
# Size of a pixel above which a picture is enlarged, or edges nearer than an edgelet would join.
FINE_MM: Final = 0.37
MAX_TIMES: Final = 3  # more adds no detail


@dataclass(frozen=True, eq=False, slots=True)
class Edgelets:
    """Short pieces of edges, by which placed views are scored.

    Attributes
    ----------
    points_mm : (n, 2) their middles, x right and y up as in the world
    directions_rad : (n,) directions along the edge, 0..pi
    lengths_mm : (n,)
    strengths : (n,) 0..1, 1 for plain edges of this picture
    """

    points_mm: FloatArray
    directions_rad: FloatArray
    lengths_mm: FloatArray
    strengths: FloatArray

    def at(self, which: np.ndarray) -> "Edgelets":
        """Return the edgelets of a mask (n,)."""
        return Edgelets(
            self.points_mm[which],
            self.directions_rad[which],
            self.lengths_mm[which],
            self.strengths[which],
        )


def picture_edgelets(grey: Grey, to_plane: ToPlane) -> Edgelets:
    """Return the edgelets of a grey picture; references.md P3.2.

    Parameters
    ----------
    grey : (height, width) uint8, an object's box or a whole picture
    to_plane : takes pixels (n, 2) of this picture, x before y, to the table plane (n, 2 or more)

    Raises
    ------
    ValueError : not a grey picture of uint8
    """
    if grey.ndim != 2 or grey.dtype != np.uint8:
        raise ValueError(f"a grey picture of uint8 is needed, not {grey.dtype} of {grey.shape}")
    middle = np.array(grey.shape[::-1]) / 2
    corner, right, down = to_plane(middle + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))[:, :2]
    (a, b), (c, d) = right - corner, down - corner
    pixel_mm = float(np.sqrt(abs(a * d - b * c)))
    times = int(np.clip(round(pixel_mm / FINE_MM), 1, MAX_TIMES))
    if times > 1:
        large = cv2.resize(grey, None, fx=times, fy=times, interpolation=cv2.INTER_CUBIC)
        grey = np.asarray(large, np.uint8)

    def on_plane(pixels: FloatArray) -> FloatArray:
        return np.asarray(to_plane((pixels + 0.5) / times - 0.5)[:, :2])

    every = np.ones(grey.shape, dtype=np.bool_)
    edges = ImageEdges.of(GreyMeasure(grey, (0, 0), is_lit=True), every, most=grey.size)
    if len(edges.strength) == 0:
        none = np.zeros(0)
        return Edgelets(np.zeros((0, 2)), none, none, none)
    points = on_plane(edges.points_px)
    tangents = np.column_stack([-edges.normals[:, 1], edges.normals[:, 0]])
    along = on_plane(edges.points_px + tangents) - points
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    turn = np.arctan2(along[:, 1], along[:, 0])
    sector = np.round(turn * (SECTORS / (2 * np.pi))).astype(np.int64) % SECTORS
    cell = np.floor(points / EDGELET_MM).astype(np.int64)
    cell -= cell.min(axis=0)
    key = (cell[:, 1] * (int(cell[:, 0].max()) + 1) + cell[:, 0]) * SECTORS + sector
    _, of, count = np.unique(key, return_inverse=True, return_counts=True)
    plain = PLAIN * float(np.percentile(edges.strength, 90))
    columns = (*points.T, *along.T, np.clip(edges.strength / plain, FAINTEST, 1.0))
    x, y, dx, dy, strength = (np.bincount(of, weights=c) / count for c in columns)
    direction = np.arctan2(dy, dx)
    ahead = points[:, 0] * np.cos(direction)[of] + points[:, 1] * np.sin(direction)[of]
    low, high = np.full(len(count), np.inf), np.full(len(count), -np.inf)
    np.minimum.at(low, of, ahead)
    np.maximum.at(high, of, ahead)
    length_mm = high - low + pixel_mm / times
    found = Edgelets(np.column_stack([x, y]), direction % np.pi, length_mm, strength)
    return found.at(count >= MIN_POINTS)


def join_edgelets(parts: list[Edgelets]) -> Edgelets:
    """Return edgelets of several pictures as one."""
    return Edgelets(
        np.concatenate([p.points_mm for p in parts]),
        np.concatenate([p.directions_rad for p in parts]),
        np.concatenate([p.lengths_mm for p in parts]),
        np.concatenate([p.strengths for p in parts]),
    )
