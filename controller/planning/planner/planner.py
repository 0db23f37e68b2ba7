"""From where the part is to the steps that show all of it that can be shown, and sort it.

The search (planning-facts.md 1.3) settles in which grasps to hold the part and which views to take;
its answer is worked out with all motions, and what turns out to have no way is taken out of the
search. Same input, same plan.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.cad import Solid, StablePose, SurfaceSamples
from controller.imaging import RayCaster, inverse_pose

from ..model import (
    CellLayout,
    Grasp,
    HandOff,
    InArm,
    InFixedGripper,
    Look,
    NoMotionError,
    NoPlanError,
    OnTable,
    OutOfReachError,
    Plan,
    PlanOptions,
    PreparedPart,
    Proof,
    Start,
)
from ..motion import segment_seconds
from ..regrasps import PickPath, hand_offs, pick_paths
from ..search import COARSE, FULL, Problem, Solution, refuted, solve
from ..views import table_views
from .build import Build, Builder, RefutedError, check_trays_in_reach
from .costs import EdgeCosts, RegraspSite, first_seconds, make_edge_costs, take_seconds, worthwhile
from .prepare import prepare_part, with_grasps, with_rests
from .why import unseen_pieces

REBUILDS_N = 40  # answers of the search worked out before giving up
SITE_COUNT = 4  # ways over which one regrasp is tried
PICKS_N = 3
SQUARE_COS = float(np.cos(np.radians(10.0)))  # the table is looked at nearly from above


def plan_part(
    solid: Solid,
    samples: SurfaceSamples,
    stable_pose: StablePose,
    T_world_part: FloatArray,
    layout: CellLayout,
    rng_seed: int = 0,
    options: PlanOptions | None = None,
    prepared: PreparedPart | None = None,
) -> Plan:
    """Return the steps that pick, show, pass over, show and place a part.

    Parameters
    ----------
    solid : the part
    samples : of its surface
    stable_pose : which way up it lies; T_world_part : (4, 4) where
    layout : the cell
    rng_seed : of the random trees; the same one gives the same plan
    options : what is asked of a plan; None for the defaults
    prepared : of `prepare_part` for the same solid, samples and layout; made here if None

    Raises
    ------
    NoPlanError : and its kinds, with one sentence: what, where, what to do
    """
    part = prepared or prepare_part(solid, samples, layout, options)
    return plan_from(part, layout, OnTable(stable_pose.index, T_world_part), rng_seed=rng_seed)


def plan_from(
    part: PreparedPart,
    layout: CellLayout,
    start: Start,
    *,
    seen: BoolArray | None = None,
    avoid: frozenset[str] = frozenset(),
    rng_seed: int = 0,
) -> Plan:
    """Return the steps that show what is left to be shown, from whoever has the part now.

    Parameters
    ----------
    part : prepared for this cell
    layout : the cell
    start : where the part is: on the table, in the arm gripper or in the fixed one
    seen : (n,) samples inspected before, which no view is spent on again; none if None
    avoid : ids of grasps of either holder that are not to be used
    rng_seed : of the random trees; the same one gives the same plan

    Raises
    ------
    NoPlanError : and its kinds, with one sentence: what, where, what to do
    """
    done = np.zeros(len(part.samples.points_mm), dtype=bool) if seen is None else seen
    match start:
        case OnTable():
            return _FromTable(part, layout, start, done, avoid, rng_seed).plan()
        case InArm():
            held = with_grasps(part, layout, [start.grasp])
            return _FromArm(held, layout, start, done, avoid, rng_seed).plan()
        case InFixedGripper():
            return _FromFixedGripper(part, layout, start, done, avoid, rng_seed).plan()


class _Planner(ABC):
    """Searches, works out, searches again without what had no path."""

    def __init__(
        self,
        part: PreparedPart,
        layout: CellLayout,
        q: FloatArray,
        done: BoolArray,
        avoid: frozenset[str],
        seed: int,
    ) -> None:
        self._part = part
        self._layout = layout
        self._q = q
        self._done = done
        self._avoid = avoid
        self._seed = seed
        self._builder = Builder(part, layout, seed)
        self._look: Look | None = None
        self._squared: frozenset[int] = frozenset()

    @abstractmethod
    def first_s(self) -> FloatArray:
        """Return what it costs to have the part in each arm grasp (g,)."""

    def look(self) -> Look | None:
        """Return what the pictures of the table show already, None if nothing new."""
        return None

    @abstractmethod
    def begin(self, build: Build, g: int) -> None:
        """Add the steps that bring the part into the first grasp."""

    @abstractmethod
    def where(self) -> str:
        """Say where the part is, for messages."""

    def plan(self) -> Plan:
        """Return the plan.

        Raises
        ------
        NoPlanError : there is none
        """
        check_trays_in_reach(self._part.solid.name, self._layout)
        first_s = self.first_s()
        self._look = self.look()
        # a face that was inspected before, for its most part, need not be shown squarely again
        part = self._part
        towards = part.directions.square_to.tolist()
        faces = {f for f in towards if f >= 0 and part.solid.faces[f].kind == "plane"}
        able = part.visible.any(axis=0)
        self._squared = frozenset(
            f
            for f in faces
            if self._done[able & (part.samples.face_ids == f)].mean() >= part.options.square_share
        )
        if self._look is not None:
            self._done = self._done | self._look.seen
            above = self._look.direction_part
            self._squared |= {f for f in faces if part.solid.faces[f].normal @ above > SQUARE_COS}
        costs = self._prices(first_s)
        problem = costs.problem
        # which grasps it comes to is enough to know what is worth a view; then it is asked in full
        narrows = self._part.options.least_gain > 0.0
        effort = COARSE if self._part.options.is_coarse else FULL
        solution = solve(problem, effort=COARSE if narrows else effort)
        if not self._shows_all(solution) and not self._part.rests:
            # the table is the dearer way to change a grasp, so that it is asked last
            self._part = with_rests(self._part, self._layout)
            self._builder = Builder(self._part, self._layout, self._seed)
            costs = self._prices(first_s)
            problem = costs.problem
            solution = solve(problem, effort=COARSE if narrows else effort)
        if solution is not None and narrows:
            kept = worthwhile(costs, self._part, solution.grasps)
            problem = replace(problem, seen=problem.seen | ~kept)
            solution = solve(problem, effort=effort, incumbent=solution)
        failure: NoPlanError | None = None
        for _ in range(REBUILDS_N):
            if solution is None:
                break
            if not solution.needed.any() and not self._done.any():
                raise self._nothing_shown()
            try:
                return self._work_out(costs, problem, solution)
            except RefutedError as error:
                failure = failure or error.reason
                problem = refuted(
                    problem,
                    regrasps=error.regrasps,
                    views=_rows(costs, error.views),
                    firsts=error.firsts,
                    lasts=error.lasts,
                )
                solution = solve(problem, effort=effort, incumbent=solution)
        raise failure or NoMotionError(
            f"{self._part.solid.name} {self.where()}: no grasp within reach leads to a tray"
        )

    def _shows_all(self, solution: Solution | None) -> bool:
        """Return whether a solution shows what any grasp shows, even one that nothing leads to."""
        if solution is None:
            return False
        able = self._part.covered.any(axis=0) & ~self._done
        return not bool((able & ~solution.covered[: len(able)]).any())

    def _prices(self, first_s: FloatArray) -> EdgeCosts:
        return make_edge_costs(
            self._part, self._layout, first_s, self._done, self._squared, self._avoid
        )

    def _nothing_shown(self) -> NoPlanError:
        """Say why not one view of the part can be had, with the number that fails."""
        part, layout = self._part, self._layout
        arm = layout.arm
        x, y, z = layout.station_mm
        away = float(np.hypot(*(layout.station_mm - layout.T_world_arm[:3, 3])[:2]))
        limit = arm.reach_mm
        where = f"the station at ({x:.0f}, {y:.0f}, {z:.0f})"
        if away > limit + arm.tool_mm:
            return OutOfReachError(
                f"{part.solid.name}: {where} is {away:.0f} mm from the arm's axis, the "
                f"outstretched arm with its gripper reaches {limit + arm.tool_mm:.0f} mm; move the "
                "station nearer",
                reach_mm=away,
                limit_mm=limit,
                where="station",
            )
        why = unseen_pieces(
            part,
            layout,
            self._done,
            range(len(part.arm_grasps)),
            apart=np.zeros_like(self._done),
            dropped=np.zeros_like(self._done),
        )
        reason = f"{why[0].reason}; {why[0].advice}" if why else "no view shows anything"
        return OutOfReachError(
            f"{part.solid.name}: nothing of it can be shown at {where}: {reason}",
            reach_mm=away,
            limit_mm=limit,
            where="station",
        )

    def _lies_in(self) -> int:
        """Return the index of the stable pose it lies in, -1 if it is held."""
        return -1

    def _work_out(self, costs: EdgeCosts, problem: Problem, solution: Solution) -> Plan:
        part, layout, builder = self._part, self._layout, self._builder
        count = len(part.samples.points_mm)
        build = Build(self._q, self._done.copy(), [] if self._look is None else [self._look])
        builder.check_trays(solution.grasps[-1])
        self.begin(build, solution.grasps[0])
        used: list[Grasp] = []
        for place, g in enumerate(solution.grasps):
            used.append(part.arm_grasps[g])
            views = [int(costs.views[g][row]) for row in solution.views[place]]
            if place + 1 == len(solution.grasps):
                builder.show(build, g, views, None)
                break
            h = solution.grasps[place + 1]
            site = self._regrasp(costs, build, g, h, views)
            if site.fixed_grasp_index >= 0:
                used.append(part.fixed_grasps[site.fixed_grasp_index])
        trays, home = builder.sort(build, solution.grasps[-1])
        slowest = max(trays[t].seconds + home[t].seconds for t in trays)
        able = part.covered.any(axis=0) | self._done
        return Plan(
            steps=tuple(build.steps),
            place=trays,
            park=home,
            forecast_s=sum(s.seconds for s in build.steps) + slowest,
            covered_fraction=float(part.weights[build.seen].sum()),
            reachable_fraction=float(part.weights[able].sum()),
            unseen=unseen_pieces(
                part,
                layout,
                build.seen,
                _closure(problem),
                apart=(solution.needed & ~solution.covered)[:count],
                dropped=problem.seen[:count] & ~self._done,
                lies_in=self._lies_in(),
            ),
            grasps=tuple(used),
            # of what shows less than could be shown one way or another nothing is claimed
            proof=Proof(
                solution.cost_s,
                solution.bound_s if solution.is_complete else 0.0,
                self._scope(costs),
            ),
        )

    def _scope(self, costs: EdgeCosts) -> str:
        part = self._part
        fixed = sum(s.fixed_grasp_index >= 0 for s in costs.sites)
        set_down_count = len(costs.sites) - fixed
        gain = part.options.least_gain
        left_out = f"; views that add less than {gain:.2%} of the surface left out" if gain else ""
        return (
            "seconds of regrasps with their risk, and "
            f"{self._layout.cell_times.look_s:.1f} s a view "
            f"with the path to it, among {len(part.arm_grasps)} grasps of the arm gripper, "
            f"{fixed} of the fixed gripper, {set_down_count} poses on the table and "
            f"{len(part.directions.vectors)} directions{left_out}"
        )

    def _regrasp(
        self,
        costs: EdgeCosts,
        build: Build,
        g: int,
        h: int,
        views: Sequence[int],
    ) -> RegraspSite:
        """Show the views of one grasp, then change to the next; return over what.

        Raises
        ------
        RefutedError : no site serves
        """
        by_cost = np.argsort(costs.site_s[:, g, h], kind="stable")[:SITE_COUNT]
        failure: NoPlanError | None = None
        for k in by_cost:
            if not np.isfinite(costs.site_s[k, g, h]):
                break
            site: RegraspSite = costs.sites[int(k)]
            trial = Build(build.q, build.seen.copy(), list(build.steps))
            self._builder.show(trial, g, views, site.paths[g].entry[0])
            try:
                self._change(trial, site, g, h)
            except NoMotionError as error:
                failure = failure or error
                continue
            build.q, build.seen, build.steps = trial.q, trial.seen, trial.steps
            return site
        assert failure is not None
        raise RefutedError(failure, regrasps=[(g, h)])

    def _change(self, build: Build, site: RegraspSite, g: int, h: int) -> None:
        part, builder = self._part, self._builder
        leave, take = site.paths[g], site.paths[h]
        if site.fixed_grasp_index >= 0:
            held = part.fixed_grasps[site.fixed_grasp_index]
            T_part = builder.give(build, g, leave, held)
            builder.receive(build, h, take, held, T_part)
            return
        rest = part.rests[site.rest]
        builder.set_down(build, g, leave, rest.T_world_part, rest.pose_index)
        path = PickPath(h, take.retreat[::-1], take.entry[::-1])
        try:
            builder.pick(build, [path], rest.T_world_part)
        except RefutedError as error:
            raise NoMotionError(str(error)) from error


class _FromTable(_Planner):
    def __init__(
        self,
        part: PreparedPart,
        layout: CellLayout,
        start: OnTable,
        done: BoolArray,
        avoid: frozenset[str],
        seed: int,
    ) -> None:
        q = layout.park_q if start.q is None else start.q
        super().__init__(part, layout, q, done, avoid, seed)
        self._T = start.T_world_part
        self._pose_index = start.pose_index
        self._picks: dict[int, list[PickPath]] = {}

    def first_s(self) -> FloatArray:
        part, layout = self._part, self._layout
        for path in pick_paths(part, layout, self._T):
            self._picks.setdefault(path.grasp, []).append(path)
        for paths in self._picks.values():
            paths.sort(key=lambda w: float(segment_seconds(layout, self._q, w.down[0])))
            del paths[PICKS_N:]
        return first_seconds(part, layout, self._q, self._picks)

    def look(self) -> Look | None:
        part, layout, options = self._part, self._layout, self._part.options
        if not options.table_views:
            return None
        (seen,) = table_views(
            part.samples,
            RayCaster(part.solid.mesh),
            self._T[None],
            layout.overhead,
            layout.overhead_sharp_mm,
            float(np.radians(options.max_incidence_deg)),
            options.min_px_per_mm,
        )
        if not (seen & ~self._done).any():
            return None
        eye = inverse_pose(self._T) @ np.append(layout.overhead.position_mm, 1.0)
        towards = eye[:3] - part.solid.centroid_mm
        return Look(
            seconds=0.0,
            label="view it on the table",
            view_id="T0",
            T_world_part=self._T,
            direction_part=towards / np.linalg.norm(towards),
            seen=seen,
        )

    def begin(self, build: Build, g: int) -> None:
        self._builder.pick(build, self._picks[g], self._T)

    def where(self) -> str:
        return "on the table"

    def _lies_in(self) -> int:
        return self._pose_index


class _FromArm(_Planner):
    """The last of the part's arm grasps is the measured one that holds it."""

    def __init__(
        self,
        part: PreparedPart,
        layout: CellLayout,
        start: InArm,
        done: BoolArray,
        avoid: frozenset[str],
        seed: int,
    ) -> None:
        super().__init__(part, layout, start.q, done, avoid - {start.grasp.id}, seed)

    def first_s(self) -> FloatArray:
        seconds = np.full(len(self._part.arm_grasps), np.inf)
        seconds[-1] = float(segment_seconds(self._layout, self._q, self._part.home_q[-1]))
        return seconds

    def begin(self, build: Build, g: int) -> None:
        """Nothing is to be done: it is held already."""

    def where(self) -> str:
        return "in the arm gripper"


