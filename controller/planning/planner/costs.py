"""Costs of the first grasp and of regrasps, and the views of each grasp.

Costs are seconds between home configurations (one per grasp, in the midst of its views) plus the
seconds a failure would cost times how likely it is (planning-facts.md 1.3, "Cost").
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from controller.arrays import BoolArray, FloatArray, IntArray

from ..model import CellLayout, Grasp, HandOff, PreparedPart, lit_count
from ..motion import move_seconds, segment_seconds
from ..regrasps import PickPath, stands_steadily
from ..search import GraspSequence, Problem
from .choice import PORTION, worth_of

# Time lost by a failed grasp: the part is found, recognised and grasped again in about a minute.
RECOVERY_S = 60.0
MIN_SURE = 0.9  # success rate of a grasp with score 0; one with score 1 does not fail
TRAVEL_S = 2.0  # mean time from one view to the next; their order is decided afterwards
FINISH_S = 10.0  # time of sorting, much the same from every grasp
UNSTEADY_S = 60.0  # time worth spending so that the part does not fall over in its tray


@dataclass(frozen=True, slots=True, eq=False)
class RegraspSite:
    """A place or grasp that holds the part while the arm gripper changes its grasp.

    Attributes
    ----------
    fixed_grasp_index : index of the fixed gripper's grasp, -1 on the table
    rest : index of the place, -1 if none
    paths : arm grasp -> how it meets the site
    """

    fixed_grasp_index: int
    rest: int
    paths: Mapping[int, HandOff]


SQUARE_WORTH = 0.3  # a main face seen squarely is worth this much of its area on top


@dataclass(frozen=True, slots=True, eq=False)
class EdgeCosts:
    """A search problem, and the meaning of its indices.

    Attributes
    ----------
    views : per arm grasp, the direction of each row of `problem.shows`
    square_faces : (f,) the faces whose square view is an element after the samples; after them
        follow the elements of `PreparedPart.openings`
    site_s : (k, g, g) cost of each regrasp over each site
    sites : (k,)
    """

    problem: Problem
    views: tuple[IntArray, ...]
    square_faces: IntArray
    sites: tuple[RegraspSite, ...]
    site_s: FloatArray


def view_seconds(layout: CellLayout) -> float:
    """Return the cost of a view that is not chosen yet [s]."""
    return layout.cell_times.look_s(lit_count(is_square=False)) + TRAVEL_S


def risk_s(grasp: Grasp) -> float:
    """Return the expected cost of a grasp that fails [s]."""
    return RECOVERY_S * (1.0 - MIN_SURE) * (1.0 - grasp.score)


def regrasp_sites_of(part: PreparedPart, avoid: frozenset[str]) -> tuple[RegraspSite, ...]:
    """Return the fixed gripper's grasps and the places on the table, save those to avoid."""
    held = [
        RegraspSite(f, -1, paths)
        for f, paths in enumerate(part.hand_offs)
        if paths and part.fixed_grasps[f].id not in avoid
    ]
    return (*held, *(RegraspSite(-1, r, paths) for r, paths in enumerate(part.set_downs) if paths))


def first_seconds(
    part: PreparedPart,
    layout: CellLayout,
    q: FloatArray,
    picks: Mapping[int, Sequence[PickPath]],
) -> FloatArray:
    """Return the cost of taking the part off the table with each grasp (g,) [s], inf if impossible.

    Parameters
    ----------
    part : prepared
    layout : the cell
    q : (6,) present joints of the arm
    picks : picks of each grasp that can, the paths to take the part; at least one
    """
    seconds = np.full(len(part.arm_grasps), np.inf)
    for g, paths in picks.items():
        drives = [
            move_seconds(layout, [q, *w.down]) + move_seconds(layout, [*w.up, part.home_q[g]])
            for w in paths
        ]
        seconds[g] = min(drives) + layout.cell_times.pick_s + risk_s(part.arm_grasps[g])
    return seconds


def take_seconds(
    part: PreparedPart, layout: CellLayout, q: FloatArray, site: RegraspSite
) -> FloatArray:
    """Return the cost of taking the part from its present holder, with each grasp (g,) [s].

    Parameters
    ----------
    part : prepared
    layout : the cell
    q : (6,) present joints of the arm
    site : the fixed gripper's grasp, or the table; inf for grasps that do not meet it
    """
    seconds = np.full(len(part.arm_grasps), np.inf)
    for g, path in site.paths.items():
        seconds[g] = (
            move_seconds(layout, [q, *path.retreat[::-1]])
            + move_seconds(layout, [*path.entry[::-1], part.home_q[g]])
            + layout.cell_times.receive_s
            + risk_s(part.arm_grasps[g])
        )
    return seconds


