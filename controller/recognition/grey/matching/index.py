"""Index of the library's keys: tables sorted by the first key, searched by bisection.

A library may hold thousands of views, so the index stores them as small numbers: 7 kB a view.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controller.arrays import Float32Array, FloatArray, IntArray

from .._tolerances import GreyTolerances
from ._hulls import hull_of
from .keys import KINDS, Frames, frames_of, joined, taken
from .model import ModelFeatures

ASKED = 96  # edgelets of a view in coarse scores
FULL = 32767  # largest short number: 0.01 mm of 300


@dataclass(frozen=True, eq=False, slots=True)
class FeatureIndex:
    """The library's features, by kind sorted by their first key; and its edgelets, padded.

    Attributes
    ----------
    models : views as they were given
    tables : tables of each of `KINDS`, in single precision
    packed : (5, views, k) of the edgelets of `ModelFeatures`, weight 0 where there are fewer
    steps : (5, 1, 1) unit of each row of ``packed``
    totals, asked_totals : (views,) their weights' sum, and of those that coarse scores ask for
    hulls : (views, 7) hull of `hull_of`, and its motion with the part
    reach_mm : (views,) half the diagonal of a view about its origin
    """

    models: tuple[ModelFeatures, ...]
    tables: dict[str, Frames]
    packed: NDArray[np.int16]
    steps: Float32Array
    totals: FloatArray
    asked_totals: FloatArray
    reach_mm: FloatArray
    hulls: FloatArray

    def edgelets(self, views: IntArray, begin: int = 0, end: int | None = None) -> Float32Array:
        """Return (5, n, k) x, y, spread, direction and weight of some edgelets of views.

        Parameters
        ----------
        views : (n,) numbers in ``models``
        begin, end : first and last edgelet of each; None for up to the last
        """
        return np.asarray(self.packed[:, views, begin:end] * self.steps, np.float32)


def feature_index(
    models: Sequence[ModelFeatures], tol: GreyTolerances | None = None
) -> FeatureIndex:
    """Return the index of a library's views, made once for the library."""
    tol = tol or GreyTolerances()
    parts: dict[str, list[Frames]] = {kind: [] for kind in KINDS}
    for number, m in enumerate(models):
        frames = frames_of(
            m.lines_mm,
            m.line_spread,
            m.line_weights,
            m.corners,
            m.circles_mm,
            m.circle_spread,
            m.circle_weights,
            tol,
            both_directions=False,
        )
        for kind, frame in frames.items():
            if len(frame.keys):
                frame.model[:] = number
                parts[kind].append(frame)
    packed, steps = _packed(models)
    weights = packed[4] * steps[4]
    return FeatureIndex(
        tuple(models),
        {kind: _table(rows) for kind, rows in parts.items()},
        packed,
        steps,
        np.maximum(weights.sum(axis=1, dtype=np.float64), 1e-9),
        np.maximum(weights[:, :ASKED].sum(axis=1, dtype=np.float64), 1e-9),
        np.array([_reach(m) for m in models]),
        np.array([_hull(m) for m in models]).reshape(-1, 7),
    )


def _packed(models: Sequence[ModelFeatures]) -> tuple[NDArray[np.int16], Float32Array]:
    """Return all edgelets (5, views, k) as 16-bit integers, and their steps (5, 1, 1)."""
    most = max((len(m.edgelets) for m in models), default=0)
    largest = np.full(5, 1e-6)
    for m in models:
        if len(m.edgelets):
            largest = np.maximum(largest, np.abs(m.edgelets).max(axis=0))
    steps = largest / FULL
    packed = np.zeros((5, len(models), most), dtype=np.int16)
    for number, m in enumerate(models):
        packed[:, number, : len(m.edgelets)] = np.rint(m.edgelets / steps).T
    return packed, steps.astype(np.float32).reshape(5, 1, 1)


def _table(rows: list[Frames]) -> Frames:
    """Return the features of a kind of all views, by their first key."""
    every = joined(rows)
    every = taken(every, np.argsort(every.keys[:, 0], kind="stable"))
    return Frames(
        np.asfortranarray(every.keys, np.float32),  # columns are searched
        every.points.astype(np.float32),
        every.spread.astype(np.float32),
        every.turns_rad.astype(np.float32),
        every.weights.astype(np.float32),
        every.model.astype(np.int32),
    )


def _reach(m: ModelFeatures) -> float:
    return float(np.hypot(m.edgelets[:, 0], m.edgelets[:, 1]).max()) if len(m.edgelets) else 0.0


def _hull(m: ModelFeatures) -> FloatArray:
    hull = hull_of(m.edgelets[:, :2].astype(np.float64))
    if hull is None:
        return np.zeros(7)
    return np.asarray(np.append(hull, m.edgelets[:, 2].mean()))


def near_keys(table: Frames, keys: NDArray[np.floating], most: int) -> tuple[IntArray, IntArray]:
    """Return pairs (row of keys, row of the table) within 1 in every key.

    Parameters
    ----------
    table : sorted by its first key
    keys : (n, d) in tolerances, the most telling rows first
    most : about so many pairs are looked at; rows beyond are left out
    """
    if len(table.keys) == 0 or len(keys) == 0:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    first = table.keys[:, 0]
    low = np.searchsorted(first, (keys[:, 0] - 1.0).astype(first.dtype))
    high = np.searchsorted(first, (keys[:, 0] + 1.0).astype(first.dtype), side="right")
    count = high - low
    count[np.cumsum(count) > most] = 0
    row = np.repeat(np.arange(len(keys)), count)
    at = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count) + low[row]
    for column in range(1, keys.shape[1]):
        ok = np.abs(table.keys[at, column] - keys[row, column]) <= 1.0
        row, at = row[ok], at[ok]
    return row, at
