"""The cheapest grasps and views that show everything possible, with proof: branch and bound.

Sequences of grasps are listed cheapest first, one grasp longer at a time, as long as they could
still lead to something better than the best known. Each *set* of grasps that shows everything gets
a lower bound of what the views cost that it needs: first from costs good for all sets at once, then
from costs of its own, last the exact cover. The set of the least lower bound is always next, so
that the exact cover is done only where the proof needs it. planning-facts.md 1.3.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from controller.arrays import BoolArray, Float32Array, FloatArray, IndexArray

from ._bounds import LowerBounds, lower_bounds, raise_lower_bounds, spread_scales, union_costs
from ._exact import Stacked, exact_cover, stack
from ._problem import (
    SAME_S,
    Problem,
    cost_of,
)
from ._sequences import GraspSequences, first_sequences, longer, showing_all, tails
from ._tables import Core, Tables, hard_elements, learn_core, make_core, quick_cover


@dataclass(frozen=True, slots=True)
class Effort:
    """Limits on the work, as counts, so that the same problem always gets as far.

    Attributes
    ----------
    lower_bounds : sets of grasps whose lower bound may be raised
    covers : exact covers
    nodes : nodes of branch and bound within one cover
    paths : paths of equal length kept at most
    """

    lower_bounds: int = 20_000
    covers: int = 1_500
    nodes: int = 20_000
    paths: int = 40_000


COARSE = Effort(lower_bounds=256, covers=4, nodes=500, paths=4_000)
FULL = Effort()
# size of the first batch, which shows how far the floors of the others must be raised
_FIRST_BATCH = 16
_BATCH = 128
_DIVES = 6  # covers by the likeliest views only, for a good solution early
_DIVE_VIEWS = 40
_STEPS = 128
_TRIES = 6  # quick covers per batch, for an early good solution
_LESSONS = 20  # sets of grasps from which the deciding elements are learned
_MISSED = 8  # number of elements added where a cover of the core leaves some out


@dataclass(slots=True, eq=False)
class GraspSets:
    """Sets of grasps that show everything, and the progress of the search on each."""

    grasps: list[tuple[int, ...]] = field(default_factory=list)  # the cheapest sequence
    sets: list[IndexArray] = field(default_factory=list)
    path_s: list[float] = field(default_factory=list)
    bound_s: list[float] = field(default_factory=list)  # bound of the whole
    units: list[float] = field(default_factory=list)
    stage: list[int] = field(default_factory=list)
    u: dict[int, Float32Array] = field(default_factory=dict)
    at: dict[tuple[int, ...], int] = field(default_factory=dict)


class GraspSearch:
    """One run; `best` is the best solution so far, in the problem's numbering.

    Parameters
    ----------
    problem : costs and coverage of the problem
    tables : tables of `make_tables` for that problem and ``max_grasps``
    max_grasps : at most so many in a row, transit included
    effort : limits at which the search stops
    """

    def __init__(self, problem: Problem, tables: Tables, max_grasps: int, effort: Effort) -> None:
        self.problem, self.tables = problem, tables
        self.max_grasps, self.effort = max_grasps, effort
        self.core: Core
        self.union: LowerBounds
        self.best: tuple[tuple[int, ...], tuple[tuple[int, ...], ...], float] | None = None
        self.best_s = np.inf
        self.covers = self.floored = self.dives = 0
        self.pool = GraspSets()
        self.levels: list[GraspSequences] = []
        self.all_s = 0.0  # what views cost at least, whatever the grasps
        self.extra: list[int] = []  # elements that covers of the core left out

    def offer(self, grasps: tuple[int, ...], views: tuple[tuple[int, ...], ...]) -> None:
        """Keep a solution if it is cheaper than the best."""
        cost = cost_of(self.problem, grasps, views)
        if cost < self.best_s - SAME_S:
            self.best, self.best_s = (tuple(grasps), views, cost), cost

    def run(self) -> float:
        """Search; return the lower bound of all solutions."""
        tables, problem = self.tables, self.problem
        regrasp = problem.regrasp_s[np.ix_(tables.grasps, tables.grasps)]
        tail = tails(problem, tables.grasps, self.max_grasps)
        sequences = first_sequences(problem, tables.grasps)
        self._learn(sequences, regrasp, tail)
        open_s = np.inf  # lower bound of all that was not looked into
        for length in range(1, self.max_grasps + 1):
            self.levels.append(sequences)
            self._enter(sequences)
            self._settle()
            if length == self.max_grasps or not len(sequences.grasps):
                break
            sequences = longer(
                sequences,
                regrasp,
                tail,
                self.best_s - self.all_s,
                self.levels,
                self.effort.paths,
                tables.covered if self.best is None else None,
            )
            open_s = min(open_s, sequences.left_out_s + self.all_s)
        pending = [f for f, s in zip(self.pool.bound_s, self.pool.stage, strict=True) if s != 2]
        return min([self.best_s, open_s, *pending])

    def _learn(self, sequences: GraspSequences, regrasp: FloatArray, tail: FloatArray) -> None:
        """Find the deciding elements from the cheapest sequences, and costs for all grasps."""
        tables, n = self.tables, len(self.tables.grasps)
        pairs = longer(sequences, regrasp, tail, np.inf, [sequences], self.effort.paths)
        some: list[IndexArray] = []
        for paths in (pairs, sequences):
            whole = paths.cost_s + tail[paths.grasps[:, -1]]
            bits = np.concatenate([tables.covered, np.zeros((1, tables.covered.shape[1]), bool)])
            table = bits.astype(np.float32)
            size, common = table.sum(axis=1), table @ table.T
            one, two = paths.sets[:, 0], paths.sets[:, -1]
            shown = np.where(one == two, size[one], size[one] + size[two] - common[one, two])
            rank = np.lexsort((whole, -shown))[:_LESSONS]
            some += [paths.sets[k][paths.sets[k] < n] for k in rank]
        elements = learn_core(tables, some)
        if not elements and len(tables.elements):
            elements = [0]
        self.core = make_core(tables, elements)
        u, units = union_costs(self.core)
        self.union = lower_bounds(self.core, spread_scales(u, 2.0))
        self.all_s = float(tables.views_bound_s(np.array([units]))[0])

    def most_shown(self) -> tuple[tuple[int, ...], BoolArray]:
        """Return the grasps in order that show the most surface, and the elements they show (m,).

        Raises
        ------
        AssertionError : no sequence of live grasps was found, which only a defect of the search
            allows
        """
        problem, grasps = self.problem, self.tables.grasps
        worth = problem.weights + 1.0 / (1 << 20)  # what weighs nothing is shown all the same
        per_grasp = np.array(
            [
                problem.shows[g][np.isfinite(problem.view_s[g])].any(axis=0) & ~problem.seen
                for g in grasps
            ]
        )
        best: tuple[float, IndexArray, BoolArray] | None = None
        for sequences in self.levels:
            ends = np.isfinite(problem.last_s[grasps[sequences.grasps[:, -1]]])
            for k in np.flatnonzero(ends):
                union = per_grasp[sequences.grasps[k]].any(axis=0)
                value = float(worth @ union)
                if best is None or value > best[0] + 1e-12:
                    best = value, sequences.grasps[k], union
        if best is None:
            raise AssertionError("live grasps, but no path through them")
        return tuple(int(grasps[g]) for g in best[1]), best[2]

    def _enter(self, sequences: GraspSequences) -> None:
        """Add the sets of sequences that show all, can be finished and could be best."""
        tables, pool = self.tables, self.pool
        whole = sequences.cost_s + self.problem.last_s[tables.grasps[sequences.grasps[:, -1]]]
        at = np.flatnonzero(whole < self.best_s - SAME_S)
        at = at[showing_all(tables.covered, sequences.sets[at])]
        if not len(at):
            return
        units = self.union.of_sets(sequences.sets[at])
        total = whole[at] + tables.views_bound_s(units)
        good = total < self.best_s - SAME_S
        at, units, total = at[good], units[good], total[good]
        for k in np.argsort(whole[at], kind="stable"):
            path, n = at[k], len(tables.grasps)
            members = sequences.sets[path][sequences.sets[path] < n]
            kinds, first = np.unique(tables.kinds[members], return_index=True)
            key = tuple(int(x) for x in kinds)
            known = pool.at.get(key)
            if known is not None and pool.path_s[known] <= whole[path] + SAME_S:
                continue
            entry = (tuple(int(g) for g in sequences.grasps[path]), np.sort(members[first]))
            if known is None:
                pool.at[key] = len(pool.grasps)
                pool.grasps.append(entry[0])
                pool.sets.append(entry[1])
                pool.path_s.append(float(whole[path]))
                pool.bound_s.append(float(total[k]))
                pool.units.append(float(units[k]))
                pool.stage.append(0)
            else:  # the same views, had more cheaply by a longer sequence
                saved = pool.path_s[known] - float(whole[path])
                pool.grasps[known], pool.sets[known] = entry
                pool.path_s[known] -= saved
                pool.bound_s[known] -= saved
                pool.stage[known] = min(pool.stage[known], 1 if known in pool.u else 0)

    def _settle(self) -> None:
        """Search sets, the least lower bound first, until none can be better or effort ends."""
        pool = self.pool
        while True:
            bounds = np.array(pool.bound_s)
            stage = np.array(pool.stage, dtype=int)
            pending = np.flatnonzero((bounds < self.best_s - SAME_S) & (stage < 2))
            if not len(pending):
                return
            order = pending[np.argsort(bounds[pending], kind="stable")]
            if stage[order[0]] == 0:
                if self.floored >= self.effort.lower_bounds and self.best is not None:
                    return
                batch = _BATCH if self.floored else _FIRST_BATCH
                self._raise([int(k) for k in order[stage[order] == 0][:batch]])
            else:
                if self.covers >= self.effort.covers:
                    return
                self._cover(int(order[0]))

    def _raise(self, which: list[int]) -> None:
        tables, pool = self.tables, self.pool
        n = len(tables.grasps)
        width = max(len(pool.sets[k]) for k in which)
        sets = np.full((len(which), width), n)
        for row, k in enumerate(which):
            sets[row, : len(pool.sets[k])] = pool.sets[k]
        path = np.array([pool.path_s[k] for k in which])
        start = self.union.u[-1]
        if not np.isfinite(self.best_s):
            for row in range(min(_TRIES, len(which))):
                self._try(which[row], start)
        units, u = raise_lower_bounds(self.core, sets, start, self._goals(path), _STEPS)
        bounds = path + tables.views_bound_s(units)
        self.floored += len(which)
        for row, k in enumerate(which):
            pool.stage[k] = 1
            pool.u[k] = u[row]
            pool.units[k] = max(pool.units[k], float(units[row]))
            pool.bound_s[k] = max(pool.bound_s[k], float(bounds[row]))
        lowest = sorted(which, key=lambda k: (pool.bound_s[k], k))[:_TRIES]
        for k in lowest:
            if pool.bound_s[k] < self.best_s - SAME_S:
                self._try(k, pool.u[k])
                if self.dives < _DIVES:
                    self._dive(k)

    def _goals(self, path_s: FloatArray) -> FloatArray:
        """Return the lower bound in units that would rule out each set."""
        tables = self.tables
        if not np.isfinite(self.best_s) or tables.dearest_s <= 0.0:
            return np.full(len(path_s), np.inf if tables.dearest_s > 0.0 else 0.0)
        room = self.best_s - SAME_S - path_s
        goal: FloatArray = room / tables.dearest_s
        if tables.least_s > 0.0:  # so many views fit, one more does not
            goal = np.minimum(goal, np.ceil(room / tables.least_s) - 1.0)
        return goal + 0.002

    def _try(self, k: int, u: Float32Array) -> None:
        """Cover the set quickly, by costs and by numbers."""
        stacked = stack(self.tables, self.pool.sets[k])
        rows = stacked.rows.astype(np.float32)
        worth = np.full(rows.shape[1], 1.0 / 64.0, dtype=np.float32)
        worth[self.core.elements] += u
        for costs in (worth, None):
            chosen = quick_cover(rows, stacked.costs_s, costs)
            self._offer_rows(k, stacked.owner[chosen], stacked.index[chosen])

    def _dive(self, k: int) -> None:
        """Cover the set by its most promising views."""
        self.dives += 1
        stacked = stack(self.tables, self.pool.sets[k])
        core = self.core.elements
        left = stacked.units - stacked.rows[:, core].astype(np.float32) @ self.pool.u[k]
        quick = quick_cover(stacked.rows.astype(np.float32), stacked.costs_s)
        some = np.union1d(np.argsort(left, kind="stable")[:_DIVE_VIEWS], quick)
        limit = self.best_s - self.pool.path_s[k]
        rows, _ = exact_cover(
            stacked.rows[np.ix_(some, core)], stacked.costs_s[some], limit, nodes=self.effort.nodes
        )
        if rows is not None:
            self._offer_completed(k, stacked, some[rows])

    def _offer_completed(self, k: int, stacked: Stacked, rows: IndexArray) -> BoolArray:
        """Offer these views with their completion; return the elements they leave out (m,)."""
        missing: BoolArray = ~np.asarray(stacked.rows[rows].any(axis=0))
        if missing.any():
            rest = quick_cover(stacked.rows[:, missing].astype(np.float32), stacked.costs_s)
            rows = np.union1d(rows, rest)
        self._offer_rows(k, stacked.owner[rows], stacked.index[rows])
        return missing

    def _cover(self, k: int) -> None:
        """Settle the set by an exact cover."""
        tables, pool = self.tables, self.pool
        stacked = stack(tables, pool.sets[k])
        u = pool.u[k]
        left = stacked.units - stacked.rows[:, self.core.elements].astype(np.float32) @ u
        base = float(u.sum(dtype=np.float64)) + float(np.minimum(left, 0.0).sum(dtype=np.float64))
        reduced = tables.views_bound_s(base + np.maximum(left, 0.0).astype(np.float64))
        elements = sorted({*self.core.elements.tolist(), *self.extra})
        while True:
            limit = self.best_s - pool.path_s[k]
            if not np.isfinite(limit):
                limit = float(stacked.costs_s.sum()) + 1.0
            rows, views_s = exact_cover(
                stacked.rows[:, elements], stacked.costs_s, limit, reduced, self.effort.nodes
            )
            self.covers += 1
            if rows is None:
                break
            missing = self._offer_completed(k, stacked, rows)
            if not missing.any():
                break
            new = hard_elements(stacked.rows, missing, _MISSED)
            self.extra += new
            elements = sorted({*elements, *new})
        pool.stage[k] = 2
        pool.bound_s[k] = max(pool.bound_s[k], pool.path_s[k] + views_s)
        if pool.bound_s[k] < self.best_s - SAME_S:
            pool.stage[k] = 3  # nodes ran out: its lower bound stands

    def _offer_rows(self, k: int, owner: IndexArray, index: IndexArray) -> None:
        """Offer views of the set's grasps as a solution."""
        tables, grasps = self.tables, self.pool.grasps[k]
        kind_of = tables.kinds
        views: list[tuple[int, ...]] = []
        used: list[int] = []
        for g in grasps:
            kind = int(kind_of[g])
            mine = [] if kind in used else index[kind_of[owner] == kind]
            used.append(kind)
            views.append(
                tuple(sorted(int(v) for v in tables.view_ids[g][mine])) if len(mine) else ()
            )
        self.offer(tuple(int(tables.grasps[g]) for g in grasps), tuple(views))
