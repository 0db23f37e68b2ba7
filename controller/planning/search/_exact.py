"""The cheapest views that show everything under one set of grasps, exactly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, linprog, milp
from scipy.sparse import csr_array

from controller.arrays import BoolArray, Float32Array, FloatArray, IndexArray

from ._problem import SAME_S
from ._tables import Tables

MILP_NODES = 20_000
TREE_NODES = 400  # nodes of the own tree; most covers need fewer than fifty
INTEGRAL = 1e-6  # a fraction this near to one is a whole view
ROUNDING = 1e-6  # error of a sum of worths, as a share of a view
OPTIMAL, INFEASIBLE = 0, 2  # of scipy's answers


@dataclass(frozen=True, slots=True, eq=False)
class Stacked:
    """The views of a set of grasps in one table.

    Attributes
    ----------
    rows : (v, m)
    costs_s : (v,)
    units : (v,)
    owner : (v,) grasp
    index : (v,) row of the grasp's own table
    """

    rows: BoolArray
    costs_s: FloatArray
    units: Float32Array
    owner: IndexArray
    index: IndexArray


def stack(tables: Tables, grasps: IndexArray) -> Stacked:
    """Return the tables of some grasps as one, each under the one before."""
    sizes = [len(tables.rows[g]) for g in grasps]
    return Stacked(
        rows=np.concatenate([tables.rows[g] for g in grasps]),
        costs_s=np.concatenate([tables.costs_s[g] for g in grasps]),
        units=np.concatenate([tables.units[g] for g in grasps]),
        owner=np.repeat(np.asarray(grasps, dtype=np.intp), sizes),
        index=np.concatenate([np.arange(s) for s in sizes]).astype(np.intp),
    )


def exact_cover(
    rows: BoolArray,
    costs_s: FloatArray,
    limit_s: float,
    reduced_s: FloatArray | None = None,
    nodes: int = MILP_NODES,
    tree_nodes: int = TREE_NODES,
) -> tuple[IndexArray | None, float]:
    """Return the cheapest rows that show every element for less than a limit.

    Parameters
    ----------
    rows : (v, m) mask of the elements that each row shows
    costs_s : (v,) costs of each row
    limit_s : only what is cheaper counts
    reduced_s : (v,) lower bound of every cover that has this row, to leave rows out
    nodes : nodes of branch and bound, at most
    tree_nodes : so many of them in the own tree, which is quick with few

    Returns
    -------
    rows chosen, None if none is cheaper; lower bound [s] of all covers, `limit_s` if none is
    """
    keep = np.arange(len(rows))
    if reduced_s is not None:
        keep = keep[reduced_s < limit_s - SAME_S]
    fixed: list[int] = []
    fixed_s = 0.0
    table = rows[keep]
    open_ = _different(table)
    while True:
        before = (len(keep), int(open_.sum()))
        table, keep, open_, forced = _reduced(table, keep, open_, costs_s)
        if forced is None:
            return None, limit_s
        fixed += forced
        fixed_s = float(costs_s[fixed].sum())
        if fixed_s >= limit_s - SAME_S:
            return None, limit_s
        if (len(keep), int(open_.sum())) == before:
            break
    if not open_.any():
        return np.array(fixed, dtype=np.intp), fixed_s
    left = _Left(table[:, open_], costs_s[keep], limit_s - fixed_s)
    left.branch(min(nodes, tree_nodes))
    if not left.is_settled and nodes > tree_nodes:
        left.hand_over(nodes)
    bound_s = min(limit_s, fixed_s + max(0.0, left.bound_s))
    if left.chosen is None:
        return None, limit_s if left.is_settled else bound_s
    found = np.concatenate([np.array(fixed, dtype=np.intp), keep[left.chosen]])
    cost = float(costs_s[found].sum())
    return found, cost if left.is_settled else min(cost, bound_s)


class _Left:
    """Cover of the elements left after the forced views: branch and bound on views.

    The relaxation, in which fractions of views may be taken, is within one view of the truth on
    nearly all covers of plans; then some ten relaxations decide, where a solver of mixed integer
    programs spends a hundred times as long on cuts before it branches (ADR 10). Undecided covers
    are handed over to such a solver.

    Parameters
    ----------
    table : (v, m) mask of the elements that each row shows; each is shown by some row
    costs_s : (v,)
    limit_s : only what is cheaper counts

    Attributes
    ----------
    chosen : rows of the cheapest cover found, None while there is none
    bound_s : lower bound of all covers; no more than the limit
    is_settled : True if nothing cheaper is left than what is chosen, or than the limit
    """

    def __init__(self, table: BoolArray, costs_s: FloatArray, limit_s: float) -> None:
        self._table, self._costs_s, self._limit_s = table, costs_s, limit_s
        # a cover of views that all cost the same costs a whole number of them
        self._step_s = float(costs_s[0]) if np.ptp(costs_s) == 0.0 else 0.0
        self.chosen: IndexArray | None = None
        self.bound_s = 0.0
        self.is_settled = False

    def branch(self, nodes: int) -> None:
        """Search a number of nodes of the tree at most, those with the likeliest views first."""
        rows, columns = (np.arange(count) for count in self._table.shape)
        tree = [_Node(rows, columns, [], 0.0, 0.0)]
        for _ in range(nodes):
            if not tree:
                break
            tree += self._branches(tree.pop())
        tree = [node for node in tree if node.bound_s < self._limit_s - SAME_S]
        self.is_settled = not tree
        self.bound_s = min([self._limit_s, *(node.bound_s for node in tree)])

    def _branches(self, node: _Node) -> list[_Node]:
        """Return the branches of a node: without a view and, to be searched first, with it."""
        if node.bound_s >= self._limit_s - SAME_S:
            return []
        if not len(node.columns):
            self._keep(node.taken)
            return []
        table = self._table[np.ix_(node.rows, node.columns)]
        if not table.any(axis=0).all():
            return []
        costs = self._costs_s[node.rows]
        fractions, worth = _relaxed(table, costs)
        reduced = costs - table @ worth
        # right for any worth of the elements, however well the relaxation was solved
        least_s = node.taken_s + np.asarray(worth.sum() + np.minimum(reduced, 0.0).sum())
        bound_s = max(node.bound_s, float(self._whole(least_s)))
        if bound_s >= self._limit_s - SAME_S:
            return []
        whole = node.rows[fractions > 0.5]
        if self._table[np.ix_(whole, node.columns)].any(axis=0).all():
            self._keep([*node.taken, *whole.tolist()])
        stay = self._whole(least_s + np.maximum(reduced, 0.0)) < self._limit_s - SAME_S
        if not stay.any():
            return []
        rows, fractions = node.rows[stay], fractions[stay]
        k = int(np.argmax(np.where(fractions < 1.0 - INTEGRAL, fractions, -1.0)))
        view = int(rows[k])
        rows = np.delete(rows, k)
        open_ = ~self._table[view, node.columns]
        taken_s = node.taken_s + float(self._costs_s[view])
        return [
            _Node(rows, node.columns, node.taken, node.taken_s, bound_s),
            _Node(rows, node.columns[open_], [*node.taken, view], taken_s, bound_s),
        ]

    def _whole(self, cost_s: FloatArray) -> FloatArray:
        """Return lower bounds on a cover's cost, rounded up to whole views of equal cost."""
        if self._step_s <= 0.0:
            return cost_s
        return np.asarray(np.ceil(cost_s / self._step_s - ROUNDING) * self._step_s)

    def _keep(self, taken: Sequence[int]) -> None:
        cost_s = float(self._costs_s[list(taken)].sum())
        if cost_s < self._limit_s - SAME_S:
            self.chosen, self._limit_s = np.array(taken, dtype=np.intp), cost_s

    def hand_over(self, nodes: int) -> None:
        """Continue with a solver of mixed integer programs, over a number of nodes at most."""
        costs, limit_s = self._costs_s, self._limit_s
        constraints = [LinearConstraint(csr_array(self._table.T.astype(float)), lb=1.0)]
        # as few views as the limit leaves room for: stops where nothing cheaper is left
        room = (limit_s - SAME_S) / max(float(costs.min()), 1e-9)
        if np.isfinite(room) and room < len(costs):
            constraints.append(LinearConstraint(np.ones((1, len(costs))), ub=np.floor(room)))
            if np.ptp(costs) > 0.0:
                constraints.append(LinearConstraint(costs[None], ub=limit_s - SAME_S / 2))
        answer = milp(
            costs,
            integrality=np.ones(len(costs), dtype=np.int64),
            bounds=Bounds(0.0, 1.0),
            constraints=constraints,
            options={"mip_rel_gap": 0.0, "node_limit": nodes},
        )
        if answer.x is not None:
            found = np.flatnonzero(answer.x > 0.5)
            if not self._table[found].any(axis=0).all():  # a solver's tolerance is no cover
                return
            self._keep(found.tolist())
        if answer.status in (OPTIMAL, INFEASIBLE):
            self.is_settled, self.bound_s = True, self._limit_s
        elif answer.mip_dual_bound is not None:
            bound_s = min(self._limit_s, float(answer.mip_dual_bound))
            self.bound_s = max(self.bound_s, bound_s)


