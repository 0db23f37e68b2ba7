"""All views of all parts, searchable by shape: thousands of them in about a millisecond.

Area first, as the paper has it (references.md P3.1), then what of the outline does not change with
its turn. Both are coordinates of one space in which a k-d tree finds the nearest views.
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
SIZE_WEIGHT = 1.0  # of a relative difference in area, beside that of the outline's shape
PERIMETER_WEIGHT = 0.3  # it trembles with pixels and dirt, so it counts for less
MAX_FOR_BASIS = 4000
OTHER_SHAPE = 0.12  # of overlap: what falls so far short of the best view is not looked into


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
    """A view that an observed silhouette may be of.

    Attributes
    ----------
    part, pose : indices
    theta_rad : turn about z
    x_mm, y_mm : of the centre of mass
    overlap : cosine of the two silhouettes, 0..1
    distance : in the index
    slack_mm : how far off its place may be because the view was made for another one
    silhouette : which of the object's it was found by, where it may have several
    """

    part: int
    pose: int
    theta_rad: float
    x_mm: float
    y_mm: float
    overlap: float
    distance: float
    slack_mm: float = 0.0
    silhouette: int = 0

    @property
    def place_mm(self) -> FloatArray:
        """Where the centre of mass stands, (2,)."""
        return np.array([self.x_mm, self.y_mm])


class ViewIndex:
    """Views of a library of parts.

    Parameters
    ----------
    views : of each part
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
        self._looks: dict[int, tuple[Float32Array, Float32Array, Float32Array]] = {}
        self._eye = np.asarray(eye_mm, dtype=np.float64)
        self._bits = np.concatenate([v.bits for v in views])
        self._mean, self._basis = self._principal(views)
        shapes = np.concatenate([self._project(v.shapes) for v in views])
        self._tree = cKDTree(self._point(shapes, self.area_mm2, self._perimeter_mm))

    @property
    def view_count(self) -> int:
        """How many views there are."""
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

    def looks(self, count: int) -> tuple[Float32Array, Float32Array, Float32Array]:
        """Return `outline_samples` of all views, kept from the first time on; for small counts."""
        if count not in self._looks:
            self._looks[count] = self.outline_samples(np.arange(self.view_count), count)
        return self._looks[count]

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

    def search(
        self,
        seen: Silhouette,
        max_view_count: int = 48,
        turns_each: int = 4,
        within: float = 0.05,
        far: float = 0.6,
    ) -> list[Candidate]:
        """Return what a silhouette may be, best overlap first.

        Parameters
        ----------
        seen : the silhouette, table plane [mm]
        max_view_count : so many nearest views are compared turn by turn
        turns_each : so many turns of one view at most, for near-symmetric outlines
        within : overlap a turn may fall short of the view's best one
        far : distance in the index beyond which nothing is looked at
        """
        coarse = np.where(seen.grid > HALF, np.uint8(255), np.uint8(0))
        point = self._point(
            self._project(shape_of(coarse[None])),
            np.array([seen.area_mm2]),
            np.array([seen.perimeter_mm]),
        )[0]
        distance, nearest = self._tree.query(point, k=min(max_view_count, self.view_count))
        distance, nearest = np.atleast_1d(distance), np.atleast_1d(nearest)
        near = distance < far
        distance, nearest = distance[near], nearest[near]
        if len(nearest) == 0:
            return []
        grids = np.unpackbits(self._bits[nearest], axis=-1) * np.uint8(255)
        scores = turn_scores(spectra(grids), spectra(seen.grid))
        best = scores.max(axis=1)
        found = []
        for row in np.flatnonzero(best > best.max() - OTHER_SHAPE).tolist():
            view = int(nearest[row])
            found += self._turns(view, scores[row], float(distance[row]), seen, turns_each, within)
        found.sort(key=lambda c: -c.overlap)
        return _distinct(found)

    def _turns(
        self,
        view: int,
        scores: Float32Array,
        distance: float,
        seen: Silhouette,
        turns_each: int,
        within: float,
    ) -> list[Candidate]:
        peak = (scores >= np.roll(scores, 1)) & (scores > np.roll(scores, -1))
        peak &= scores > scores.max() - within
        at = np.flatnonzero(peak)
        if len(at) == 0:  # a disc: all turns are as good
            at = np.array([int(scores.argmax())])
        at = at[np.argsort(-scores[at], kind="stable")][: 3 * turns_each]
        foot = self._eye[:2]
        found: list[Candidate] = []
        for k in at.tolist():
            theta = 2 * np.pi * (k + _vertex(scores, k)) / TURNS
            c, s = np.cos(theta), np.sin(theta)
            R = np.array([[c, -s], [s, c]])
            place = seen.centroid_mm - R @ self.centroid_mm[view] - foot
            apart = float(np.linalg.norm(place - R @ self.place_mm[view]))
            if apart > self.ring_mm[view]:
                continue  # seen from that side it would look otherwise
            x, y = place + foot
            found.append(
                Candidate(
                    int(self.part[view]),
                    int(self.pose[view]),
                    float(np.arctan2(s, c)),
                    float(x),
                    float(y),
                    float(scores[k]),
                    distance,
                    apart * float(self.lean[view]),
                )
            )
            if len(found) == turns_each:
                break
        return found


def _vertex(scores: Float32Array, k: int) -> float:
    before, at, after = (float(scores[(k + d) % len(scores)]) for d in (-1, 0, 1))
    bow = before - 2 * at + after
    return 0.0 if bow > -1e-9 else float(np.clip(0.5 * (before - after) / bow, -0.5, 0.5))


def _distinct(candidates: list[Candidate], apart_rad: float = 0.09) -> list[Candidate]:
    """Drop what is the same part, pose and turn again, from a neighbouring view."""
    kept: list[Candidate] = []
    for c in candidates:
        if not any(
            k.part == c.part
            and k.pose == c.pose
            and abs((k.theta_rad - c.theta_rad + np.pi) % (2 * np.pi) - np.pi) < apart_rad
            for k in kept
        ):
            kept.append(c)
    return kept
