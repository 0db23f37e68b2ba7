"""The tables made small without losing an optimum: once per problem, good for every set of grips.

Elements shown by the same views are one; an element that every view of a harder one shows comes by
itself; a view that another of the same grip outdoes at no higher price is not needed. What is left
is often a tenth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..boxes import BoolArray
from ._problem import IntArray, Problem, live_grips, needed_of

Table = NDArray[np.float32]
PRICE_STEPS = 1024.0  # prices in units of the dearest, rounded down: sums of them stay exact
_CHUNK = 24  # views looked at together for what all of them show


@dataclass(frozen=True, slots=True, eq=False)
class Tables:
    """What matters of a problem.

    Attributes
    ----------
    grips : (n,) the live grips, as the problem numbers them; below they are 0..n-1
    rows : per grip (v, m) 0/1, views that no other of the grip outdoes, in a fixed order
    view_ids : per grip (v,) which views these are
    unit_prices : per grip (v,) price over the dearest view's, rounded down to 1/1024
    prices_s : per grip (v,) price [s]
    covered : (n, m) what each grip shows at all
    kinds : (n,) grips of one kind have equal rows and prices
    least_s, dearest_s : price of the cheapest and the dearest view [s]
    """

    grips: IntArray
    rows: tuple[Table, ...]
    view_ids: tuple[IntArray, ...]
    unit_prices: tuple[Table, ...]
    prices_s: tuple[NDArray[np.float64], ...]
    covered: BoolArray
    kinds: IntArray
    least_s: float
    dearest_s: float

    @property
    def element_count(self) -> int:
        """Return how many elements are left."""
        return self.covered.shape[1]

    def views_floor_s(self, units: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what views cost at least [s] if their unit prices sum to at least `units`."""
        whole = np.ceil(np.maximum(units, 0.0) - 1e-6)  # no unit price exceeds 1: as many views
        floor: NDArray[np.float64] = np.maximum(units * self.dearest_s, whole * self.least_s)
        return np.maximum(floor, 0.0)


def make_tables(problem: Problem, max_grips: int) -> Tables:
    """Reduce the problem to its live grips and to the views and elements that matter."""
    grips = live_grips(problem, max_grips)
    needed = np.flatnonzero(needed_of(problem, max_grips))
    parts, ids = [], []
    for g in grips:
        table = problem.shows[g][:, needed]
        keep = np.flatnonzero(np.isfinite(problem.view_s[g]) & table.any(axis=1))
        parts.append(table[keep])
        ids.append(keep)
    if len(needed):
        elements = _hardest(_unique_rows(parts))
        parts = [p[:, elements] for p in parts]
    rows, view_ids, prices_s = [], [], []
    for g, table, keep in zip(grips, parts, ids, strict=True):
        prices = problem.view_s[g][keep]
        best = _undominated(table, prices)
        rows.append(table[best].astype(np.float32))
        view_ids.append(keep[best])
        prices_s.append(prices[best])
    every = np.concatenate([*prices_s, np.zeros(0)])
    least, dearest = (float(every.min()), float(every.max())) if len(every) else (0.0, 0.0)
    scale = dearest if dearest > 0.0 else 1.0
    unit = [(np.floor(p / scale * PRICE_STEPS) / PRICE_STEPS).astype(np.float32) for p in prices_s]
    kinds: dict[bytes, int] = {}
    kind = [
        kinds.setdefault(np.packbits(r > 0).tobytes() + p.tobytes() + bytes([len(p) % 256]), k)
        for k, (r, p) in enumerate(zip(rows, prices_s, strict=True))
    ]
    return Tables(
        grips=grips,
        rows=tuple(rows),
        view_ids=tuple(view_ids),
        unit_prices=tuple(unit),
        prices_s=tuple(prices_s),
        covered=np.array([r.any(axis=0) for r in rows]).reshape(len(grips), -1).astype(bool),
        kinds=np.array(kind, dtype=np.intp),
        least_s=least,
        dearest_s=dearest,
    )


def _unique_rows(parts: list[BoolArray]) -> BoolArray:
    """Return the rows of all tables, each once."""
    first: dict[bytes, tuple[int, int]] = {}
    for k, table in enumerate(parts):
        for r, packed in enumerate(np.packbits(table, axis=1)):
            first.setdefault(packed.tobytes(), (k, r))
    chosen: list[list[int]] = [[] for _ in parts]
    for k, r in first.values():
        chosen[k].append(r)
    return np.concatenate([table[r] for table, r in zip(parts, chosen, strict=True)])


def _hardest(rows: BoolArray) -> IntArray:
    """Return the elements (columns) that imply all others: cover these and all is covered."""
    order: dict[bytes, int] = {}
    for k, column in enumerate(np.packbits(rows.T, axis=1)):
        order.setdefault(column.tobytes(), k)
    unique = np.array(list(order.values()), dtype=np.intp)
    rows = rows[:, unique]
    count = rows.sum(axis=0)
    packed = np.packbits(rows, axis=1)
    shown_by = np.ascontiguousarray(rows.T)
    alive = np.ones(len(unique), dtype=bool)
    for j in np.argsort(count, kind="stable"):
        if not alive[j]:
            continue
        views = np.flatnonzero(shown_by[j])
        # views far apart in the list have least in common: few of them settle most
        views = views[
            np.argsort(np.arange(len(views)) % max(1, len(views) // _CHUNK), kind="stable")
        ]
        common = np.packbits(alive)
        for at in range(0, len(views), _CHUNK):
            common = common & np.bitwise_and.reduce(packed[views[at : at + _CHUNK]], axis=0)
            if int(np.bitwise_count(common).sum()) == 1:
                break
        else:
            implied = np.unpackbits(common, count=len(unique)).astype(bool)
            implied[j] = False
            alive &= ~implied
    return unique[alive]


def _undominated(table: BoolArray, prices: NDArray[np.float64]) -> IntArray:
    """Return the views that no other one of the same grip outdoes, in an order of their own."""
    if not len(table):
        return np.zeros(0, dtype=np.intp)
    packed = np.packbits(table, axis=1)
    size = table.sum(axis=1)
    # big ones first, of equal ones the cheapest, then by what they show: an order that does not
    # depend on how views are numbered
    order = np.lexsort((np.arange(len(table)), *packed.T[::-1], prices, -size))
    bits = table[order].astype(np.float32)
    common = bits @ bits.T
    inside = common >= size[order][:, None]  # row is within column
    better = inside & (prices[order][None] <= prices[order][:, None])
    earlier = np.arange(len(order))[None] < np.arange(len(order))[:, None]
    equal = inside & inside.T & (prices[order][None] == prices[order][:, None])
    dominated = (better & (~equal | earlier)).copy()
    np.fill_diagonal(dominated, False)
    return order[~dominated.any(axis=1)]