@dataclass(frozen=True, slots=True, eq=False)
class _Node:
    """A node of the tree: views taken, their cost, and the rows and columns that are left."""

    rows: IndexArray
    columns: IndexArray
    taken: list[int]
    taken_s: float
    bound_s: float


def _relaxed(table: BoolArray, costs_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the fractions of rows (v,) of the cheapest cover, and the elements' dual values.

    Raises
    ------
    AssertionError : the relaxation has no solution, though each element is shown by some row
    """
    answer = linprog(
        costs_s,
        A_ub=-table.T.astype(float),
        b_ub=-np.ones(table.shape[1]),
        bounds=(0.0, None),
        method="highs",
    )
    if answer.x is None:
        raise AssertionError(f"the relaxed cover has no solution: {answer.message}")
    return answer.x, np.maximum(-answer.ineqlin.marginals, 0.0)


def _different(table: BoolArray) -> BoolArray:
    """Mark one of all elements (columns) that are shown by the same rows."""
    first: dict[bytes, int] = {}
    for k, column in enumerate(np.packbits(table, axis=0).T):
        first.setdefault(column.tobytes(), k)
    mark = np.zeros(table.shape[1], dtype=bool)
    mark[list(first.values())] = True
    return mark


def _reduced(
    table: BoolArray, keep: IndexArray, open_: BoolArray, costs_s: FloatArray
) -> tuple[BoolArray, IndexArray, BoolArray, list[int] | None]:
    """Take forced rows, drop redundant ones; None where an element is shown by none."""
    count = table[:, open_].sum(axis=0)
    if (count == 0).any():
        return table, keep, open_, None
    open_ = open_.copy()
    single = np.flatnonzero(open_)[count == 1]
    forced_rows = np.unique(table[:, single].argmax(axis=0)) if len(single) else np.zeros(0, int)
    forced = [int(k) for k in keep[forced_rows]]
    if forced:
        open_ &= ~table[forced_rows].any(axis=0)
    # elements: i comes by itself where all rows of j show it
    cols = np.flatnonzero(open_)
    bits = table[:, cols].astype(np.float32)
    common = bits.T @ bits
    size = bits.sum(axis=0)
    implied = size[:, None] <= common.T  # [j, i]: rows of j all show i
    equal = implied & implied.T
    later = np.arange(len(cols))[:, None] > np.arange(len(cols))[None]
    implied &= ~(equal & later)
    np.fill_diagonal(implied, False)
    open_[cols[implied.any(axis=0)]] = False
    # rows: one within another that is no dearer
    cols = np.flatnonzero(open_)
    bits = table[:, cols].astype(np.float32)
    size = bits.sum(axis=1)
    inside = (bits @ bits.T) >= size[:, None]
    grasp_cost = costs_s[keep]
    no_dearer = grasp_cost[None] <= grasp_cost[:, None]
    equal = inside & inside.T & (grasp_cost[None] == grasp_cost[:, None])
    first = np.arange(len(keep))[None] < np.arange(len(keep))[:, None]
    dominated = inside & no_dearer & (~equal | first)
    np.fill_diagonal(dominated, False)
    stay = ~dominated.any(axis=1) & (size > 0)
    return table[stay], keep[stay], open_, forced
