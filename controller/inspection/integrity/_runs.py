"""Runs of displaced outline points: means over windows of many lengths, against their noise.

A short deep notch and a long shallow one are both rare by chance. Each window's mean is compared
with its standard deviation from noise, light and uneven edges. The limit follows from the number of
windows of a part and the allowed rate of false alarms.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.special import ndtri

from controller.arrays import BoolArray, FloatArray, IntArray, inner

WINDOWS_PX: Final = (1.5, 3.0, 6.0, 12.0, 24.0)  # half lengths of the windows
BLUR_PX: Final = 3.0  # distance along an edge within which points are not independent
ALIKE: Final = 0.5  # least cosine between normals of one run
LINKED_PX: Final = 3.0  # largest distance between points of one run
# Cosine between normals below which they belong to two sides of a sliver, gap or sharp corner.
OPPOSITE: Final = -0.2
BELONGS: Final = 0.4  # share of a run's largest difference from which a point belongs to the run


@dataclass(frozen=True, slots=True)
class RunTest:
    """Test of a run against chance.

    Attributes
    ----------
    noise_px : standard deviation of one point
    wave_px : standard deviation of common displacements of neighbours by light and uneven edges
    false_alarms : mean number of false runs per good part
    view_count : number of views of the part
    """

    noise_px: float
    wave_px: float
    false_alarms: float = 1e-3
    view_count: int = 1

    def limit(self, point_count: int) -> float:
        """Return the limit of a window's mean, in standard deviations, for a number of points."""
        windows = len(WINDOWS_PX) * max(point_count / BLUR_PX, 1.0) * max(self.view_count, 1)
        return -float(ndtri(self.false_alarms / (2 * windows)))

    def sigma_px(self, count: FloatArray) -> FloatArray:
        """Return the standard deviation of means over given numbers of points (n,)."""
        independent = np.maximum(count / BLUR_PX, 1.0)
        return np.asarray(np.hypot(self.noise_px / np.sqrt(independent), self.wave_px))


@dataclass(frozen=True, eq=False, slots=True)
class Run:
    """Neighbouring outline points that are off to one side.

    Attributes
    ----------
    points : numbers of the points, in the given order
    depth_px : largest difference with sign; positive for extra material
    length_px : length along the outline
    area_px : area between both outlines
    significance : that of the most significant window, in standard deviations
    """

    points: IntArray
    depth_px: float
    length_px: float
    area_px: float
    significance: float


def find_runs(
    at_px: FloatArray, normals: FloatArray, off_px: FloatArray, step_px: float, test: RunTest
) -> list[Run]:
    """Return the runs of an outline not explained by chance.

    Parameters
    ----------
    at_px, normals : (n, 2) points of the predicted outline, and its normals
    off_px : (n,) distance of the observed outline beyond it; nan where unknown
    step_px : distance between points
    test : test of a run against chance
    """
    known = np.flatnonzero(np.isfinite(off_px))
    if len(known) < 3:
        return []
    at, direction, off = at_px[known], normals[known], off_px[known]
    tree = cKDTree(at)
    limit = test.limit(len(known))
    best = np.zeros(len(known))
    for half in WINDOWS_PX:
        beside = _beside(tree, direction, half)
        count = np.asarray(beside.sum(axis=1), dtype=np.float64).ravel()
        mean = (beside @ off) / count
        z = mean / test.sigma_px(count * step_px)
        best = np.where(np.abs(z) > np.abs(best), z, best)
    runs = []
    for sign in (1.0, -1.0):
        flagged = sign * best > limit
        runs += _linked(tree, flagged, sign, off, best, known, step_px, test, limit)
    return sorted(runs, key=lambda run: -run.significance)


def crowded(at_px: FloatArray, normals: FloatArray, reach_px: float) -> BoolArray:
    """Return a mask (n,) of outline points whose other side is within the reach of blur.

    Parameters
    ----------
    at_px, normals : (n, 2) points of the outline, and its normals
    reach_px : reach of blur
    """
    out: BoolArray = np.zeros(len(at_px), dtype=bool)
    pairs = cKDTree(at_px).query_pairs(reach_px, output_type="ndarray")
    facing = inner(normals[pairs[:, 0]], normals[pairs[:, 1]]) < OPPOSITE
    out[pairs[facing]] = True
    return out


def alone(at_px: FloatArray, normals: FloatArray) -> BoolArray:
    """Return a mask (n,) of outline points without a neighbour of their direction.

    A face that shows over less than blur reaches, as in a jog at a corner, has no outline of its
    own: along its normal another face's is met.

    Parameters
    ----------
    at_px, normals : (n, 2) points of the outline, about a pixel apart, and its normals
    """
    beside = _beside(cKDTree(at_px), normals, WINDOWS_PX[0])
    return np.asarray(beside.sum(axis=1)).ravel() <= 1


def _beside(tree: cKDTree, direction: FloatArray, half_px: float) -> sp.csr_matrix:
    """Return a mask (n, n) of points in each other's window."""
    n = len(direction)
    pairs = tree.query_pairs(half_px, output_type="ndarray")
    alike = inner(direction[pairs[:, 0]], direction[pairs[:, 1]]) > ALIKE
    i, j = pairs[alike].T
    rows = np.concatenate([i, j, np.arange(n)])
    columns = np.concatenate([j, i, np.arange(n)])
    return sp.csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(n, n))


def _linked(
    tree: cKDTree,
    flagged: BoolArray,
    sign: float,
    off: FloatArray,
    best: FloatArray,
    known: IntArray,
    step_px: float,
    test: RunTest,
    limit: float,
) -> list[Run]:
    if not flagged.any():
        return []
    pairs = tree.query_pairs(LINKED_PX, output_type="ndarray")
    pairs = pairs[flagged[pairs].all(axis=1)]
    n = len(off)
    graph = sp.csr_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    _, label = connected_components(graph, directed=False)
    out = []
    for name in np.unique(label[flagged]):
        mine = np.flatnonzero(flagged & (label == name))
        # Windows extend beyond the displaced points.
        size = sign * off[mine]
        mine = mine[size > max(BELONGS * float(size.max()), 2 * test.noise_px)]
        if len(mine) == 0:
            continue
        own = float(np.abs(off[mine].mean())) / float(
            test.sigma_px(np.array([len(mine) * step_px]))[0]
        )
        if own < limit:  # a window reached as far as here, that is all
            continue
        out.append(
            Run(
                points=known[mine],
                depth_px=float(sign * (sign * off[mine]).max()),
                length_px=len(mine) * step_px,
                area_px=float(np.abs(off[mine]).sum()) * step_px,
                significance=float(np.abs(best[mine]).max()),
            )
        )
    return out
