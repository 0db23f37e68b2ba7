"""Plans: the steps that show all of a part that can be shown, and end in a tray.

The search (planning-facts.md 1.3) decides on the grasps and the views. Its solution is computed
with all motions; elements without a path are removed from the problem, and the search is repeated.
The same input gives the same plan.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.cad import Solid, StablePose, SurfaceSamples, share_of, uncertainty_of
from messages import say, say_counted

from ..model import (
    CellLayout,
    FaceToShowAgain,
    Grasp,
    InArm,
    InFixedGripper,
    Look,
    NoMotionError,
    NoPlanError,
    OnTable,
    Plan,
    PlanOptions,
    PreparedPart,
    Proof,
    Start,
)
from ..regrasps import PickPath
from ..search import COARSE, FULL, GraspSequence, Problem, refuted, solve
from .beginning import Beginning, from_arm, from_fixed_gripper, from_table
from .build import Build, Builder, RefutedError, check_trays_in_reach
from .costs import EdgeCosts, RegraspSite, make_edge_costs, view_seconds, worthwhile
from .coverage import count_shown, counted_as
from .prepare import among_neighbours, prepare_part, with_grasps, with_rests, without_short
from .second_choice import SecondChoice
from .why import nothing_shown, unseen_pieces

REBUILD_COUNT = 40  # solutions of the search worked out before giving up
SITE_COUNT = 4  # sites at which one regrasp is tried, the cheapest first
# Cosine from which a face counts as square to the overhead camera.
SQUARE_COS = float(np.cos(np.radians(10.0)))


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
    """Return the plan for a part on the table: pick, show, regrasp, show and place.

    Parameters
    ----------
    solid : the part
    samples : samples of its surface
    stable_pose : stable pose of the part on the table
    T_world_part : (4, 4)
    layout : the cell
    rng_seed : seed of the random trees; the same one gives the same plan
    options : requirements on a plan; None for the defaults
    prepared : result of `prepare_part` for the same solid, samples and layout; made here if None

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
    short: frozenset[FaceToShowAgain] = frozenset(),
    rng_seed: int = 0,
) -> Plan:
    """Return the plan for the surface still to be shown, from the part's present place.

    Parameters
    ----------
    part : prepared for this cell
    layout : the cell
    start : state of the part: on the table, in the arm gripper or in the fixed one
    seen : (m,) indices of `PreparedPart.counted_samples` inspected before: no view is spent on them
        again; none if None
    avoid : ids of grasps of either gripper that are not to be used
    short : grasps of the arm and faces of which too little could be compared from them: these faces
        are shown again, from other grasps
    rng_seed : seed of the random trees; the same one gives the same plan

    Raises
    ------
    NoPlanError : and its kinds, with one sentence: what, where, what to do
    """
    check_trays_in_reach(part.solid.name, layout)
    part = among_neighbours(part, layout)
    before = np.zeros(len(part.counted_samples.points_mm), dtype=bool) if seen is None else seen
    before = before & ~np.isin(part.counted_samples.face_ids, [one.face for one in short])
    inspected = before if part.counted is None else before[part.counted.of_chosen]
    match start:
        case OnTable():
            beginning = from_table(part, layout, start, inspected)
        case InArm():
            part = with_grasps(part, layout, [start.grasp])
            beginning = from_arm(part, layout, start)
            avoid -= {start.grasp.id}
        case InFixedGripper():
            beginning = from_fixed_gripper(part, layout, start)
            avoid -= {start.grasp.id}
    look = beginning.look
    task = _Task(
        part=without_short(part, short),
        layout=layout,
        beginning=beginning,
        before=before,
        seen=inspected if look is None else inspected | look.seen,
        squared=_squared_faces(part, inspected, look),
        opened=_opened_bores(part, inspected),
        avoid=avoid,
    )
    return _plan(task, rng_seed)


@dataclass(frozen=True, slots=True, eq=False)
class _Task:
    """Task of one plan: the part, its start, and the surface to show.

    Attributes
    ----------
    before : (m,) points that coverage is counted by, inspected before
    seen : (n,) samples inspected before or shown by the look at the table
    squared : ids of faces that need not be shown squarely again
    opened : ids of walls of bores through which no light need be shown again
    avoid : ids of grasps not to use
    """

    part: PreparedPart
    layout: CellLayout
    beginning: Beginning
    before: BoolArray
    seen: BoolArray
    squared: frozenset[int]
    opened: frozenset[int]
    avoid: frozenset[str]

    def edge_costs(self) -> EdgeCosts:
        """Return the search problem of the task, and the meaning of its indices."""
        return make_edge_costs(
            self.part,
            self.layout,
            self.beginning.first_s,
            self.seen,
            self.squared,
            self.opened,
            self.avoid,
        )

    def is_shown_by(self, solution: GraspSequence | None) -> bool:
        """Return True if a solution shows all that any grasp shows, even an unreachable one."""
        if solution is None:
            return False
        able = self.part.covered.any(axis=0) & ~self.seen
        return not bool((able & ~solution.covered[: len(able)]).any())