def regrasp_seconds(part: PreparedPart, layout: CellLayout, site: RegraspSite) -> FloatArray:
    """Return the cost of each regrasp (g, g) [s], from row to column, inf where there is none.

    Parameters
    ----------
    part : prepared
    layout : the cell
    site : site that holds the part in between: the fixed gripper, or the table
    """
    count = len(part.arm_grasps)
    seconds = np.full((count, count), np.inf)
    members = np.array(sorted(site.paths))
    if len(members) == 0:
        return seconds
    paths = [site.paths[int(g)] for g in members]
    entry = np.stack([w.entry[0] for w in paths])
    away = np.stack([w.retreat[-1] for w in paths])
    straight = np.array(
        [
            segment_seconds(layout, w.entry[0], w.entry[-1])
            + segment_seconds(layout, w.retreat[0], w.retreat[-1])
            for w in paths
        ]
    )
    cell_times = layout.cell_times
    reach = segment_seconds(layout, part.home_q[members], entry)
    between = segment_seconds(layout, away[:, None], away[None])
    own = np.array([risk_s(part.arm_grasps[int(g)]) for g in members])
    if site.fixed_grasp_index >= 0:
        # either gripper closes once and lets go once
        fixed = cell_times.hand_off_s + risk_s(part.fixed_grasps[site.fixed_grasp_index])
    else:
        fixed = cell_times.put_s + cell_times.relook_s + cell_times.pick_s
    total = (reach + straight)[:, None] + between + (straight + reach + own)[None] + fixed
    np.fill_diagonal(total, np.inf)
    seconds[np.ix_(members, members)] = total
    return seconds


def make_edge_costs(
    part: PreparedPart,
    layout: CellLayout,
    first_s: FloatArray,
    seen: BoolArray,
    squared: frozenset[int],
    opened: frozenset[int],
    avoid: frozenset[str],
) -> EdgeCosts:
    """Return the problem of showing everything, from grasps that can be had at `first_s` (g,).

    Parameters
    ----------
    part : prepared
    layout : the cell
    first_s : (g,) cost of having the part in each grasp [s], inf where that is impossible
    seen : (n,) samples that need not be shown again
    squared : ids of faces that need not be shown squarely again
    opened : ids of walls of bores through which no light need be shown again
    avoid : ids of grasps not to use
    """
    usable = np.array([g.id not in avoid for g in part.arm_grasps], dtype=bool)
    views = tuple(np.array(sorted(v), dtype=np.int64) for v in part.view_q)
    faces, squares = _squares(part, views)
    shows = tuple(
        np.hstack([part.shown[g][v], squares[g], part.shown_open[g][v]])
        if usable[g]
        else np.zeros((0, 0), dtype=bool)
        for g, v in enumerate(views)
    )
    bores = part.openings.faces
    count = len(seen) + len(faces) + len(bores)
    shows = tuple(s if s.shape[1] == count else np.zeros((0, count), dtype=bool) for s in shows)
    sites = regrasp_sites_of(part, avoid)
    table = [regrasp_seconds(part, layout, s) for s in sites]
    site_s = np.stack(table) if table else np.full((0, len(part.home_q), len(part.home_q)), np.inf)
    regrasp_s = site_s.min(axis=0, initial=np.inf)
    regrasp_s[~usable], regrasp_s[:, ~usable] = np.inf, np.inf
    cost = view_seconds(layout)
    problem = Problem(
        shows=shows,
        weights=np.concatenate([part.weights, np.zeros(len(faces) + len(bores))]),
        view_s=tuple(np.full(len(s), cost) for s in shows),
        first_s=np.where(usable, first_s, np.inf),
        regrasp_s=regrasp_s,
        last_s=np.array(
            [FINISH_S + UNSTEADY_S * (not stands_steadily(part, g)) for g in part.arm_grasps]
        ),
        seen=np.concatenate([seen, np.isin(faces, list(squared)), np.isin(bores, list(opened))]),
    )
    return EdgeCosts(problem, views, faces, sites, site_s)


def worthwhile(
    costs: EdgeCosts, part: PreparedPart, layout: CellLayout, solution: GraspSequence
) -> BoolArray:
    """Return the elements (m,) that are worth the seconds of showing them.

    Of the grasps of a solution those are kept, in its order, whose views show so much that the rest
    of the seconds buys it: a view of usual length `PlanOptions.least_gain` of the surface, a
    regrasp as many times that as it takes longer. No face or bore loses the share that a PASS
    needs for want of a grasp, and no bore for want of a view. Elements already seen are among those
    returned.

    Parameters
    ----------
    costs : the problem, and what its numbers stand for
    part : prepared
    layout : the cell
    solution : of the problem; it shows all that can be shown
    """
    problem, usual_s = costs.problem, view_seconds(layout)
    needs = _Needs.of_part(part, len(costs.square_faces))
    surface = worth_of(part.samples, part.options)
    squares = [surface[part.samples.face_ids == face].sum() for face in costs.square_faces]
    openings = 1.0 / (PORTION * needs.least * needs.whole[needs.of[needs.is_bore[needs.of]]])
    worth = np.concatenate([surface, SQUARE_WORTH * np.array(squares), openings])
    best: tuple[int, float, BoolArray] | None = None
    grasps = solution.grasps
    for mask in range(1, 2 ** len(grasps)):
        some = [g for k, g in enumerate(grasps) if mask >> k & 1]
        legs = sum(float(problem.regrasp_s[a, b]) for a, b in pairwise(some))
        seconds = float(problem.first_s[some[0]]) + legs + float(problem.last_s[some[-1]])
        if not np.isfinite(seconds):
            continue
        kept, view_s = _by_views(problem, worth, needs, some, usual_s)
        enough = int(needs.are_met(kept).sum())
        value = float(worth[kept & ~problem.seen].sum()) - (seconds + view_s) / usual_s
        if best is None or (enough, value) > best[:2]:
            best = enough, value, kept
    assert best is not None
    return best[2]


