"""Short pieces of edges of a grey picture, in the table plane.

Edge points of one direction in one cell of the table are one edgelet, whatever line or curve they
are part of.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.arrays import FloatArray, Grey

from ._points import ToPlane, edge_points
from ._tolerances import GreyTolerances

EDGELET_MM: Final = 1.5  # a piece of edge that counts as one: shorter than the smallest feature
SECTORS: Final = 16  # directions told apart in a cell: two edges that cross are two edgelets
MIN_POINTS: Final = 2  # a single point's direction is its noise
PLAIN: Final = 0.4  # share of a plain edge's strength from which an edge counts as plain
FAINTEST: Final = 0.15  # weight of the weakest edge


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


def picture_edgelets(grey: Grey, to_plane: ToPlane, tol: GreyTolerances | None = None) -> Edgelets:
    """Return the edgelets of a grey picture; references.md P3.2.

    Parameters
    ----------
    grey : (height, width) uint8, an object's box or a whole picture
    to_plane : takes pixels (n, 2) of this picture, x before y, to the table plane (n, 2 or more)
    tol : thresholds of edges; None for the defaults

    Raises
    ------
    ValueError : not a grey picture of uint8
    """
    edges = edge_points(grey, to_plane, tol or GreyTolerances())
    if len(edges.points_mm) == 0:
        none = np.zeros(0)
        return Edgelets(np.zeros((0, 2)), none, none, none)
    turn = np.arctan2(edges.normals[:, 1], edges.normals[:, 0])
    sector = np.round(turn * (SECTORS / (2 * np.pi))).astype(np.int64) % SECTORS
    cell = np.floor(edges.points_mm / EDGELET_MM).astype(np.int64)
    cell -= cell.min(axis=0)
    key = (cell[:, 1] * (int(cell[:, 0].max()) + 1) + cell[:, 0]) * SECTORS + sector
    _, of, count = np.unique(key, return_inverse=True, return_counts=True)
    relative = np.clip(edges.strength / (PLAIN * edges.plain), FAINTEST, 1.0)
    columns = (*edges.points_mm.T, *edges.normals.T, relative)
    x, y, nx, ny, strength = (np.bincount(of, weights=c) / count for c in columns)
    along = (np.arctan2(ny, nx) + np.pi / 2) % np.pi
    # a ridge has one point for each row or column of pixels that it crosses
    length_mm = count * edges.pitch_mm * np.hypot(nx, ny) / np.maximum(np.abs(nx), np.abs(ny))
    every = Edgelets(np.column_stack([x, y]), along, length_mm, strength)
    return every.at(count >= MIN_POINTS)


def join_edgelets(parts: list[Edgelets]) -> Edgelets:
    """Return edgelets of several pictures as one."""
    return Edgelets(
        np.concatenate([p.points_mm for p in parts]),
        np.concatenate([p.directions_rad for p in parts]),
        np.concatenate([p.lengths_mm for p in parts]),
        np.concatenate([p.strengths for p in parts]),
    )
