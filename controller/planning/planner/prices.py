"""What it costs to get the part into a grip, from grip to grip, and what each grip can show.

Prices are seconds between hubs (one configuration per grip, in the midst of its views) plus the
seconds a failure would cost times how likely it is (planning-facts.md 1.3, "Cost").
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from controller.arrays import BoolArray, FloatArray, IntArray

from ..model import CellLayout, Grip, HandOff, PreparedPart
from ..motion import leg_seconds, move_seconds
from ..search import Problem
from ..transfers import PickWay

# a failed grip is looked for, seen anew and taken again: about a minute
RECOVERY_S = 60.0
LEAST_SURE = 0.9  # of a grip whose score is 0; a score of 1 does not fail
TRAVEL_S = 2.0  # from one view to the next, on the average; their order is settled afterwards
FINISH_S = 10.0  # sorting; much the same from every grip


@dataclass(frozen=True, slots=True, eq=False)
class Support:
    """What holds the part while the hand changes its grip.

    Attributes
    ----------
    fixture : index of the fixture grip, -1 on the table; rest : index of the place, -1 if none
    ways : arm grip -> how it meets the support
    """

    fixture: int
    rest: int
    ways: Mapping[int, HandOff]


SQUARE_WORTH = 0.3  # a main face seen squarely is worth this much of its area on top


@dataclass(frozen=True, slots=True, eq=False)
class Prices:
    """A search problem and what its numbers stand for.

    Attributes
    ----------
    views : per arm grip, the direction of each row of `problem.shows`
    square_faces : (f,) the faces whose square view is an element after the samples
    support_s : (k, g, g) price of each hop over each support; supports : (k,)
    """

    problem: Problem
    views: tuple[IntArray, ...]
    square_faces: IntArray
    supports: tuple[Support, ...]
    support_s: FloatArray


def risk_s(grip: Grip) -> float:
    """Return what the chance that a grip fails is worth [s]."""
    return RECOVERY_S * (1.0 - LEAST_SURE) * (1.0 - grip.score)


def supports_of(part: PreparedPart, avoid: frozenset[str]) -> tuple[Support, ...]:
    """Return the fixture's grips and the places on the table, but for those to be avoided."""
    held = [
        Support(f, -1, ways)
        for f, ways in enumerate(part.hand_offs)
        if ways and part.fixture_grips[f].id not in avoid
    ]
    return (*held, *(Support(-1, r, ways) for r, ways in enumerate(part.set_downs) if ways))


def first_seconds(
    part: PreparedPart,
    layout: CellLayout,
    q: FloatArray,
    picks: Mapping[int, Sequence[PickWay]],
) -> FloatArray:
    """Return the cost of taking the part off the table with each grasp (g,) [s], inf if impossible.

    Parameters
    ----------
    part : prepared
    layout : the cell
    q : (6,) where the arm stands
    picks : of each grasp that can, the ways to take the part; at least one
    """
    seconds = np.full(len(part.arm_grips), np.inf)
    for g, ways in picks.items():
        drives = [
            move_seconds(layout, [q, *w.down]) + move_seconds(layout, [*w.up, part.hub[g]])
            for w in ways
        ]
        seconds[g] = min(drives) + layout.pace.grip_s + risk_s(part.arm_grips[g])
    return seconds


def take_seconds(
    part: PreparedPart, layout: CellLayout, q: FloatArray, support: Support
) -> FloatArray:
    """Return the cost of taking the part from what holds it now, with each grasp (g,) [s].

    Parameters
    ----------
    part : prepared
    layout : the cell
    q : (6,) where the arm stands
    support : the fixed gripper's grasp, or the table; inf for grasps that do not meet it
    """
    seconds = np.full(len(part.arm_grips), np.inf)
    for g, way in support.ways.items():
        seconds[g] = (
            move_seconds(layout, [q, *way.retreat[::-1]])
            + move_seconds(layout, [*way.entry[::-1], part.hub[g]])
            + layout.pace.take_back_s
            + risk_s(part.arm_grips[g])
        )
    return seconds


