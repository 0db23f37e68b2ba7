"""Tables of the problem, and the few elements that decide: their covers show the rest too.

Of thousands of surface samples some hundreds are hard to show. A lower bound for showing these is
one for showing all, and views chosen for these mostly show all; otherwise the missing elements are
added.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controller.arrays import BoolArray, Float32Array, FloatArray, IndexArray

from ._problem import Problem, live_grasps

COST_STEPS = 1024.0  # costs in units of the dearest, rounded down: sums of them stay exact
MAX_CORE_ELEMENTS = 640
_LEARN_ROUNDS = 4
_LEARN_PICKS = 10


@dataclass(frozen=True, slots=True, eq=False)
class Tables:
    """The parts of a problem that matter: live grasps, available views, needed elements.

    Attributes
    ----------
    grasps : (n,) the live grasps, as the problem numbers them; below they are 0..n-1
    elements : (m,) the elements needed, as the problem numbers them; below they are 0..m-1
    rows : per grasp (v, m) what its views show
    view_ids : per grasp (v,) which views these are
    costs_s : per grasp (v,) cost [s]
    units : per grasp (v,) cost over the dearest view's, rounded down to 1/1024
    covered : (n, m) coverage of each grasp by any view
    kinds : (n,) grasps of one kind have equal rows and costs
    least_s, dearest_s : cost of the cheapest and the dearest view [s]
    """

    grasps: IndexArray
    elements: IndexArray
    rows: tuple[BoolArray, ...]
    view_ids: tuple[IndexArray, ...]
    costs_s: tuple[FloatArray, ...]
    units: tuple[Float32Array, ...]
    covered: BoolArray
    kinds: IndexArray
    least_s: float
    dearest_s: float

    def views_bound_s(self, units: FloatArray) -> FloatArray:
        """Return the lowest cost of views [s] with unit costs of at least `units` in sum."""
        whole = np.ceil(np.maximum(units, 0.0) - 1e-6)  # no unit cost exceeds 1: as many views
        return np.maximum(np.maximum(units, 0.0) * self.dearest_s, whole * self.least_s)


@dataclass(frozen=True, slots=True, eq=False)
class Core:
    """The tables of a few elements, with only the undominated views of each grasp.

    Attributes
    ----------
    elements : (c,) elements of the tables' elements
    rows : per grasp (v, c) 0/1
    units : per grasp (v,)
    """

    elements: IndexArray
    rows: tuple[Float32Array, ...]
    units: tuple[Float32Array, ...]


def make_tables(problem: Problem, max_grasps: int) -> Tables:
    """Return the part of the problem that sequences of grasps from start to finish can use."""
    grasps = live_grasps(problem, max_grasps)
    possible = [np.isfinite(problem.view_s[g]) for g in grasps]
    shown = np.zeros((len(grasps), len(problem.weights)), dtype=bool)
    for k, (g, can) in enumerate(zip(grasps, possible, strict=True)):
        shown[k] = (problem.shows[g] if can.all() else problem.shows[g][can]).any(axis=0)
    elements = np.flatnonzero(shown.any(axis=0) & ~problem.seen)
    every = len(elements) == len(problem.weights)
    rows, view_ids, costs_s = [], [], []
    for g, can in zip(grasps, possible, strict=True):
        keep = np.flatnonzero(can)
        table = problem.shows[g] if can.all() else problem.shows[g][keep]
        rows.append(table if every else table[:, elements])
        view_ids.append(keep)
        costs_s.append(problem.view_s[g][keep])
    costs = np.concatenate([*costs_s, np.zeros(0)])
    least, dearest = (float(costs.min()), float(costs.max())) if len(costs) else (0.0, 0.0)
    scale = dearest if dearest > 0.0 else 1.0
    kinds: dict[tuple[bytes, bytes], int] = {}
    kind = [
        kinds.setdefault((np.packbits(r).tobytes(), p.tobytes()), k)
        for k, (r, p) in enumerate(zip(rows, costs_s, strict=True))
    ]
    return Tables(
        grasps=grasps,
        elements=elements,
        rows=tuple(rows),
        view_ids=tuple(view_ids),
        costs_s=tuple(costs_s),
        units=tuple(
            (np.floor(p / scale * COST_STEPS) / COST_STEPS).astype(np.float32) for p in costs_s
        ),
        covered=shown[:, elements],
        kinds=np.array(kind, dtype=np.intp),
        least_s=least,
        dearest_s=dearest,
    )


def hard_elements(rows: BoolArray, missing: BoolArray, most: int) -> list[int]:
    """Return some of the missing elements that few rows show; none implies another.

    Any element shown by every row that shows one of them is implied.

    Parameters
    ----------
    rows : (v, m) mask of the elements that each row shows
    missing : (m,)
    most : at most so many
    """
    at = np.flatnonzero(missing)
    table = rows[:, at]
    count = table.sum(axis=0)
    open_ = count > 0
    picked: list[int] = []
    while open_.any() and len(picked) < most:
        k = int(np.argmin(np.where(open_, count, len(rows) + 1)))
        picked.append(int(at[k]))
        open_ &= ~table[table[:, k]].all(axis=0)
    return picked


def learn_core(tables: Tables, sets: Sequence[IndexArray]) -> list[int]:
    """Return the deciding elements: sets of grasps that cover these cover all elements."""
    core: list[int] = []
    for members in sets:
        rows = np.concatenate([tables.rows[g] for g in members])
        costs = np.concatenate([tables.costs_s[g] for g in members])
        if not len(rows):
            continue
        can: BoolArray = np.asarray(rows.any(axis=0))
        for _ in range(_LEARN_ROUNDS):
            at = [e for e in core if can[e]]
            chosen = quick_cover(rows[:, at].astype(np.float32), costs)
            missing = can & ~np.asarray(rows[chosen].any(axis=0))
            if not missing.any() or len(core) >= MAX_CORE_ELEMENTS:
                break
            core += hard_elements(rows, missing, _LEARN_PICKS)
    return core


def make_core(tables: Tables, elements: Sequence[int]) -> Core:
    """Return the tables of these elements only."""
    at = np.array(sorted(elements), dtype=np.intp)
    rows, units = [], []
    for table, costs in zip(tables.rows, tables.units, strict=True):
        part = np.ascontiguousarray(table[:, at])
        best = _undominated(part, costs)
        rows.append(part[best].astype(np.float32))
        units.append(costs[best])
    return Core(elements=at, rows=tuple(rows), units=tuple(units))


def quick_cover(
    rows: Float32Array, costs_s: FloatArray, worth: Float32Array | None = None
) -> IndexArray:
    """Return rows that show every element: best for their cost first, none redundant.

    Parameters
    ----------
    rows : (v, m) 0/1, each element shown by some
    costs_s : (v,) costs of each row
    worth : (m,) > 0 what each element counts, None for all alike

    Raises
    ------
    ValueError : an element is shown by no row
    """
    open_ = np.ones(rows.shape[1], dtype=np.float32) if worth is None else worth.copy()
    cost = np.maximum(costs_s, 1e-9)
    chosen: list[int] = []
    while open_.any():
        gain = rows @ open_
        k = int(np.argmax(gain / cost))
        if gain[k] <= 0.0:
            raise ValueError("an element is shown by no view")
        chosen.append(k)
        open_[rows[k] > 0] = 0.0
    count = rows[chosen].sum(axis=0)
    for k in sorted(chosen, key=lambda k: (-costs_s[k], rows[k].sum(), k)):
        if (count[rows[k] > 0] >= 2).all():
            chosen.remove(k)
            count -= rows[k]
    return np.array(chosen, dtype=np.intp)


def _undominated(table: BoolArray, costs: Float32Array) -> IndexArray:
    """Return the views that no other view of the same grasp dominates at equal or lower cost."""
    unique: dict[bytes, int] = {}
    size = table.sum(axis=1)
    packed = np.packbits(table, axis=1)
    for k in np.lexsort((costs, -size)):  # of equal ones the cheapest
        if size[k] > 0:
            unique.setdefault(packed[k].tobytes(), int(k))
    at = np.array(list(unique.values()), dtype=np.intp)
    bits = table[at].astype(np.float32)
    inside = (bits @ bits.T) >= size[at][:, None]  # row is within column
    dominated = inside & (costs[at][None] <= costs[at][:, None])
    np.fill_diagonal(dominated, False)
    best: IndexArray = at[~dominated.any(axis=1)]
    return best