def _squared_faces(part: PreparedPart, inspected: BoolArray, look: Look | None) -> frozenset[int]:
    """Return the planar faces that need not be shown squarely again.

    Those are the faces inspected for their most part, and those square to the overhead camera.
    """
    towards = part.directions.square_to.tolist()
    faces = {f for f in towards if f >= 0 and part.solid.faces[f].kind == "plane"}
    able = part.visible.any(axis=0)
    squared = {
        f
        for f in faces
        if inspected[able & (part.samples.face_ids == f)].mean() >= part.options.square_share
    }
    if look is not None:
        above = look.direction_part
        squared |= {f for f in faces if part.solid.faces[f].normal @ above > SQUARE_COS}
    return frozenset(squared)


def _opened_bores(part: PreparedPart, inspected: BoolArray) -> frozenset[int]:
    """Return the walls of bores through which no light need be shown again.

    Those are the walls inspected for their most part. Where no direction shows a wall, all else has
    to be inspected.
    """
    able = part.visible.any(axis=0)
    done = set()
    for face in np.unique(part.openings.faces).tolist():
        mine = able & (part.samples.face_ids == face)
        asked = inspected[mine] if mine.any() else inspected[able]
        if asked.mean() >= (part.options.square_share if mine.any() else 1.0):
            done.add(face)
    return frozenset(done)


def _plan(task: _Task, seed: int) -> Plan:
    """Search, build the solution, and search again without the edges that have no path."""
    options = task.part.options
    narrows = options.least_gain > 0.0
    effort = COARSE if options.is_coarse else FULL
    # which grasps it comes to is enough to know which views are worth their seconds
    first_effort = COARSE if narrows else effort
    costs = task.edge_costs()
    solution = solve(costs.problem, effort=first_effort)
    if not task.is_shown_by(solution) and not task.part.rests:
        # to regrasp over the table costs more: it is considered only where the rest does not do
        task = replace(task, part=with_rests(task.part, task.layout))
        costs = task.edge_costs()
        solution = solve(costs.problem, effort=first_effort)
    problem = costs.problem
    if solution is not None and narrows:
        kept = worthwhile(costs, task.part, task.layout, solution)
        problem = replace(problem, seen=problem.seen | ~kept)
        solution = solve(problem, effort=effort, incumbent=solution)
    builder = _SolutionBuilder(task, costs, seed)
    second = SecondChoice(task.part, task.layout, costs, task.before, task.beginning.look)
    failure: NoPlanError | None = None
    for _ in range(REBUILD_COUNT):
        if solution is None:
            break
        if not solution.needed.any() and not task.seen.any():
            raise nothing_shown(task.part, task.layout, task.seen)
        whole = second.added_to(problem, solution)
        try:
            return builder.plan(problem, whole, whole.view_count - solution.view_count)
        except RefutedError as error:
            failure = failure or error.reason
            problem = refuted(
                problem,
                regrasps=error.regrasps,
                views=_rows(costs, error.views),
                firsts=error.firsts,
                lasts=error.lasts,
            )
            if not _is_of_second_choice(error, solution, costs):
                solution = solve(problem, effort=effort, incumbent=solution)
    raise failure or NoMotionError(
        say(
            "{name} {where}: no grasp within reach leads to a tray",
            name=task.part.solid.name,
            where=task.beginning.where,
        )
    )


def _is_of_second_choice(error: RefutedError, solution: GraspSequence, costs: EdgeCosts) -> bool:
    """Return True if the refuted edges are only views that the search did not choose."""
    chosen = {
        (g, int(costs.views[g][row]))
        for g, rows in zip(solution.grasps, solution.views, strict=True)
        for row in rows
    }
    others = (*error.regrasps, *error.firsts, *error.lasts)
    return not others and not chosen & set(error.views)