class _FromFixedGripper(_Planner):
    def __init__(
        self,
        part: PreparedPart,
        layout: CellLayout,
        start: InFixedGripper,
        done: BoolArray,
        avoid: frozenset[str],
        seed: int,
    ) -> None:
        super().__init__(part, layout, start.q, done, avoid - {start.grasp.id}, seed)
        self._grasp = start.grasp
        paths: Mapping[int, HandOff] = hand_offs(layout, part.shape, start.grasp, part.arm_grasps)
        self._site = RegraspSite(-1, -1, paths)

    def first_s(self) -> FloatArray:
        return take_seconds(self._part, self._layout, self._q, self._site)

    def begin(self, build: Build, g: int) -> None:
        T = self._layout.T_world_fixed_tcp @ inverse_pose(self._grasp.T_part_tcp)
        try:
            self._builder.receive(build, g, self._site.paths[g], self._grasp, T)
        except NoMotionError as error:
            raise RefutedError(error, firsts=[g]) from error

    def where(self) -> str:
        return "in the fixed gripper"


def _rows(costs: EdgeCosts, views: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return (grasp, row) of (grasp, direction)."""
    return [(g, int(np.flatnonzero(costs.views[g] == v)[0])) for g, v in views]


def _closure(problem: Problem) -> list[int]:
    """Return the grasps that can be had from the start, by any number of changes."""
    had = np.isfinite(problem.first_s)
    can = np.isfinite(problem.regrasp_s)
    while True:
        more = had | can[had].any(axis=0)
        if (more == had).all():
            return [int(g) for g in np.flatnonzero(had)]
        had = more
