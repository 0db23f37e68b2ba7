"""The problem and the solution of the search: visibility tables and costs; no geometry.

A *grasp* is a number here, an *element* a thing to be shown (a surface sample, or a
feature such as "face 7 seen square"). planning-facts.md 1.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from controller.arrays import BoolArray, FloatArray, IndexArray

# Most grasps in a sequence. A fourth regrasp's bound exceeded every optimum measured
# (planning-facts.md 1.3).
MAX_GRASP_COUNT = 5
SAME_S = 1e-7  # costs closer than this [s] are one


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """A problem of the search: grasps, the elements that their views show, and all costs.

    Attributes
    ----------
    shows : per grasp (v_g, m): which of the m elements each of its views shows
    weights : (m,) share of surface of each element, only to report what is covered
    view_s : per grasp (v_g,) cost of each view [s], inf = not possible
    first_s : (g,) cost of having the part in that grasp at the start [s], inf = not possible
    regrasp_s : (g, g) cost of the cheapest regrasp over any site [s], inf = none
    last_s : (g,) cost of finishing from that grasp [s], inf = cannot
    seen : (m,) elements already seen, which need not be shown again

    Raises
    ------
    ValueError : shapes do not fit together, or a cost is negative or not a number
    """

    shows: tuple[BoolArray, ...]
    weights: FloatArray
    view_s: tuple[FloatArray, ...]
    first_s: FloatArray
    regrasp_s: FloatArray
    last_s: FloatArray
    seen: BoolArray

    def __post_init__(self) -> None:
        n, m = len(self.shows), len(self.weights)
        if len(self.view_s) != n or self.seen.shape != (m,):
            raise ValueError(
                f"expected costs of views for {n} grasps and `seen` ({m},), found "
                f"{len(self.view_s)} and {self.seen.shape}"
            )
        if (
            self.first_s.shape != (n,)
            or self.last_s.shape != (n,)
            or self.regrasp_s.shape != (n, n)
        ):
            raise ValueError(
                f"expected first_s ({n},), regrasp_s ({n}, {n}) and last_s ({n},) for {n} grasps, "
                f"found {self.first_s.shape}, {self.regrasp_s.shape} and {self.last_s.shape}"
            )
        for g, (table, costs) in enumerate(zip(self.shows, self.view_s, strict=True)):
            if table.shape != (len(costs), m) or table.dtype != np.bool_:
                raise ValueError(
                    f"grasp {g}: expected views ({len(costs)}, {m}) bool and one cost each, found "
                    f"{table.shape} {table.dtype}"
                )
        for costs in (self.first_s, self.regrasp_s, self.last_s, *self.view_s):
            if not (costs >= 0.0).all():
                raise ValueError(f"expected costs from 0 s up, found {costs[~(costs >= 0.0)][0]}")

    @property
    def grasp_count(self) -> int:
        """The number of grasps."""
        return len(self.shows)


@dataclass(frozen=True, slots=True, eq=False)
class GraspSequence:
    """Grasps to hold the part with in turn, and the views to take under each.

    Attributes
    ----------
    grasps : in order; one may come twice, and one without views is mere transit
    views : per entry of `grasps` the views to take, ascending
    cost_s : first, regrasps, views and last together
    bound_s : lower bound on what shows all of `needed` with the grasps allowed; inf = nothing does
    covered : (m,) samples covered by the chosen views
    needed : (m,) samples that some available view covers, without those seen already
    covers_count : set cover problems solved exactly, a measure of work
    """

    grasps: tuple[int, ...]
    views: tuple[tuple[int, ...], ...]
    cost_s: float
    bound_s: float
    covered: BoolArray
    needed: BoolArray
    covers_count: int = 0

    @property
    def is_complete(self) -> bool:
        """True if all that is needed is shown."""
        return not bool((self.needed & ~self.covered).any())

    @property
    def is_optimal(self) -> bool:
        """True if all is shown and nothing cheaper does so."""
        return self.is_complete and self.cost_s <= self.bound_s

    @property
    def gap(self) -> float:
        """Share of its cost by which the solution may still be improved."""
        return max(0.0, self.cost_s - self.bound_s) / self.cost_s if self.cost_s > 0.0 else 0.0

    @property
    def view_count(self) -> int:
        """The number of views."""
        return sum(map(len, self.views))


def live_grasps(problem: Problem, max_grasps: int = MAX_GRASP_COUNT) -> IndexArray:
    """Return, ascending, the grasps that lie on some sequence from start to finish."""
    regrasp = np.isfinite(problem.regrasp_s)
    to = _steps(np.isfinite(problem.first_s), regrasp)
    back = _steps(np.isfinite(problem.last_s), regrasp.T)
    return np.flatnonzero(to + back + 1 <= max_grasps)


def _steps(sources: BoolArray, regrasp: BoolArray) -> FloatArray:
    """Return the number of regrasps from the sources to each grasp, inf = out of reach."""
    steps = np.where(sources, 0.0, np.inf)
    reached, front, k = sources.copy(), sources, 0
    while front.any():
        k += 1
        front = regrasp[front].any(axis=0) & ~reached
        steps[front] = k
        reached |= front
    return steps


def needed_of(problem: Problem, max_grasps: int = MAX_GRASP_COUNT) -> BoolArray:
    """Return a mask (m,) of the unseen elements that some view under some live grasp shows."""
    needed = np.zeros(len(problem.weights), dtype=bool)
    for g in live_grasps(problem, max_grasps):
        needed |= problem.shows[g][np.isfinite(problem.view_s[g])].any(axis=0)
    return needed & ~problem.seen


def cost_of(problem: Problem, grasps: Sequence[int], views: Sequence[Sequence[int]]) -> float:
    """Return the cost of a sequence of grasps with their views [s], inf if it is impossible.

    Parameters
    ----------
    problem : costs of the problem
    grasps : numbers in order, at least one
    views : under each of them, numbers of views
    """
    cost = float(problem.first_s[grasps[0]]) + float(problem.last_s[grasps[-1]])
    for g, h in pairwise(grasps):
        cost += float(problem.regrasp_s[g, h])
    for g, chosen in zip(grasps, views, strict=True):
        cost += float(problem.view_s[g][list(chosen)].sum())
    return cost


def solution_of(
    problem: Problem,
    grasps: Sequence[int],
    views: Sequence[Sequence[int]],
    bound_s: float,
    max_grasps: int = MAX_GRASP_COUNT,
    covers_count: int = 0,
) -> GraspSequence:
    """Return a solution with its cost and coverage, computed from the problem alone.

    Parameters
    ----------
    problem : costs and coverage of the problem
    grasps : numbers in order, at least one
    views : under each of them, numbers of views
    bound_s : lower bound on the cost of any plan, for the record
    max_grasps : at most so many in a row, by which it is known what can be shown
    covers_count : set cover problems solved so far, for the record
    """
    covered = np.zeros(len(problem.weights), dtype=bool)
    for g, chosen in zip(grasps, views, strict=True):
        covered |= problem.shows[g][list(chosen)].any(axis=0)
    return GraspSequence(
        grasps=tuple(int(g) for g in grasps),
        views=tuple(tuple(sorted(int(v) for v in chosen)) for chosen in views),
        cost_s=cost_of(problem, grasps, views),
        bound_s=bound_s,
        covered=covered,
        needed=needed_of(problem, max_grasps),
        covers_count=covers_count,
    )


def refuted(
    problem: Problem,
    *,
    regrasps: Sequence[tuple[int, int]] = (),
    views: Sequence[tuple[int, int]] = (),
    firsts: Sequence[int] = (),
    lasts: Sequence[int] = (),
) -> Problem:
    """Return the problem without the regrasps and views that were found impossible.

    Parameters
    ----------
    problem : left as it is
    regrasps : (from, to) grasps between which no motion was found
    views : (grasp, view) views that cannot be taken
    firsts, lasts : grasps that cannot be had at the start, or be finished from
    """
    first_s, regrasp_s, last_s = (
        problem.first_s.copy(),
        problem.regrasp_s.copy(),
        problem.last_s.copy(),
    )
    view_s = list(problem.view_s)
    for g, h in regrasps:
        regrasp_s[g, h] = np.inf
    for g, v in views:
        if view_s[g] is problem.view_s[g]:
            view_s[g] = view_s[g].copy()
        view_s[g][v] = np.inf
    first_s[list(firsts)] = np.inf
    last_s[list(lasts)] = np.inf
    return replace(
        problem, view_s=tuple(view_s), first_s=first_s, regrasp_s=regrasp_s, last_s=last_s
    )
