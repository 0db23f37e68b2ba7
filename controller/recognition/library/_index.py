"""All views of all parts, searchable by shape: thousands of them in about a millisecond.

Area first, as in the paper (references.md P3.1), then features of the outline that do not change
with its turn. Both are coordinates of one space in which a k-d tree finds the nearest views.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from controller.arrays import Float32Array, FloatArray, Int32Array, IntArray

from ._views import PartViews
from .polar import HALF, TURNS, shape_of, spectra, turn_scores

DIMENSIONS = 12
SIZE_WEIGHT = 1.0  # weight of a relative difference in area, beside the outline's shape
PERIMETER_WEIGHT = 0.3  # weight of the perimeter, lower since it varies with pixels and dirt
MAX_FOR_BASIS = 4000
FEW_VIEWS = 48  # number of views compared turn by turn: 1 to 2 ms
OTHER_SHAPE = 0.12  # loss of overlap against the best view from which a view is not tried


@dataclass(frozen=True, eq=False, slots=True)
class Silhouette:
    """An observed silhouette in the table plane.

    Attributes
    ----------
    area_mm2, perimeter_mm : holes excluded; their outlines included
    centroid_mm : (2,)
    grid : (RINGS, ANGLES) polar grid
    """

    area_mm2: float
    perimeter_mm: float
    centroid_mm: FloatArray
    grid: NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Candidate:
    """A part in a stable pose somewhere, as one of the proposers has it.

    Attributes
    ----------
    part, pose : indices
    theta_rad : turn about z
    x_mm, y_mm : position of the centre of mass
    overlap : cosine of the two silhouettes, 0..1; of other proposers, their score
    distance : in the index
    slack_mm : allowance for the offset of its position from the one that the view was made for
    piece : number of the cluster's piece by which it was found
    source : what proposed it: "outline", "stretches" of it, or "edges"
    """

    part: int
    pose: int
    theta_rad: float
    x_mm: float
    y_mm: float
    overlap: float
    distance: float
    slack_mm: float = 0.0
    piece: int = 0
    source: str = "outline"

    @property
    def place_mm(self) -> FloatArray:
        """Position of the centre of mass, (2,)."""
        return np.array([self.x_mm, self.y_mm])


class ViewIndex:
    """Views of a library of parts.

    Parameters
    ----------
    views : views of each part
    eye_mm : (3,) the camera's centre in the world
    """

    def __init__(self, views: Sequence[PartViews], eye_mm: FloatArray) -> None:
        counts = [len(v.pose) for v in views]
        self.part: Int32Array = np.repeat(np.arange(len(views), dtype=np.int32), counts)
        self.pose: Int32Array = np.concatenate([v.pose for v in views])
        self.place_mm = np.concatenate([v.place_mm for v in views])
        self.ring_mm = np.concatenate([v.ring_mm for v in views])
        self.lean = np.concatenate([v.lean for v in views])
        self.centroid_mm = np.concatenate([v.centroid_mm for v in views])
        self.area_mm2 = np.concatenate([v.area_mm2 for v in views])
        self._perimeter_mm = np.concatenate([v.perimeter_mm for v in views])
        self.outer_mm = np.concatenate([v.outer_mm for v in views])
        self._holes_mm = np.concatenate([v.holes_mm for v in views])
        self._eye = np.asarray(eye_mm, dtype=np.float64)
        self._bits = np.concatenate([v.bits for v in views])
        self._mean, self._basis = self._principal(views)
        shapes = np.concatenate([self._project(v.shapes) for v in views])
        self._tree = cKDTree(self._point(shapes, self.area_mm2, self._perimeter_mm))

    @property
    def view_count(self) -> int:
        """Number of views."""
        return len(self.part)

    def outline_samples(
        self, views: IntArray, count: int
    ) -> tuple[Float32Array, Float32Array, Float32Array]:
        """Return points (n, m, 2), normals (n, m, 2) and weights (n, m) of some views' outlines.

        Parameters
        ----------
        views : (n,) indices
        count : about so many samples of each, the holes' among them; a weight is the length that
            a sample speaks for, 0 where there is none
        """
        outer = self.outer_mm[views].astype(np.float32)
        ahead = np.roll(outer, -1, axis=1) - outer
        perimeter = np.sqrt((ahead**2).sum(axis=2)).sum(axis=1)
        every = max(1, 3 * outer.shape[1] // (2 * count))
        at = np.arange(0, outer.shape[1], every)
        tangent = outer[:, (at + 2) % outer.shape[1]] - outer[:, at - 2]
        tangent /= np.maximum(np.sqrt((tangent**2).sum(axis=2, keepdims=True)), 1e-9)
        normals = np.stack([tangent[..., 1], -tangent[..., 0]], axis=-1)
        holes = self._holes_mm[views][:, :: max(1, 3 * self._holes_mm.shape[1] // count)]
        both = np.concatenate(
            [np.concatenate([outer[:, at], normals], axis=2), holes.astype(np.float32)], axis=1
        )
        rest = np.maximum(self._perimeter_mm[views] - perimeter, 0.0)
        weights = np.repeat(
            np.stack([perimeter / len(at), rest / holes.shape[1]], axis=1).astype(np.float32),
            [len(at), holes.shape[1]],
            axis=1,
        )
        weights[~np.isfinite(both[..., 0])] = 0.0
        both = np.nan_to_num(both)
        return both[..., :2], both[..., 2:], weights

    def _principal(self, views: Sequence[PartViews]) -> tuple[Float32Array, Float32Array]:
        """Return mean (f,) and the directions (f, d) in which the shapes differ most."""
        every = max(1, sum(len(v.pose) for v in views) // MAX_FOR_BASIS)
        rows = np.concatenate([v.shapes[::every] for v in views]).astype(np.float32)
        mean = rows.mean(axis=0)
        _, _, directions = np.linalg.svd(rows - mean, full_matrices=False)
        return mean, np.ascontiguousarray(directions[:DIMENSIONS].T)

    def _project(self, shapes: NDArray[Any]) -> Float32Array:
        return np.asarray((shapes - self._mean) @ self._basis, dtype=np.float32)

    def _point(self, shape: Float32Array, area: FloatArray, perimeter: FloatArray) -> FloatArray:
        size = SIZE_WEIGHT * np.log(area)
        # how much longer the outline is than a disc's: the area is known already
        ragged = PERIMETER_WEIGHT * np.log(perimeter / np.sqrt(4 * np.pi * area))
        return np.column_stack([shape, size, ragged]).astype(np.float64)

    def _point_of(self, seen: Silhouette) -> FloatArray:
        coarse = np.where(seen.grid > HALF, np.uint8(255), np.uint8(0))
        points = self._point(
            self._project(shape_of(coarse[None])),
            np.array([seen.area_mm2]),
            np.array([seen.perimeter_mm]),
        )
        return np.asarray(points[0], dtype=np.float64)

    def near_count(self, seen: Silhouette, far: float) -> int:
        """Return the number of views within a distance of a silhouette in the index."""
        return int(self._tree.query_ball_point(self._point_of(seen), far, return_length=True))

    def search(
        self,
        seen: Silhouette,
        max_view_count: int = FEW_VIEWS,
        turns_each: int = 4,
        within: float = 0.05,
        far: float = 0.6,
    ) -> list[Candidate]:
        """Return the candidates for a silhouette, best overlap first.

        Parameters
        ----------
        seen : the silhouette, table plane [mm]
        max_view_count : so many nearest views are compared turn by turn
        turns_each : so many turns of one view at most, for near-symmetric outlines
        within : overlap a turn may fall short of the view's best one
        far : distance in the index beyond which nothing is looked at
        """
        point = self._point_of(seen)
        distance, nearest = self._tree.query(point, k=min(max_view_count, self.view_count))
        distance, nearest = np.atleast_1d(distance), np.atleast_1d(nearest)
        near = distance < far
        distance, nearest = distance[near], nearest[near]
        if len(nearest) == 0:
            return []
        grids = np.unpackbits(self._bits[nearest], axis=-1) * np.uint8(255)
        scores = turn_scores(spectra(grids), spectra(seen.grid))
        best = scores.max(axis=1)
        rows = np.flatnonzero(best > best.max() - OTHER_SHAPE)
        return self._turns(nearest[rows], scores[rows], distance[rows], seen, turns_each, within)

    def _turns(
        self,
        views: IntArray,
        scores: Float32Array,
        distance: FloatArray,
        seen: Silhouette,
        turns_each: int,
        within: float,
    ) -> list[Candidate]:
        """Return the best turns of some views (v,) by their scores (v, TURNS), best first."""
        before, after = np.roll(scores, 1, axis=1), np.roll(scores, -1, axis=1)
        best = scores.max(axis=1)
        peak = (scores >= before) & (scores > after) & (scores > best[:, None] - np.float32(within))
        even = np.flatnonzero(~peak.any(axis=1))  # a disc: all turns are as good
        peak[even, scores[even].argmax(axis=1)] = True
        row, k = np.nonzero(peak)
        order = np.lexsort((-scores[row, k], row))  # stable: of equal turns the first
        row, k = row[order], k[order]
        kept = _place_in(row) < 3 * turns_each
        row, k = row[kept], k[kept]
        view = views[row]
        levels = (before[row, k], scores[row, k], after[row, k])
        theta = 2 * np.pi * (k + _vertex(*(level.astype(np.float64) for level in levels))) / TURNS
        c, s = np.cos(theta), np.sin(theta)
        foot = self._eye[:2]
        place = seen.centroid_mm - _turned(c, s, self.centroid_mm[view]) - foot
        away = place - _turned(c, s, self.place_mm[view])
        apart = np.sqrt((away**2).sum(axis=1))
        near = np.flatnonzero(apart <= self.ring_mm[view])  # from elsewhere it would look otherwise
        near = near[_place_in(row[near]) < turns_each]
        overlap = levels[1]
        near = near[np.argsort(-overlap[near], kind="stable")]
        turn = np.arctan2(s, c)
        near = near[_distinct(self.part[view[near]], self.pose[view[near]], turn[near])]
        view = view[near]
        columns = (
            self.part[view],
            self.pose[view],
            turn[near],
            *(place[near] + foot).T,
            overlap[near],
            distance[row[near]],
            apart[near] * self.lean[view],
        )
        rows = zip(*(column.tolist() for column in columns), strict=True)
        return [Candidate(*one) for one in rows]


def _place_in(row: IntArray) -> IntArray:
    """Return the ordinal (n,) of each entry of sorted rows in its row."""
    return np.arange(len(row)) - np.searchsorted(row, row)


def _turned(c: FloatArray, s: FloatArray, points: FloatArray) -> FloatArray:
    """Return points (n, 2), each turned by its own angle."""
    x, y = points.T
    return np.column_stack([c * x - s * y, s * x + c * y])


def _vertex(before: FloatArray, at: FloatArray, after: FloatArray) -> FloatArray:
    """Return the offset (n,) of the peak of a parabola through three values from their middle."""
    bow = before - 2 * at + after
    top = np.clip(0.5 * (before - after) / np.minimum(bow, -1e-9), -0.5, 0.5)
    return np.asarray(np.where(bow > -1e-9, 0.0, top))


def _distinct(
    part: Int32Array, pose: Int32Array, theta_rad: FloatArray, apart_rad: float = 0.09
) -> list[int]:
    """Return the indices of distinct parts, poses and turns, one for neighbouring views."""
    kept: list[int] = []
    turns: dict[tuple[int, int], list[float]] = {}
    for k, (*name, theta) in enumerate(
        zip(part.tolist(), pose.tolist(), theta_rad.tolist(), strict=True)
    ):
        known = turns.setdefault((name[0], name[1]), [])
        if not any(
            abs((other - theta + np.pi) % (2 * np.pi) - np.pi) < apart_rad for other in known
        ):
            known.append(theta)
            kept.append(k)
    return kept