@dataclass(frozen=True, eq=False, slots=True)
class _Needs:
    """Of which faces and bores a PASS needs a share, and what each element adds to it.

    Attributes
    ----------
    of : (m,) number below n of the face or bore that each element belongs to
    size : (m,) of each element: its area, or 1 for one of a bore
    whole : (n,) of each face or bore: the sum of these
    least : share that a PASS needs more of
    is_bore : (n,) True for bores, which nothing but the light proves; faces have edges, too
    """

    of: IntArray
    size: FloatArray
    whole: FloatArray
    least: float
    is_bore: BoolArray

    @classmethod
    def of_part(cls, part: PreparedPart, square_count: int) -> _Needs:
        """Return the needs of a part of which some faces are to be shown squarely.

        Parameters
        ----------
        part : prepared
        square_count : number of elements between those of surface and bores, which no PASS needs
        """
        count = len(part.solid.faces)
        bores = part.openings.faces + count + 1
        of = np.concatenate([part.samples.face_ids, np.full(square_count, count), bores])
        size = np.concatenate([part.samples.areas_mm2, np.zeros(square_count), np.ones(len(bores))])
        whole = np.bincount(of, size).astype(np.float64)
        return cls(of, size, whole, part.options.face_share, np.arange(len(whole)) > count)

    def are_met(self, shown: BoolArray) -> BoolArray:
        """Return a mask (n,) of the faces and bores of which elements (m,) show enough."""
        return np.asarray(np.bincount(self.of, self.size * shown) > self.least * self.whole)

    def left(self, shown: BoolArray, able: BoolArray) -> FloatArray:
        """Return what each element (m,) adds to bores that are short, and could be shown enough of.

        Parameters
        ----------
        shown, able : (m,) elements that are shown, and that can be
        """
        short = self.is_bore & self.are_met(able) & ~self.are_met(shown)
        (more,) = np.nonzero(~shown & short[self.of])
        out = np.zeros(len(shown))
        out[more] = self.size[more] / self.whole[self.of[more]]
        return out


def _by_views(
    problem: Problem, worth: FloatArray, needs: _Needs, grasps: Sequence[int], usual_s: float
) -> tuple[BoolArray, float]:
    """Return the elements (m,) that worthwhile views under some grasps show, and their seconds.

    The views are taken greedily, the largest worth a second first, then those that show more of
    bores that are short of a PASS.

    Parameters
    ----------
    problem : with the views of each grasp
    worth : (m,) worth of each element, in views of usual length
    needs : of a PASS
    grasps : numbers of grasps; repeats count once
    usual_s : length of such a view [s]
    """
    some = list(dict.fromkeys(grasps))
    rows = np.vstack([problem.shows[g] for g in some]).astype(np.float32)
    views = np.concatenate([problem.view_s[g] for g in some]) / usual_s
    kept, taken = problem.seen.copy(), 0.0
    able = kept | (rows > 0.0).any(axis=0)
    while len(rows):
        gain = rows @ np.where(kept, 0.0, worth).astype(np.float32) / views
        best = int(np.argmax(gain))
        if not gain[best] >= 1.0:
            gain = rows @ needs.left(kept, able).astype(np.float32) / views
            best = int(np.argmax(gain))
            if not gain[best] > 0.0:
                break
        kept |= rows[best] > 0.0
        taken += float(views[best])
    return kept, taken * usual_s


def _squares(
    part: PreparedPart, views: Sequence[IntArray]
) -> tuple[IntArray, tuple[BoolArray, ...]]:
    """Return the main planar faces (f,), and per grasp a mask of its square views of each."""
    square_to = part.directions.square_to
    main = [
        (v, int(f))
        for v, f in enumerate(square_to)
        if f >= 0 and part.solid.faces[f].kind == "plane"
    ]
    tables = [np.zeros((len(v), len(main)), dtype=bool) for v in views]
    for column, (v, face) in enumerate(main):
        of_face = (part.samples.face_ids == face) & part.visible[v]
        if not of_face.any():
            continue
        for g, rows in enumerate(views):
            (row,) = np.nonzero(rows == v)
            if len(row):
                share = float(part.shown[g][v][of_face].mean())
                tables[g][row[0], column] = share >= part.options.square_share
    return np.array([f for _, f in main], dtype=np.int64), tuple(tables)
