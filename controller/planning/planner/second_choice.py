"""A second choice of views, for spots that the first leaves blind between its samples (ADR 57).

The search chooses grasps and views by some thousand samples, from tables of every direction. Blind
spots of these views, on points a millimetre or so apart, are found at the poses of the views, and
further views under the same grasps are added for them. Coverage is counted by neither set.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controller.arrays import BoolArray, FloatArray, IntArray
from controller.imaging import RayCaster

from ..model import CellLayout, Look, PreparedPart
from ..search import GraspSequence, Problem, exact_cover, solution_of
from ..views import CameraSight, Counter, most_worth, nearest_on_face
from .choice import worth_of
from .costs import EdgeCosts

ROUND_COUNT = 3  # other views leave other spots blind; the last round only adds views
NODE_COUNT = 500  # limit of the search for the cheapest views


class SecondChoice:
    """Adds views for blind spots to solutions of one task.

    Parameters
    ----------
    part : prepared
    layout : the cell
    costs : costs of the task: what the numbers of a solution stand for
    before : (m,) points counted by that were inspected before
    look : information from the overhead camera; None if there is nothing new
    """

    def __init__(
        self,
        part: PreparedPart,
        layout: CellLayout,
        costs: EdgeCosts,
        before: BoolArray,
        look: Look | None,
    ) -> None:
        self._part, self._costs = part, costs
        self._sightings: dict[tuple[int, int], CameraSight] = {}
        self._left: IntArray = np.zeros(0, dtype=np.int64)  # probes that nothing has shown yet
        if part.counted is None:
            return
        probes = part.counted.probes
        self._worth = worth_of(probes, part.options)
        caster = RayCaster(part.solid.mesh)
        self._counter = Counter(part.solid, probes, layout, part.options, caster)
        unseen = np.ones(len(probes.points_mm), dtype=bool)
        if before.any():
            unseen = ~before[nearest_on_face(part.counted.samples, probes)]
        if look is not None:
            unseen &= ~self._counter.on_table(look.T_world_part)
        self._left = np.flatnonzero(unseen)

    def added_to(self, problem: Problem, solution: GraspSequence) -> GraspSequence:
        """Return a solution with the same grasps whose views show blind spots, too.

        Parameters
        ----------
        problem : problem that was solved
        solution : its solution
        """
        if len(self._left) == 0:
            return solution
        rows = _Rows.of(problem, solution)
        if not rows.views:
            return solution
        current = rows.chosen_by(solution)
        found = np.zeros((len(rows.views), 0), dtype=bool)  # which row shows which blind spot
        for trial in range(ROUND_COUNT):
            left = self._blind(rows, current)
            shows = self._shown(rows, left)
            more = most_worth(shows, self._worth[left])
            if not more:
                break
            found = np.hstack([found, shows[:, shows[more].any(axis=0)]])
            current = sorted({*current, *more})
            if trial + 1 < ROUND_COUNT:
                # with these spots to show, some of the first views may do for others, or be vain
                current = rows.fewest(np.hstack([rows.shows, found]), current)
        return solution_of(
            problem,
            solution.grasps,
            rows.by_turn(current),
            solution.bound_s,  # to show more costs no less
            covers_count=solution.covers_count,
        )

    def _blind(self, rows: _Rows, chosen: Sequence[int]) -> IntArray:
        """Return the probes (k,) that some rows leave unseen."""
        left = self._left
        for k in chosen:
            if len(left):
                left = left[~self._shown_by(self._counter.of_rows(left), rows, k)]
        return left

    def _shown(self, rows: _Rows, probes: IntArray) -> BoolArray:
        """Return a mask (r, k) of the probes that each row shows."""
        counter = self._counter.of_rows(probes)
        return np.stack([self._shown_by(counter, rows, k) for k in range(len(rows.views))])

    def _shown_by(self, counter: Counter, rows: _Rows, k: int) -> BoolArray:
        g, view = rows.grasps[k], rows.views[k]
        if (g, view) not in self._sightings:
            q = self._part.view_q[g][int(self._costs.views[g][view])]
            self._sightings[g, view] = counter.sighting(self._part.arm_grasps[g], q[0])
        return counter.shown(self._sightings[g, view])


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """The views available under a solution's grasps, and the needed samples that they show.

    Attributes
    ----------
    turns : (r,) numbers of the solution's grasps, at their first use
    grasps, views : (r,) numbers, as the problem has them
    costs_s : (r,)
    shows : (r, e) mask of the elements that the solution must show
    """

    turn_count: int
    turns: list[int]
    grasps: list[int]
    views: list[int]
    costs_s: FloatArray
    shows: BoolArray

    @classmethod
    def of(cls, problem: Problem, solution: GraspSequence) -> _Rows:
        needed = solution.needed & solution.covered
        rows = [
            (turn, g, view)
            for turn, g in enumerate(solution.grasps)
            if g not in solution.grasps[:turn]
            for view in np.flatnonzero(np.isfinite(problem.view_s[g])).tolist()
        ]
        return cls(
            len(solution.grasps),
            [turn for turn, _, _ in rows],
            [g for _, g, _ in rows],
            [view for _, _, view in rows],
            np.array([problem.view_s[g][view] for _, g, view in rows]),
            np.array([problem.shows[g][view, needed] for _, g, view in rows]),
        )

    def chosen_by(self, solution: GraspSequence) -> list[int]:
        """Return the rows that a solution takes."""
        taken = {
            (g, view)
            for g, views in zip(solution.grasps, solution.views, strict=True)
            for view in views
        }
        pairs = zip(self.grasps, self.views, strict=True)
        return [k for k, pair in enumerate(pairs) if pair in taken]

    def fewest(self, shows: BoolArray, known: Sequence[int]) -> list[int]:
        """Return rows that show all that some known ones show (r, e), the cheapest found."""
        shown = shows[:, shows[list(known)].any(axis=0)]
        limit_s = float(self.costs_s[list(known)].sum())
        better, _ = exact_cover(shown, self.costs_s, limit_s, nodes=NODE_COUNT)
        return list(known) if better is None else sorted(int(k) for k in better)

    def by_turn(self, chosen: Sequence[int]) -> list[list[int]]:
        """Return the views of some rows for each grasp of the solution."""
        return [
            [self.views[k] for k in chosen if self.turns[k] == turn]
            for turn in range(self.turn_count)
        ]
