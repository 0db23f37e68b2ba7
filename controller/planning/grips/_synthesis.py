"""Where a parallel jaw can hold a part: seeds, one evaluator, what friction and pose errors leave.

Each stage is cheaper than the next and counts what it leaves and how near the best came, so that
a part which cannot be held is refused with the number that fails (planning.md 2.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controller.cad import RayCaster, Solid

from ..boxes import BoolArray
from ..errors import NotGraspableError
from ..grip import Grip, GripRules, Holder
from ..layout import FloatArray, IntArray, Jaw
from ._candidates import (
    Candidates,
    axis_distance,
    candidates,
    open_gap,
    pre_open,
    way_seems_free,
)
from ._clearance import PartTriangles, clear_of_part, lifts_off_table
from ._judge import Judge, Stage, closed, score_of
from ._pads import Contacts
from ._robust import margins
from ._seeds import Seeds, needed_friction
from ._select import cover
from ._strength import least_load

SORTING_SHARE = 0.8  # of the contact asked for, that coarse rays must find
BATCH_N = 400
GOLDEN = 0.6180339887498949


@dataclass(frozen=True, slots=True)
class Synthesis:
    """Every grip of a jaw on a part, and what each stage left."""

    grips: tuple[Grip, ...]
    stages: tuple[Stage, ...]


def synthesise_grips(
    solid: Solid,
    seeds: Seeds,
    caster: RayCaster,
    jaw: Jaw,
    holder: Holder,
    downs: FloatArray,
    rules: GripRules,
    gravities: Sequence[FloatArray] | None = None,
) -> tuple[Grip, ...]:
    """Return grips of one jaw that hold the part, clear of it, from all round and from above.

    Parameters
    ----------
    seeds : of `find_seeds`
    downs : (k, 3) which way is down, in the part frame, in each stable pose
    gravities : unit vectors (3,) in the tip frame, of a jaw that does not turn; None: of the arm's

    Raises
    ------
    NotGraspableError : no grip holds; says which stage left none, and the number that failed
    """
    found = judge_grips(solid, seeds, caster, jaw, holder, downs, rules, gravities)
    if not found.grips:
        raise NotGraspableError(_refusal(solid, seeds, caster, jaw, holder, rules, found.stages))
    return found.grips


def _refusal(
    solid: Solid,
    seeds: Seeds,
    caster: RayCaster,
    jaw: Jaw,
    holder: Holder,
    rules: GripRules,
    stages: Sequence[Stage],
) -> str:
    """Say which stage left no grip, with the number that fails."""
    last = next(s for s in stages if s.left == 0)
    name = f"{solid.name}: the {holder} cannot hold it"
    if last.name == "hands round seeds":
        need, width = needed_friction(solid, seeds, caster)
        have = float(np.degrees(np.arctan(rules.friction)))
        widest = jaw.max_mm - rules.jaw_reserve_mm
        if need > have:
            return (
                f"{name}: widest opposed friction angle needed {need:.1f} deg, have {have:.1f}; "
                "fit pads that grip better, or fingers shaped for it"
            )
        return (
            f"{name}: no two opposed walls at most {widest:.0f} mm apart, the nearest are "
            f"{width:.1f} mm apart; fit a wider jaw or other fingers"
        )
    tallies = "; ".join(s.phrase for s in stages[: stages.index(last) + 1])
    return f"{name}; grips left by each demand: {tallies}"


def judge_grips(
    solid: Solid,
    seeds: Seeds,
    caster: RayCaster,
    jaw: Jaw,
    holder: Holder,
    downs: FloatArray,
    rules: GripRules,
    gravities: Sequence[FloatArray] | None = None,
) -> Synthesis:
    """Return what `synthesise_grips` does, and the tally of every stage; none is no error."""
    judge = Judge(solid, caster, jaw, rules, gravities)
    # only the arm takes parts from the table
    tables = downs if holder == "arm" else downs[:0]
    tried = candidates(solid, seeds, jaw, downs, rules)
    judge.tally.count("hands round seeds", len(tried.T))
    bound = least_load(
        axis_distance(tried.T, solid.centroid_mm, jaw),
        judge.weight_n,
        jaw.force_n,
        judge.coarse,
        rules,
    )
    tried = tried.take(
        judge.tally.ask(
            "short enough lever", bound, rules.max_load, " of the friction limit", most=True
        )
    )
    able, score = _sorted_out(judge, tried, seeds, _picks(solid, tried, jaw, tables, rules))
    picks = _picks(solid, able, jaw, tables, rules)
    rows = np.array(cover(able.T, score, picks, rules.fine_n, 2 * rules.picks_n), dtype=np.int64)
    found, margin, inner = _measured(judge, able.take(rows))
    picks = _picks(solid, Candidates(found.T, found.opening, inner), jaw, tables, rules)
    load = judge.load(found, inner, judge.fine)
    score = score_of(found) * (1.0 - load) * margin
    wide = pre_open(found.opening, inner, jaw, rules)
    grips = tuple(
        Grip(
            id=f"{holder[0].upper()}{number}",
            T_part_hand=found.T[k],
            opening_mm=float(found.opening[k]),
            pre_open_mm=float(wide[k]),
            contact_mm2=float(found.area[k]),
            load=float(load[k]),
            score=float(score[k]),
            holder=holder,
            margin=float(margin[k]),
            is_inner=bool(inner[k]),
        )
        for number, k in enumerate(cover(found.T, score, picks, rules.keep_n, rules.picks_n))
    )
    return Synthesis(grips, judge.tally.stages)


def _sorted_out(
    judge: Judge, tried: Candidates, seeds: Seeds, picks: BoolArray
) -> tuple[Candidates, FloatArray]:
    """Return the candidates that hold by coarse rays and come in clear of the part; their scores.

    In batches that take from every pose's picks and from all in turn, until there are `enough_n`:
    a part that is easy to hold is done soon, a hard one is looked at to the last candidate.
    """
    rules, jaw = judge.rules, judge.jaw
    order = _in_turn([*picks, np.ones(len(tried.T), dtype=bool)])
    part = PartTriangles(judge.solid)
    kept, scores, count = [tried.take(order[:0])], [np.zeros(0)], 0
    for rows in (order[k : k + BATCH_N] for k in range(0, len(order), BATCH_N)):
        batch = tried.take(rows)
        judge.tally.count("tried", len(rows))
        batch = batch.take(way_seems_free(batch, seeds, jaw, rules))
        judge.tally.count("way in seems free", len(batch.T))
        found = judge.close(batch.T, batch.gap, batch.inner, judge.coarse)
        good = judge.sort_out(found, batch.inner, judge.coarse, SORTING_SHARE)
        shut = closed(batch, found, good)
        clear = clear_of_part(part, shut.T, shut.gap, shut.inner, jaw, rules)
        judge.tally.count("clear of the part", int(clear.sum()))
        kept.append(shut.take(clear))
        scores.append(score_of(found)[good][clear])
        count += int(clear.sum())
        if count >= rules.enough_n:
            break
    return (
        Candidates(
            np.concatenate([k.T for k in kept]),
            np.concatenate([k.gap for k in kept]),
            np.concatenate([k.inner for k in kept]),
        ),
        np.concatenate(scores),
    )


def _in_turn(groups: Sequence[BoolArray]) -> IntArray:
    """Return all numbers once, taken from each group in turn; within a group from all over it."""
    ranked = []
    for group in groups:
        members = np.flatnonzero(group)
        if len(members):
            # multiples of the golden section leave no stretch of the members out for long
            spot = np.argsort((np.arange(len(members)) * GOLDEN) % 1.0, kind="stable")
            rank = np.empty(len(members), dtype=np.int64)
            rank[spot] = np.arange(len(members))
            ranked.append(np.column_stack([rank, np.full(len(members), len(ranked)), members]))
    if not ranked:
        return np.zeros(0, dtype=np.int64)
    table = np.vstack(ranked)
    members = table[np.lexsort((table[:, 1], table[:, 0])), 2]
    _, first = np.unique(members, return_index=True)
    return np.asarray(members[np.sort(first)])


def _measured(judge: Judge, able: Candidates) -> tuple[Contacts, FloatArray, BoolArray]:
    """Return what holds by fine rays and at wrong poses, the margins, and which are inner."""
    rules = judge.rules
    found = judge.close(able.T, able.gap, able.inner, judge.fine)
    rows = judge.sort_out(found, able.inner, judge.fine, 1.0, "measured finely: ")
    found, inner = found.take(rows), able.inner[rows]
    margin = margins(judge, found, inner)
    sure = np.flatnonzero(
        judge.tally.ask("sure of a wrong pose", margin, rules.min_margin, " of the poses")
    )
    return found.take(sure), margin[sure], inner[sure]


def _picks(
    solid: Solid, hands: Candidates, jaw: Jaw, downs: FloatArray, rules: GripRules
) -> BoolArray:
    """Tell for each way the part lies which hands take it from above (k, n)."""
    hull = np.asarray(solid.mesh.convex_hull.vertices)
    wide = open_gap(hands.gap, hands.inner, jaw, rules)
    picks = [lifts_off_table(hands.T, wide, jaw, hull, down) for down in downs]
    return np.array(picks, dtype=bool).reshape(len(downs), len(hands.T))
