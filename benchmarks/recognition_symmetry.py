"""Which ways a part can lie are one and the same, found from its surface alone.

The judge of recognition uses this and nothing of the room it judges: two ways to lie are one where
a turn about the vertical takes one surface into the other. The greatest distance of two surfaces
changes by at most the part's radius times the turn, so an interval of turns is ruled out whole by
one measurement at its middle; nothing between two samples can be overlooked.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

# Surfaces nowhere further apart than this are one. The shared parts leave a gap: turns that the
# designer meant to be the same come out 0.15 to 0.36 mm apart, since a curved face is triangles;
# the nearest turn or side that he did not is 2.7 mm apart. Two pixels of the cell's camera.
SAME_MM = 0.5
TILT_RAD = 0.02  # the same side down, by two ways to compute it: facets of one curved face too
PROBES = 1200  # points of each surface measured against the other
SPACING_MM = 0.5  # of the points by which the nearest triangles are found
GAP_MM = 2.0  # no point of the surface is further from one of them
NEAREST = 6  # triangles tried for a point: those of the nearest points on the surface
START_RAD = np.radians(6.0)
FINE_RAD = np.radians(0.4)
ONE_RAD = np.radians(2.5)  # turns this close are one: a nearly round rim fits at several


@dataclass(frozen=True, eq=False, slots=True)
class Turns:
    """The turns about z that take one way to lie into another.

    Attributes
    ----------
    turns_rad : (n,) ascending in 0 .. 2 pi; empty where none does
    is_round : every turn does
    """

    turns_rad: Array
    is_round: bool

    @property
    def exist(self) -> bool:
        return self.is_round or len(self.turns_rad) > 0


class Surface:
    """A part's surface round its centre of mass, ready for measuring how far others are from it.

    Parameters
    ----------
    mesh : closed; the centre of mass is its volume's
    """

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        self.centroid_mm: Array = np.asarray(mesh.center_mass, dtype=np.float64)
        self._triangles = np.asarray(mesh.triangles - self.centroid_mm, dtype=np.float64)
        count = int(np.clip(mesh.area / SPACING_MM**2, 20_000, 400_000))
        points, owner = trimesh.sample.sample_surface(mesh, count, seed=20260101)
        # every triangle is named at least by its middle and its corners, however small it is
        middles = self._triangles.mean(axis=1)
        corners = self._triangles.reshape(-1, 3)
        self._points = np.concatenate([points - self.centroid_mm, middles, corners])
        every = np.arange(len(middles))
        self._owner = np.concatenate([owner, every, np.repeat(every, 3)])
        self._tree = cKDTree(self._points)
        self.probes_mm = _probes(points[: 20 * PROBES] - self.centroid_mm, corners)
        self.radius_mm = float(np.linalg.norm(self._triangles, axis=2).max())
        self._turns: dict[tuple[float, ...], Turns] = {}
        self._own: dict[tuple[float, ...], Turns] = {}

    def distances_mm(self, points: Array) -> Array:
        """Return how far points (n, 3), from the centre of mass, are from the surface, (n,)."""
        _, near = self._tree.query(points, k=NEAREST)
        triangles = self._triangles[self._owner[near]].reshape(-1, 3, 3)
        repeated = np.repeat(points, NEAREST, axis=0)
        closest = trimesh.triangles.closest_point(triangles, repeated)
        apart = np.linalg.norm(closest - repeated, axis=1).reshape(-1, NEAREST)
        return np.asarray(apart.min(axis=1))

    def apart_mm(self, R: Array, every: int = 1) -> Array:
        """Return how far the surface and itself turned by R are apart, at the probes of both."""
        probes = self.probes_mm[::every]
        return np.concatenate([self.distances_mm(probes @ R.T), self.distances_mm(probes @ R)])

    def is_near(self, points: Array, limit_mm: float) -> bool:
        """Say whether points (n, 3) are all within a distance of the surface."""
        apart, _ = self._tree.query(points)
        if apart.max() > limit_mm + GAP_MM:
            return False
        # near one of the points on the surface is near the surface; the rest is measured
        open_ones = apart > limit_mm
        return not open_ones.any() or float(self.distances_mm(points[open_ones]).max()) <= limit_mm

    def agrees(self, R: Array, limit_mm: float, every: int = 1) -> bool:
        """Say whether the surface turned by R is within a distance of itself, and it of that."""
        probes = self.probes_mm[::every]
        return self.is_near(probes @ R.T, limit_mm) and self.is_near(probes @ R, limit_mm)

    def turns(self, R_from: Array, R_to: Array) -> Turns:
        """Return the turns about z that take the part lying by R_from into it lying by R_to.

        Parameters
        ----------
        R_from, R_to : (3, 3) CAD -> upright
        """
        key = tuple(np.round(np.concatenate([R_from.ravel(), R_to.ravel()]), 6))
        if key not in self._turns:
            tilt = _tilt(R_from, R_to)
            if np.linalg.norm(tilt) > TILT_RAD:
                self._turns[key] = self._find_turns(R_from, R_to)
            else:
                # one side down: the turn between the two is known exactly, once they are level;
                # and to that come the turns that take the resting part into itself
                level = R_to @ Rotation.from_rotvec(tilt).as_matrix() @ R_from.T
                between = float(np.arctan2(level[1, 0], level[0, 0]))
                own = self._own_turns(R_to)
                turns = np.sort(np.mod(own.turns_rad + between, 2 * np.pi))
                self._turns[key] = Turns(turns, own.is_round)
        return self._turns[key]

    def _own_turns(self, R: Array) -> Turns:
        key = tuple(np.round(R[2], 5))  # the same for every turn about z
        if key not in self._own:
            self._own[key] = self._find_turns(R, R)
        return self._own[key]

    def _find_turns(self, R_from: Array, R_to: Array) -> Turns:
        corners = self._triangles.reshape(-1, 3)
        heights = [corners @ R[2] for R in (R_from, R_to)]
        low, high = (abs(float(f(heights[0]) - f(heights[1]))) for f in (np.min, np.max))
        if max(low, high) > SAME_MM:
            return Turns(np.empty(0), is_round=False)

        # in the CAD frame: Rz(turn) R_from P = R_to P  <=>  R_to^T Rz(turn) R_from P = P
        def relative(turn: float) -> Array:
            c, s = np.cos(turn), np.sin(turn)
            return np.asarray(R_to.T @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ R_from)

        reach_mm = float(np.linalg.norm(corners @ R_from[:2].T, axis=1).max())
        half = START_RAD / 2
        middles = np.arange(half, 2 * np.pi, START_RAD)
        while True:
            # a quarter of the probes rules most turns out; all of them have to agree in the end
            limit_mm = SAME_MM + reach_mm * half
            kept = [t for t in middles if self.agrees(relative(t), limit_mm, every=4)]
            if len(kept) == len(middles) and self._is_round(relative):
                return Turns(np.empty(0), is_round=True)
            if half <= FINE_RAD or not kept:
                break
            middles = np.array([t + s * half / 2 for t in kept for s in (-1, 1)])
            half /= 2
        best = [self._best(relative, low, high) for low, high in _runs(np.array(kept), half)]
        turns = np.array([t for t in best if self.agrees(relative(t), SAME_MM)])
        return Turns(_regular(turns, is_own=R_from is R_to), is_round=False)

    def _is_round(self, relative: Callable[[float], Array]) -> bool:
        # 37 turns: no even division that a gear or a polygon has fits them all
        turns = np.linspace(0, 2 * np.pi, 37, endpoint=False) + 0.05
        return all(self.agrees(relative(t), SAME_MM) for t in turns)

    def _best(self, relative: Callable[[float], Array], low: float, high: float) -> float:
        """Return the turn in an interval that brings the surfaces together best."""

        def mean_square(turn: float) -> float:
            return float((self.apart_mm(relative(turn), every=4) ** 2).mean())

        bounds, exact = (low, high), {"xatol": 1e-5}
        return float(minimize_scalar(mean_square, bounds=bounds, method="bounded", options=exact).x)


def _probes(points: Array, corners: Array) -> Array:
    """Return points of the surface: spread evenly, and corners, where small features show."""
    rng = np.random.default_rng(7)
    half = PROBES // 2
    even = points[rng.choice(len(points), min(half, len(points)), replace=False)]
    # one corner to a cell of 1 mm: finely divided roundings do not crowd out the rest
    _, first = np.unique(np.floor(corners).astype(int), axis=0, return_index=True)
    first = rng.permutation(first)[:half]
    outermost = np.concatenate([corners.argmin(axis=0), corners.argmax(axis=0)])
    far = np.linalg.norm(corners, axis=1).argmax()[None]
    return np.concatenate([even, corners[first], corners[outermost], corners[far]])


def _tilt(R_from: Array, R_to: Array) -> Array:
    """Return the rotation vector (3,) in the CAD frame by which the sides down differ.

    A small one comes from two computations of one facet, or from neighbouring facets of one face,
    and is not to be taken for a difference of shape.
    """
    axis = np.cross(R_from[2], R_to[2])
    sine = float(np.linalg.norm(axis))
    angle = float(np.arctan2(sine, R_from[2] @ R_to[2]))
    return axis / sine * angle if sine > 1e-12 else np.array([angle, 0.0, 0.0])


def _runs(fine: Array, half: float) -> list[tuple[float, float]]:
    """Return the intervals that neighbouring middles cover, over the full turn's seam too."""
    step = 2 * half
    runs: list[list[float]] = []
    for t in np.sort(fine):
        if runs and t - runs[-1][1] < step + ONE_RAD:
            runs[-1][1] = float(t)
        else:
            runs.append([float(t), float(t)])
    if len(runs) > 1 and runs[0][0] + 2 * np.pi - runs[-1][1] < step + ONE_RAD:
        last = runs.pop()
        runs[0][0] = last[0] - 2 * np.pi
    return [(low - half, high + half) for low, high in runs]


def _regular(turns: Array, *, is_own: bool) -> Array:
    """Return the turns as the even division of the circle that they must be.

    Turns that take a body into itself are a group: n of them are 360 / n degrees apart, and one
    of its own is none at all.
    """
    if len(turns) == 0:
        return turns
    step = 2 * np.pi / len(turns)
    # all of them tell where the first is
    first = 0.0 if is_own else float(np.angle(np.exp(1j * turns * len(turns)).mean())) / len(turns)
    even = np.sort(np.mod(first + np.arange(len(turns)) * step, 2 * np.pi))
    off = np.abs(np.angle(np.exp(1j * (turns[:, None] - even[None, :])))).min(axis=1)
    return np.asarray(even if off.max() < ONE_RAD else np.sort(np.mod(turns, 2 * np.pi)))