def hop_seconds(part: PreparedPart, layout: CellLayout, support: Support) -> FloatArray:
    """Return the cost of each regrasp (g, g) [s], from row to column, inf where there is none.

    Parameters
    ----------
    part : prepared
    layout : the cell
    support : what holds the part in between: the fixed gripper, or the table
    """
    count = len(part.arm_grips)
    seconds = np.full((count, count), np.inf)
    members = np.array(sorted(support.ways))
    if len(members) == 0:
        return seconds
    ways = [support.ways[int(g)] for g in members]
    entry = np.stack([w.entry[0] for w in ways])
    away = np.stack([w.retreat[-1] for w in ways])
    straight = np.array(
        [
            leg_seconds(layout, w.entry[0], w.entry[-1])
            + leg_seconds(layout, w.retreat[0], w.retreat[-1])
            for w in ways
        ]
    )
    pace = layout.pace
    reach = leg_seconds(layout, part.hub[members], entry)
    between = leg_seconds(layout, away[:, None], away[None])
    own = np.array([risk_s(part.arm_grips[int(g)]) for g in members])
    if support.fixture >= 0:
        # either hand closes once and lets go once
        fixed = pace.hand_off_s + risk_s(part.fixture_grips[support.fixture])
    else:
        fixed = pace.release_s + pace.relook_s + pace.grip_s
    total = (reach + straight)[:, None] + between + (straight + reach + own)[None] + fixed
    np.fill_diagonal(total, np.inf)
    seconds[np.ix_(members, members)] = total
    return seconds


def make_prices(
    part: PreparedPart,
    layout: CellLayout,
    first_s: FloatArray,
    seen: BoolArray,
    squared: frozenset[int],
    avoid: frozenset[str],
) -> Prices:
    """Return the problem of showing everything, from grips that can be had at `first_s` (g,).

    Parameters
    ----------
    part : prepared
    layout : the cell
    first_s : (g,) what having the part in each grasp costs [s], inf where it cannot be had
    seen : (n,) samples that need not be shown again
    squared : ids of faces that need not be shown squarely again
    avoid : ids of grips not to use
    """
    usable = np.array([g.id not in avoid for g in part.arm_grips])
    views = tuple(np.array(sorted(v), dtype=np.int64) for v in part.view_q)
    faces, squares = _squares(part, views)
    shows = tuple(
        np.hstack([part.shown_by(g)[v], squares[g]]) if usable[g] else np.zeros((0, 0), dtype=bool)
        for g, v in enumerate(views)
    )
    count = len(seen) + len(faces)
    shows = tuple(s if s.shape[1] == count else np.zeros((0, count), dtype=bool) for s in shows)
    supports = supports_of(part, avoid)
    table = [hop_seconds(part, layout, s) for s in supports]
    support_s = np.stack(table) if table else np.full((0, len(part.hub), len(part.hub)), np.inf)
    hop_s = support_s.min(axis=0, initial=np.inf)
    hop_s[~usable], hop_s[:, ~usable] = np.inf, np.inf
    price = layout.pace.look_s + TRAVEL_S
    problem = Problem(
        shows=shows,
        weights=np.concatenate([part.weights, np.zeros(len(faces))]),
        view_s=tuple(np.full(len(s), price) for s in shows),
        first_s=np.where(usable, first_s, np.inf),
        hop_s=hop_s,
        last_s=np.full(len(part.hub), FINISH_S),
        seen=np.concatenate([seen, [int(f) in squared for f in faces]]),
    )
    return Prices(problem, views, faces, supports, support_s)


def worthwhile(prices: Prices, part: PreparedPart, grips: Sequence[int]) -> BoolArray:
    """Return the elements (m,) that views under some grasps show before they add too little.

    The views are taken greedily, what adds most first, down to `PlanOptions.least_gain`. Elements
    already seen are among them.

    Parameters
    ----------
    prices : the problem, and what its numbers stand for
    part : prepared
    grips : numbers of grasps; repeats count once
    """
    problem = prices.problem
    worth = problem.weights.copy()
    count = len(part.samples.points_mm)
    for k, face in enumerate(prices.square_faces):
        worth[count + k] = SQUARE_WORTH * part.weights[part.samples.face_ids == face].sum()
    rows = np.vstack([problem.shows[g] for g in dict.fromkeys(grips)]).astype(np.float32)
    kept = problem.seen.copy()
    while len(rows):
        gain = rows @ np.where(kept, 0.0, worth).astype(np.float32)
        best = int(np.argmax(gain))
        if gain[best] < part.options.least_gain:
            break
        kept |= rows[best] > 0.0
    return kept


def _squares(
    part: PreparedPart, views: Sequence[IntArray]
) -> tuple[IntArray, tuple[BoolArray, ...]]:
    """Return the main planar faces (f,), and per grip which of its views shows which squarely."""
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
                share = float(part.shown_by(g)[v][of_face].mean())
                tables[g][row[0], column] = share >= part.options.square_share
    return np.array([f for _, f in main], dtype=np.int64), tuple(tables)
