"""What showing everything costs at least under a set of grips, without solving the cover.

Prices u >= 0 put on elements give, for any views, the floor ``sum(u) + sum over views of min(0,
price - u of what the view shows)`` (Lagrange). It is a sum over grips, so one u bounds all sets of
grips at once; and u can be improved for many sets together by subgradient steps, which are matrix
products. u is kept to multiples of 1/1024: then float32 sums are exact in whatever order they are
done, and the same problem gives the same bytes on every machine.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from ._problem import IntArray
from ._tables import PRICE_STEPS, Core, Table

FloatArray = NDArray[np.float64]
_LP_ROUNDS = 12
_LP_GROW = 120
_SCALES = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5)
_STALL = 6  # steps without progress before they are halved


@dataclass(frozen=True, slots=True, eq=False)
class Floors:
    """Prices on elements, and what they say about each grip.

    Attributes
    ----------
    u : (k, m) prices; sums : (k,) their sums
    below : (k, n) what each grip's views take off the sum, <= 0
    """

    u: Table
    sums: FloatArray
    below: FloatArray

    def of_sets(self, sets: IntArray) -> FloatArray:
        """Return the floor of views in units for each set (s, w), padded with n."""
        below = np.concatenate([self.below, np.zeros((len(self.sums), 1))], axis=1)
        best = np.zeros(len(sets))
        for total, row in zip(self.sums, below, strict=True):
            value = np.full(len(sets), total)
            for k in range(sets.shape[1]):
                value += row[sets[:, k]]
            np.maximum(best, value, out=best)
        return best


def rounded(u: NDArray[np.floating]) -> Table:
    """Return prices as multiples of 1/1024."""
    whole: Table = (np.floor(u * PRICE_STEPS) / PRICE_STEPS).astype(np.float32)
    return whole


def floors(core: Core, u: Table) -> Floors:
    """Work out what prices (k, m) say about each grip."""
    below = np.zeros((len(u), len(core.rows)))
    for g, (rows, prices) in enumerate(zip(core.rows, core.units, strict=True)):
        left = prices[None] - u @ rows.T
        below[:, g] = np.minimum(left, 0.0).sum(axis=1, dtype=np.float64)
    return Floors(u=u, sums=u.sum(axis=1, dtype=np.float64), below=below)


def union_prices(core: Core) -> tuple[Table, float]:
    """Solve the cover by fractions of views over all grips.

    Returns
    -------
    u : (m,) prices; floor : of the unit prices of any cover by any grips
    """
    m = len(core.elements)
    if m == 0:
        return np.zeros(0, dtype=np.float32), 0.0
    rows = np.concatenate(core.rows)
    prices = np.concatenate(core.units).astype(np.float64)
    worth = rows.sum(axis=1) / np.maximum(prices, 1e-3)
    active = np.zeros(len(rows), dtype=bool)
    uncovered = np.ones(m, dtype=bool)
    while uncovered.any():  # a first cover, so that the problem has an answer
        v = int(np.argmax((rows @ uncovered.astype(np.float32)) / np.maximum(prices, 1e-3)))
        active[v] = True
        uncovered &= rows[v] == 0
    active[np.argsort(-worth, kind="stable")[:_LP_GROW]] = True
    best_u, best = np.zeros(m, dtype=np.float32), 0.0
    for _ in range(_LP_ROUNDS):
        answer = linprog(
            -np.ones(m),
            A_ub=rows[active],
            b_ub=prices[active],
            bounds=(0, None),
            method="highs",
        )
        if answer.x is None:
            break
        u = np.maximum(answer.x, 0.0)
        load = rows @ u.astype(np.float32)
        worst = float((load / np.maximum(prices, 1e-9)).max())
        fair = rounded(u / max(1.0, worst))
        value = float(fair.sum(dtype=np.float64))
        slack = np.minimum(prices - rows @ fair, 0.0).sum()
        if value + slack > best:
            best_u, best = fair, value + float(slack)
        over = load - prices
        over[active] = 0.0
        if over.max() <= 1e-4 or best >= u.sum() * 0.999:
            break
        new = np.argsort(-over, kind="stable")[:_LP_GROW]
        active[new[over[new] > 1e-6]] = True
    return best_u, best


def spread_scales(u: Table, factor: float) -> Table:
    """Return the prices (m,) scaled up in steps: what suits all grips is too low for few."""
    return rounded(np.stack([u * np.float32(factor * s) for s in _SCALES] + [u]))


def raise_floors(
    core: Core, sets: IntArray, u: Table, goals: FloatArray, steps: int
) -> tuple[FloatArray, Table]:
    """Improve prices for many sets of grips at once.

    Parameters
    ----------
    sets : (s, w) grips, padded with n; u : (s, m) prices to start from
    goals : (s,) a floor of so many units is enough; steps : how many at most

    Returns
    -------
    floor : (s,) units; u : (s, m) the prices that give it
    """
    n = len(core.rows)
    best, best_u = np.full(len(sets), -np.inf), u.copy()
    pace = np.full(len(sets), 1.0)
    stalled = np.zeros(len(sets), dtype=int)
    active = np.arange(len(sets))
    for _ in range(steps):
        here = sets[active]
        value = u[active].sum(axis=1, dtype=np.float64)
        lack = np.ones((len(active), u.shape[1]), dtype=np.float32)
        for g in np.unique(here[here < n]):
            at = np.flatnonzero((here == g).any(axis=1))
            left = core.units[g][None] - u[active[at]] @ core.rows[g].T
            taken = left < 0.0
            value[at] += np.where(taken, left, np.float32(0)).sum(axis=1, dtype=np.float64)
            lack[at] -= taken.astype(np.float32) @ core.rows[g]
        better = value > best[active] + 1e-9
        best[active[better]] = value[better]
        best_u[active[better]] = u[active[better]]
        stalled[active] = np.where(better, 0, stalled[active] + 1)
        slow = stalled[active] >= _STALL
        pace[active[slow]] *= 0.5
        stalled[active[slow]] = 0
        u[active[slow]] = best_u[active[slow]]
        lack[(u[active] <= 0.0) & (lack < 0.0)] = 0.0
        length = (lack * lack).sum(axis=1, dtype=np.float64)
        aim = np.maximum(goals[active] + 0.3 - value, 0.05)
        size = np.where(length > 0.0, pace[active] * aim / np.maximum(length, 1.0), 0.0)
        moved = np.maximum(u[active] + size[:, None].astype(np.float32) * lack, 0.0)
        u[active] = np.where(slow[:, None], u[active], rounded(moved))
        going = (best[active] < goals[active]) & (length > 0.0) & (pace[active] > 0.02)
        active = active[going]
        if not len(active):
            break
    return np.maximum(best, 0.0), best_u