class _SolutionBuilder:
    """Builds the plans of solutions, with all motions.

    Parameters
    ----------
    task : samples and views the plan has to cover
    costs : costs of the task: what the numbers of a solution stand for
    seed : seed of the random trees
    """

    def __init__(self, task: _Task, costs: EdgeCosts, seed: int) -> None:
        self._task = task
        self._costs = costs
        self._builder = Builder(task.part, task.layout, seed)

    def plan(self, problem: Problem, solution: GraspSequence, second_count: int) -> Plan:
        """Return the plan that a solution stands for.

        Parameters
        ----------
        problem : problem that was solved
        solution : its solution
        second_count : number of views beyond those that the search chose

        Raises
        ------
        RefutedError : a part of the solution has no path
        """
        task, costs, builder = self._task, self._costs, self._builder
        part, layout = task.part, task.layout
        count = len(part.samples.points_mm)
        look = task.beginning.look
        build = Build(task.beginning.q, task.seen.copy(), [] if look is None else [look])
        builder.check_trays(solution.grasps[-1])
        task.beginning.take(builder, build, solution.grasps[0])
        used: list[Grasp] = []
        for turn, g in enumerate(solution.grasps):
            used.append(part.arm_grasps[g])
            views = [int(costs.views[g][row]) for row in solution.views[turn]]
            if turn + 1 == len(solution.grasps):
                builder.show(build, g, views, None)
                break
            site = self._regrasp(build, g, solution.grasps[turn + 1], views)
            if site.fixed_grasp_index >= 0:
                used.append(part.fixed_grasps[site.fixed_grasp_index])
        trays, home = builder.sort(build, solution.grasps[-1])
        able = part.covered.any(axis=0) | task.seen
        steps, seen = count_shown(part, layout, build.steps, task.before)
        reachable = counted_as(part, able, seen)
        return Plan(
            steps=steps,
            place=trays,
            park=home,
            covered_fraction=share_of(part.counted_samples, seen),
            covered_U=uncertainty_of(part.counted_samples, seen),
            reachable_fraction=share_of(part.counted_samples, reachable),
            unseen=unseen_pieces(
                part,
                layout,
                build.seen,
                _closure(problem),
                counted_seen=seen,
                apart=(solution.needed & ~solution.covered)[:count],
                dropped=problem.seen[:count] & ~task.seen,
                lies_in=task.beginning.pose_index,
            ),
            grasps=tuple(used),
            # of what shows less than could be shown one way or another nothing is claimed
            proof=Proof(
                solution.cost_s,
                solution.bound_s if solution.is_complete else 0.0,
                _scope(task, costs, second_count),
            ),
        )

    def _regrasp(self, build: Build, g: int, h: int, views: Sequence[int]) -> RegraspSite:
        """Show the views of one grasp, then regrasp to the next; return the site of it.

        Raises
        ------
        RefutedError : no site serves
        """
        costs = self._costs
        by_cost = np.argsort(costs.site_s[:, g, h], kind="stable")[:SITE_COUNT]
        failure: NoPlanError | None = None
        for k in by_cost:
            if not np.isfinite(costs.site_s[k, g, h]):
                break
            site: RegraspSite = costs.sites[int(k)]
            trial = Build(build.q, build.seen.copy(), list(build.steps))
            self._builder.show(trial, g, views, site.paths[g].entry[0])
            try:
                self._regrasp_at(trial, site, g, h)
            except NoMotionError as error:
                failure = failure or error
                continue
            build.q, build.seen, build.steps = trial.q, trial.seen, trial.steps
            return site
        assert failure is not None
        raise RefutedError(failure, regrasps=[(g, h)])

    def _regrasp_at(self, build: Build, site: RegraspSite, g: int, h: int) -> None:
        part, builder = self._task.part, self._builder
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


def _scope(task: _Task, costs: EdgeCosts, second_count: int) -> str:
    """Return the sets over which a plan of the task is proven optimal.

    Parameters
    ----------
    task : samples and views the plan has to cover
    costs : costs of the task
    second_count : views more than the proof is about, for spots between the samples
    """
    part = task.part
    fixed = sum(s.fixed_grasp_index >= 0 for s in costs.sites)
    set_down_count = len(costs.sites) - fixed
    gain = part.options.least_gain
    left_out = (
        say("; views that add less than {gain:.2%} of the surface are left out", gain=gain)
        if gain
        else ""
    )
    more = (
        say_counted(
            "; {count} view more for spots between the samples",
            "; {count} views more for spots between the samples",
            count=second_count,
        )
        if second_count
        else ""
    )
    return say(
        "regrasp time, regrasp risk and {view_seconds:.1f} s per view over "
        "{arm_grasps_count} arm grasps, {fixed} fixed-gripper grasps, "
        "{set_down_count} poses on the table, {vectors_count} "
        "directions{left_out}{more}",
        view_seconds=view_seconds(task.layout),
        arm_grasps_count=len(part.arm_grasps),
        fixed=fixed,
        set_down_count=set_down_count,
        vectors_count=len(part.directions.vectors),
        left_out=left_out,
        more=more,
    )


def _rows(costs: EdgeCosts, views: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return (grasp, row) of (grasp, direction)."""
    return [(g, int(np.flatnonzero(costs.views[g] == v)[0])) for g, v in views]


def _closure(problem: Problem) -> list[int]:
    """Return the grasps that any number of regrasps lead to from the start."""
    had = np.isfinite(problem.first_s)
    can = np.isfinite(problem.regrasp_s)
    while True:
        more = had | can[had].any(axis=0)
        if (more == had).all():
            return [int(g) for g in np.flatnonzero(had)]
        had = more
