"""The cheapest sequence of grasps and views that shows all, or the one that shows most."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from controller.arrays import BoolArray

from ._greedy import greedy
from ._problem import (
    MAX_GRASP_COUNT,
    GraspSequence,
    Problem,
    cost_of,
    live_grasps,
    needed_of,
    solution_of,
)
from ._search import FULL, Effort, GraspSearch
from ._tables import make_tables, quick_cover


def solve(
    problem: Problem,
    *,
    max_grasps: int = MAX_GRASP_COUNT,
    effort: Effort = FULL,
    incumbent: GraspSequence | None = None,
) -> GraspSequence | None:
    """Return the grasps and views that show every needed element at the least cost.

    Parameters
    ----------
    problem : costs and coverage of the problem
    max_grasps : at most so many in a row, transit included
    effort : limits at which it stops; bound and gap are right all the same
    incumbent : a solution known already, of this problem or one much like it; what is no longer
        possible in it is not used

    Returns
    -------
    None where no sequence of grasps leads from start to finish. Where none shows all of what is
    needed, the solution is that of the greatest share of surface one of those found can show, with
    `is_complete` False and `bound_s` inf, or less if the effort ended first.

    Raises
    ------
    AssertionError : the sequence that shows most has no solution, which only a defect of the search
        allows
    """
    if not len(live_grasps(problem, max_grasps)):
        return None
    needed = needed_of(problem, max_grasps)
    tables = make_tables(problem, max_grasps)
    search = GraspSearch(problem, tables, max_grasps, effort)
    for known in (greedy(problem, max_grasps), incumbent):
        good = None if known is None else _repaired(problem, known, needed, max_grasps)
        if good is not None:
            search.offer(*good)
    bound_s = search.run()
    if search.best is None:
        path, part = search.most_shown()
        rest = replace(problem, seen=problem.seen | ~part)
        views = tuple(_plain_views(rest, path))
        least = solve(
            rest,
            max_grasps=max_grasps,
            effort=effort,
            incumbent=solution_of(rest, path, views, 0.0, max_grasps),
        )
        if least is None:
            raise AssertionError("a sequence was found that is none")
        covers = search.covers + least.covers_count
        return solution_of(problem, least.grasps, least.views, bound_s, max_grasps, covers)
    grasps, views, cost_s = search.best
    return solution_of(problem, grasps, views, min(bound_s, cost_s), max_grasps, search.covers)


def _plain_views(problem: Problem, path: Sequence[int]) -> Iterator[tuple[int, ...]]:
    """Yield the views of each grasp of a sequence that show what earlier ones do not."""
    left = ~problem.seen
    for g in path:
        can = np.flatnonzero(np.isfinite(problem.view_s[g]))
        table = problem.shows[g][can] & left
        open_ = table.any(axis=0)
        left = left & ~open_
        if open_.any():
            rows = quick_cover(table[:, open_].astype(np.float32), problem.view_s[g][can])
            yield tuple(sorted(int(v) for v in can[rows]))
        else:
            yield ()


def _repaired(
    problem: Problem, known: GraspSequence, needed: BoolArray, max_grasps: int
) -> tuple[tuple[int, ...], tuple[tuple[int, ...], ...]] | None:
    """Return a similar problem's solution, repaired for this problem if possible."""
    n = problem.grasp_count
    if len(known.grasps) > max_grasps or not all(0 <= g < n for g in known.grasps):
        return None
    if not np.isfinite(cost_of(problem, known.grasps, [()] * len(known.grasps))):
        return None
    kept: list[list[int]] = []
    covered = np.zeros(len(needed), dtype=bool)
    for g, views in zip(known.grasps, known.views, strict=True):
        count = len(problem.view_s[g])
        kept.append([v for v in views if v < count and np.isfinite(problem.view_s[g][v])])
        covered |= problem.shows[g][kept[-1]].any(axis=0)
    rest = replace(problem, seen=covered | ~needed)
    more = list(_plain_views(rest, known.grasps))
    for mine, extra in zip(kept, more, strict=True):
        mine.extend(v for v in extra if v not in mine)
    whole = tuple(tuple(sorted(views)) for views in kept)
    shown = solution_of(problem, known.grasps, whole, 0.0, max_grasps).covered
    return None if (needed & ~shown).any() else (known.grasps, whole)
