"""Lower bounds on the cost of showing everything under a set of grasps, without a cover.

Costs u >= 0 put on elements give, for any views, the lower bound ``sum(u) + sum over views of
min(0, cost - u of what the view shows)`` (Lagrange). It is a sum over grasps, so one u bounds all
sets of grasps at once; and u can be improved for many sets together by subgradient steps, which are
matrix products. u is kept to multiples of 2**-14: then float32 sums are exact in whatever order
they are done, and the same problem gives the same bytes on every machine.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from controller.arrays import Float32Array, FloatArray, IndexArray

from ._tables import Core

_LP_ROUNDS = 12
_LP_GROW = 120
_SCALES = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5)
_LOOK = 16  # turns between checks of the progress
_LEAN = 4.0  # step of fractions relative to that of costs, which have few and large values
_U_STEPS = np.float32(1 << 14)  # costs on elements are multiples of this part of a unit
_X_STEPS = np.float32(1 << 12)
# What is multiplied here is finite and below 2**20. OpenBLAS 0.3.31 raised the flag of an invalid
# operation all the same, once, for a product of (1, 5) by (5, 3): lanes of a register that no
# result is read from hold what was there before (numpy issues 13173, 24067).
_FLAGS_OF_UNUSED_LANES = np.errstate(invalid="ignore")


@dataclass(frozen=True, slots=True, eq=False)
class LowerBounds:
    """Costs on elements, and the lower bounds that they give for each grasp.

    Attributes
    ----------
    u : (k, m) costs
    sums : (k,) their sums
    below : (k, n) reduction of the sum by each grasp's views, <= 0
    """

    u: Float32Array
    sums: FloatArray
    below: FloatArray

    def of_sets(self, sets: IndexArray) -> FloatArray:
        """Return the lower bound of views in units for each set (s, w), padded with n."""
        below = np.concatenate([self.below, np.zeros((len(self.sums), 1))], axis=1)
        best = np.zeros(len(sets))
        for total, row in zip(self.sums, below, strict=True):
            value = np.full(len(sets), total)
            for k in range(sets.shape[1]):
                value += row[sets[:, k]]
            np.maximum(best, value, out=best)
        return best


def rounded(u: NDArray[np.floating]) -> Float32Array:
    """Return costs rounded to multiples whose sums are exact."""
    whole: Float32Array = (np.floor(u * _U_STEPS) / _U_STEPS).astype(np.float32)
    return whole


@_FLAGS_OF_UNUSED_LANES
def lower_bounds(core: Core, u: Float32Array) -> LowerBounds:
    """Return the lower bounds that costs of elements (k, m) give, grasp by grasp."""
    below = np.zeros((len(u), len(core.rows)))
    for g, (rows, costs) in enumerate(zip(core.rows, core.units, strict=True)):
        left = costs[None] - u @ rows.T
        below[:, g] = np.minimum(left, 0.0).sum(axis=1, dtype=np.float64)
    return LowerBounds(u=u, sums=u.sum(axis=1, dtype=np.float64), below=below)


def union_costs(core: Core) -> tuple[Float32Array, float]:
    """Return costs of elements for which fractions of views, of any grasps, cost least.

    Returns
    -------
    u : (m,) costs; a lower bound on the units that any cover by any grasps costs
    """
    m = len(core.elements)
    if m == 0:
        return np.zeros(0, dtype=np.float32), 0.0
    rows = np.concatenate(core.rows)
    costs = np.concatenate(core.units).astype(np.float64)
    worth = rows.sum(axis=1) / np.maximum(costs, 1e-3)
    active = np.zeros(len(rows), dtype=bool)
    uncovered = np.ones(m, dtype=bool)
    while uncovered.any():  # a first cover, so that the problem has a solution
        v = int(np.argmax((rows @ uncovered.astype(np.float32)) / np.maximum(costs, 1e-3)))
        active[v] = True
        uncovered &= rows[v] == 0
    active[np.argsort(-worth, kind="stable")[:_LP_GROW]] = True
    best_u, best = np.zeros(m, dtype=np.float32), 0.0
    for _ in range(_LP_ROUNDS):
        answer = linprog(
            -np.ones(m),
            A_ub=rows[active],
            b_ub=costs[active],
            bounds=(0, None),
            method="highs",
        )
        if answer.x is None:
            break
        u = np.maximum(answer.x, 0.0)
        load = rows @ u.astype(np.float32)
        worst = float((load / np.maximum(costs, 1e-9)).max())
        fair = rounded(u / max(1.0, worst))
        value = float(fair.sum(dtype=np.float64))
        slack = np.minimum(costs - rows @ fair, 0.0).sum()
        if value + slack > best:
            best_u, best = fair, value + float(slack)
        over = load - costs
        over[active] = 0.0
        if over.max() <= 1e-4 or best >= u.sum() * 0.999:
            break
        new = np.argsort(-over, kind="stable")[:_LP_GROW]
        active[new[over[new] > 1e-6]] = True
    return best_u, best


def spread_scales(u: Float32Array, factor: float) -> Float32Array:
    """Return the costs (m,) scaled up in steps: costs for all grasps are too low for a few."""
    return rounded(np.stack([u * np.float32(factor * s) for s in _SCALES] + [u]))


@_FLAGS_OF_UNUSED_LANES
def raise_lower_bounds(
    core: Core, sets: IndexArray, u: Float32Array, goals: FloatArray, steps: int
) -> tuple[FloatArray, Float32Array]:
    """Return better lower bounds for many sets of grasps at once, and the costs that give them.

    The cover by fractions of views is a saddle point of the Lagrangian; costs and fractions move
    towards it by turns (primal-dual hybrid gradient with a step per row and column, restarted at
    the average), which comes within a hundredth in a hundred turns where subgradients crawl.

    Parameters
    ----------
    core : the elements that matter, and the views that show them
    sets : (s, w) grasps, padded with n
    u : (m,) costs to start from
    goals : (s,) a lower bound of so many units is enough
    steps : largest number

    Returns
    -------
    lower bounds (s,) in units; u : (s, m) the costs that give them
    """
    saddle = _Saddle(core, sets, np.repeat(rounded(u)[None], len(sets), axis=0))
    best, best_u = saddle.values(saddle.u), saddle.u.copy()
    active = np.flatnonzero(best < goals)
    for _ in range(0, steps, _LOOK):
        if not len(active):
            break
        mean = saddle.turn(active, _LOOK)
        here, averaged = saddle.values(saddle.u, active), saddle.values(mean, active)
        for value, costs in ((averaged, mean), (here, saddle.u)):
            better = active[value[active] > best[active]]
            best[better] = value[better]
            best_u[better] = costs[better]
        jump = active[averaged[active] >= here[active]]
        saddle.u[jump] = mean[jump]
        active = active[best[active] < goals[active]]
    return np.maximum(best, 0.0), best_u


class _Saddle:
    """Costs u on elements and fractions x of views for many sets of grasps, padded per grasp."""

    def __init__(self, core: Core, sets: IndexArray, u: Float32Array) -> None:
        self._core, self._sets, self.u = core, sets, u
        n, widest = len(core.rows), max((len(r) for r in core.rows), default=0)
        self._x = np.zeros((*sets.shape, widest), dtype=np.float32)
        height = np.zeros((n + 1, u.shape[1]), dtype=np.float32)
        self._step_size: list[Float32Array] = []
        for g, rows in enumerate(core.rows):
            height[g] = rows.sum(axis=0)
            self._step_size.append(np.float32(_LEAN) / np.maximum(rows.sum(axis=1), 1.0))
        total = height[sets].sum(axis=1)
        self._climb = (1.0 / (np.float32(_LEAN) * np.maximum(total, 1.0))).astype(np.float32)

    def _members(self, active: IndexArray) -> list[tuple[int, IndexArray, IndexArray]]:
        here = self._sets[active]
        found = []
        for g in np.unique(here[here < len(self._core.rows)]):
            at, slot = np.nonzero(here == g)
            found.append((int(g), active[at], slot))
        return found

    def values(self, u: Float32Array, active: IndexArray | None = None) -> FloatArray:
        """Return the lower bounds (s,) that costs (s, m) give, for the active sets."""
        active = np.arange(len(u)) if active is None else active
        value = np.zeros(len(u))
        value[active] = u[active].sum(axis=1, dtype=np.float64)
        for g, at, _ in self._members(active):
            left = self._core.units[g][None] - u[at] @ self._core.rows[g].T
            value[at] += np.minimum(left, 0.0).sum(axis=1, dtype=np.float64)
        return value

    def turn(self, active: IndexArray, count: int) -> Float32Array:
        """Move costs and fractions a number of times; return the mean costs (s, m)."""
        members = self._members(active)
        total = np.zeros_like(self.u)
        for _ in range(count):
            lack = np.ones_like(self.u)
            for g, at, slot in members:
                rows = self._core.rows[g]
                left = self._core.units[g][None] - self.u[at] @ rows.T
                old = self._x[at, slot, : len(rows)]
                moved = np.clip(old - self._step_size[g][None] * left, 0.0, 1.0)
                new: Float32Array = (np.round(moved * _X_STEPS) / _X_STEPS).astype(np.float32)
                lack[at] -= (2.0 * new - old) @ rows
                self._x[at, slot, : len(rows)] = new
            raised = np.maximum(self.u[active] + self._climb[active] * lack[active], 0.0)
            self.u[active] = rounded(raised)
            total[active] += self.u[active]
        return rounded(total / np.float32(count))
