"""The cheapest views that show everything under one set of grasps, exactly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_array

from controller.arrays import BoolArray, Float32Array, FloatArray, IndexArray

from ._problem import SAME_S
from ._tables import Tables

MILP_NODES = 20_000


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
) -> tuple[IndexArray | None, float]:
    """Return the cheapest rows that show every element for less than a limit.

    Parameters
    ----------
    rows : (v, m) which elements each row shows
    costs_s : (v,) of each row
    limit_s : only what is cheaper counts
    reduced_s : (v,) lower bound of every cover that has this row, to leave rows out
    nodes : of the branch-and-bound tree, at most

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
    costs = costs_s[keep]
    left_s = limit_s - fixed_s
    sub = csr_array(table[:, open_].T.astype(float))
    constraints = [LinearConstraint(sub, lb=1.0)]
    # as few views as the limit leaves room for: stops the search where nothing cheaper is left
    room = (left_s - SAME_S) / max(float(costs.min()), 1e-9)
    if np.isfinite(room) and room < len(costs):
        most = np.floor(room)
        constraints.append(LinearConstraint(np.ones((1, len(costs))), ub=most))
        if np.ptp(costs) > 0.0:
            constraints.append(LinearConstraint(costs[None], ub=left_s - SAME_S / 2))
    answer = milp(
        costs,
        integrality=np.ones(len(costs), dtype=np.int64),
        bounds=Bounds(0.0, 1.0),
        constraints=constraints,
        options={"mip_rel_gap": 0.0, "node_limit": nodes},
    )
    if answer.status == 2:
        return None, limit_s
    bound_s = answer.mip_dual_bound if answer.mip_dual_bound is not None else 0.0
    if answer.x is None:
        return None, min(limit_s, fixed_s + max(0.0, float(bound_s)))
    chosen = keep[answer.x > 0.5]
    cost = fixed_s + float(costs_s[chosen].sum())
    found = np.concatenate([np.array(fixed, dtype=np.intp), chosen])
    if not rows[found].any(axis=0).all():  # a solver's tolerance is no cover
        return None, fixed_s
    if answer.status == 0:
        return (found, cost) if cost < limit_s - SAME_S / 2 else (None, limit_s)
    return found, min(cost, fixed_s + float(bound_s))


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
    """Take what must be taken, drop what need not be; None where an element is shown by none."""
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
