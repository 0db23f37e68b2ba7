"""Edgelets of a library's views in one table, with the size of each view.

A library may hold thousands of views, so the table stores them as small numbers.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.arrays import Float32Array, FloatArray, IntArray

ASKED: Final = 96  # edgelets of a view in coarse scores
FULL: Final = 32767  # largest short number: 0.01 mm of 300
MIN_HULL: Final = 6  # edgelets below which a view has no size


@dataclass(frozen=True, eq=False, slots=True)
class EdgeletIndex:
    """The library's edgelets, padded.

    Attributes
    ----------
    packed : (5, views, k) of the edgelets of `view_edgelets`, weight 0 where there are fewer
    steps : (5, 1, 1) unit of each row of ``packed``
    totals, asked_totals : (views,) their weights' sum, and of those that coarse scores ask for
    middles_mm, sizes_mm : (views, 2) and (views,) middle and root of the area of each view's hull;
        0 for a view without one
    spreads : (views,) mean rate at which its edgelets move with the part
    reach_mm : (views,) half the diagonal of a view about its origin
    """

    packed: NDArray[np.int16]
    steps: Float32Array
    totals: FloatArray
    asked_totals: FloatArray
    middles_mm: FloatArray
    sizes_mm: FloatArray
    spreads: FloatArray
    reach_mm: FloatArray

    def edgelets(self, views: IntArray, begin: int = 0, end: int | None = None) -> Float32Array:
        """Return (5, n, k) x, y, spread, direction and weight of some edgelets of views.

        Parameters
        ----------
        views : (n,) numbers of the views
        begin, end : first and last edgelet of each; None for up to the last
        """
        return np.asarray(self.packed[:, views, begin:end] * self.steps, np.float32)


def edgelet_index(views: Sequence[Float32Array]) -> EdgeletIndex:
    """Return the index of a library's views, made once for the library.

    Parameters
    ----------
    views : (k, 5) `view_edgelets` of each
    """
    most = max((len(v) for v in views), default=0)
    largest = np.full(5, 1e-6)
    for v in views:
        if len(v):
            largest = np.maximum(largest, np.abs(v).max(axis=0))
    steps = largest / FULL
    packed = np.zeros((5, len(views), most), dtype=np.int16)
    for number, v in enumerate(views):
        packed[:, number, : len(v)] = np.rint(v / steps).T
    weights = packed[4] * steps[4]
    hulls = np.array([_hull(v) for v in views]).reshape(-1, 4)
    return EdgeletIndex(
        packed,
        steps.astype(np.float32).reshape(5, 1, 1),
        np.maximum(weights.sum(axis=1, dtype=np.float64), 1e-9),
        np.maximum(weights[:, :ASKED].sum(axis=1, dtype=np.float64), 1e-9),
        hulls[:, :2],
        hulls[:, 2],
        hulls[:, 3],
        np.array([float(np.hypot(v[:, 0], v[:, 1]).max(initial=0.0)) for v in views]),
    )


def _hull(view: Float32Array) -> FloatArray:
    """Return middle x, y, root of the area and mean spread of a view's hull (4,); or zeros."""
    if len(view) >= MIN_HULL:
        m = cv2.moments(cv2.convexHull(np.ascontiguousarray(view[:, :2])))
        if m["m00"] >= 1.0:
            middle = m["m10"] / m["m00"], m["m01"] / m["m00"]
            return np.array([*middle, np.sqrt(m["m00"]), float(view[:, 2].mean())])
    return np.zeros(4)
