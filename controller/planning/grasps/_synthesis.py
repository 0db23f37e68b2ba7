"""Grasp synthesis for a parallel jaw: seeds, one evaluator, friction and pose errors.

Each stage is cheaper than the next and counts its survivors and the best value, so that a part
which cannot be held is refused with the number that fails (planning-facts.md 2.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil

import numpy as np

from controller.arrays import BoolArray, FloatArray, IntArray
from controller.cad import Solid
from controller.imaging import RayCaster
from messages import joined, key, say

from ..model import TABLE_MARGIN_MM, Grasp, GraspRules, Holder, Jaw, NotGraspableError
from ._select import cover
from .clearance import PartTriangles, clear_of_part, lifts_off_table
from .contact import Contacts, least_load
from .judge import FilterStage, Judge, closed, score_of
from .robust import margins
from .seeds import (
    GraspCandidates,
    Seeds,
    approach_seems_free,
    axis_distance,
    candidates,
    from_above,
    needed_friction,
    open_gap,
    pre_open,
)

SORTING_SHARE = 0.8  # share of the required contact that coarse rays must find
BATCH_SIZE = 400
FEW_PICKS = 4  # picks of a stable pose; with fewer, the part is searched densely as it rests
THIN_SHARE = 1.5  # a part is thin whose rim offers less than this of the contact of two lines
GOLDEN = 0.6180339887498949


@dataclass(frozen=True, slots=True, eq=False)
class GraspProblem:
    """A part to be grasped, and the rules for a grasp of it by any gripper.

    Attributes
    ----------
    seeds : seeds of `find_seeds`
    caster : rays against the part's mesh
    downs : (k, 3) unit, the way down in the CAD frame, of each stable pose
    clearance_mm : from the table, beside the usual margin
    """

    solid: Solid
    seeds: Seeds
    caster: RayCaster
    downs: FloatArray
    rules: GraspRules
    clearance_mm: float = 0.0


@dataclass(frozen=True, slots=True)
class Synthesis:
    """Every grasp of a jaw on a part, and the number that each stage left."""

    grasps: tuple[Grasp, ...]
    stages: tuple[FilterStage, ...]


def synthesise_grasps(
    problem: GraspProblem,
    jaw: Jaw,
    holder: Holder,
    gravities: Sequence[FloatArray] | None = None,
) -> tuple[Grasp, ...]:
    """Return grasps of one gripper that hold the part, clear of it, from all round and from above.

    Parameters
    ----------
    problem, jaw, holder, gravities : as for `judge_grasps`

    Raises
    ------
    NotGraspableError : no grasp holds; it names the stage that left none, and the number that fails
    """
    found = judge_grasps(problem, jaw, holder, gravities)
    if not found.grasps:
        raise NotGraspableError(_refusal(problem, jaw, holder, found.stages))
    return found.grasps


def _refusal(problem: GraspProblem, jaw: Jaw, holder: Holder, stages: Sequence[FilterStage]) -> str:
    """Return a message that names the stage with no grasp left, and the figure that fails."""
    solid, rules = problem.solid, problem.rules.for_pads_of(jaw)
    last = next(s for s in stages if s.left == 0)
    name = say("{name}: the {holder} cannot hold it", name=solid.name, holder=holder)
    need, width = needed_friction(solid, problem.seeds, problem.caster)
    have = float(np.degrees(np.arctan(rules.friction)))
    if last.name == "grasps round seeds":
        widest = jaw.max_mm - rules.jaw_reserve_mm
        if need > have:
            return say(
                "{name}: widest opposed friction angle needed {need:.1f} deg, have "
                "{have:.1f}; fit pads with more friction, or fingers shaped for it",
                name=name,
                need=need,
                have=have,
            )
        return say(
            "{name}: no two opposed walls at most {widest:.0f} mm apart, the "
            "nearest are {width:.1f} mm apart; fit a wider jaw or other fingers",
            name=name,
            widest=widest,
            width=width,
        )
    tallies = joined("; ", (s.phrase for s in stages[: stages.index(last) + 1]))
    summary = say("grasps left by each requirement: {tallies}", tallies=tallies)
    if last.name == "little enough weight" or (
        last.name.endswith(key("strong enough")) and need <= have
    ):
        mass_kg = solid.volume_mm3 * rules.density_kg_mm3
        # but for leaning walls, what the weight uses goes with 1 / force
        force_n = ceil(jaw.force_n * last.best / last.limit)
        return say(
            "{name}, grasp strength: {mass_kg:.2f} kg between pads of "
            "{force_n:.0f} N and friction {friction:g} use {best:.2f} of the "
            "friction limit at best, {limit:g} is allowed; press with "
            "{needed_n} N or more, or fit pads with more friction; {summary}",
            name=name,
            mass_kg=mass_kg,
            force_n=jaw.force_n,
            friction=rules.friction,
            best=last.best,
            limit=last.limit,
            needed_n=force_n,
            summary=summary,
        )
    if need > have:
        return say(
            "{name}: its walls lean, opposed friction angle needed {need:.1f} "
            "deg, have {have:.1f}; fit pads with more friction, or fingers "
            "shaped for it; {summary}",
            name=name,
            need=need,
            have=have,
            summary=summary,
        )
    return say("{name}; {summary}; fit other fingers or pads", name=name, summary=summary)


def judge_grasps(
    problem: GraspProblem,
    jaw: Jaw,
    holder: Holder,
    gravities: Sequence[FloatArray] | None = None,
) -> Synthesis:
    """Return the grasps that `synthesise_grasps` keeps, and every stage's tally; may be empty.

    Parameters
    ----------
    problem : the part, and what a grasp must keep
    jaw : the gripper
    holder : gripper concerned; only the arm's takes parts from the table
    gravities : unit vectors (3,) in the TCP frame, of a gripper that does not turn; None: of the
        arm's
    """
    solid, seeds, downs = problem.solid, problem.seeds, problem.downs
    rules = problem.rules.for_pads_of(jaw)
    judge = Judge(solid, problem.caster, jaw, rules, gravities)
    # only the arm takes parts from the table
    tables = downs if holder == "arm" else downs[:0]
    tried = candidates(solid, seeds, jaw, downs, rules)
    judge.tally.count(key("grasps round seeds"), len(tried.T))
    lever = axis_distance(tried.T, solid.centroid_mm, jaw)
    bound = least_load(
        lever if gravities is None else 0.0 * lever,  # a still jaw may have the lever hang plumb
        judge.weight_n,
        jaw.force_n,
        judge.coarse,
        rules,
    )
    tried = tried.take(
        judge.tally.require(
            key("little enough weight"),
            bound,
            rules.max_load,
            key(" of the friction limit"),
            most=True,
        )
    )
    able, score, area = _sorted_out(
        judge, tried, seeds, _picks(judge, tried, tables), rules.min_line_contact_mm2
    )
    picks = _picks(judge, able, tables)
    firm = judge.tally.require(
        key("enough contact off the table"), area, SORTING_SHARE * rules.min_contact_mm2, " mm2"
    )
    rows = _cover_of(
        np.flatnonzero(firm), able, score, picks, rules.fine_count, 2 * rules.pick_count
    )
    found = _measured(judge, able, rows)
    # a pose that few grasps take from above: there the table gives height and tilt, and what
    # contact the rim of a flat part offers is all there is
    scarce = found.picks(judge, tables).sum(axis=1) < rules.pick_count // 2
    for pose in np.flatnonzero(scarce):
        fresh = np.setdiff1d(np.flatnonzero(picks[pose]), found.numbers)
        rows = _cover_of(fresh, able, score, picks[:0], rules.fine_count // 4, 0)
        found = found.joined(_measured(judge, able, rows, down=tables[pose]))
    left = found.picks(judge, tables).sum(axis=1)
    for pose in np.flatnonzero(left < FEW_PICKS):
        found = found.joined(_from_above(judge, problem, tables[pose]))
    score = score_of(found.contacts) * (1.0 - found.load) * found.margin
    chosen = cover(
        found.contacts.T, score, found.picks(judge, tables), rules.keep_count, rules.pick_count
    )
    wide = pre_open(found.contacts.opening, found.inner, jaw, rules)
    grasps = tuple(
        Grasp(
            id=f"{holder[0].upper()}{number}",
            T_part_tcp=found.contacts.T[k],
            opening_mm=float(found.contacts.opening[k]),
            pre_open_mm=float(wide[k]),
            contact_mm2=float(found.contacts.area[k]),
            load=float(found.load[k]),
            score=float(score[k]),
            holder=holder,
            margin=float(found.margin[k]),
            is_inner=bool(found.inner[k]),
            on_table=bool(found.on_table[k]),
        )
        for number, k in enumerate(chosen)
    )
    return Synthesis(grasps, judge.tally.stages)


def _from_above(judge: Judge, problem: GraspProblem, down: FloatArray) -> _Measured:
    """Return grasps straight down in one stable pose, from a dense search round the part.

    The rim of a thin plate offers less than the contact that a grasp needs elsewhere.
    """
    rules, jaw = judge.rules, judge.jaw
    rim_mm = float(np.ptp(judge.hull @ down)) - TABLE_MARGIN_MM - problem.clearance_mm
    is_thin = rim_mm * jaw.finger_width_mm < THIN_SHARE * rules.min_line_contact_mm2
    least_mm2 = rules.min_rim_contact_mm2 if is_thin else rules.min_line_contact_mm2
    tried = from_above(problem.solid, problem.caster, down, jaw, rules, problem.clearance_mm)
    tried = tried.take(_picks(judge, tried, down[None])[0])
    none = _picks(judge, tried, np.zeros((0, 3)))
    able, score, _ = _sorted_out(judge, tried, problem.seeds, none, least_mm2)
    every = np.arange(len(able.T))
    rows = _cover_of(every, able, score, none[:, every], rules.fine_count // 4, 0)
    return _measured(judge, able, rows, down, least_mm2)


@dataclass(frozen=True, slots=True, eq=False)
class _Measured:
    """Grasps (n) that hold by fine rays and at wrong poses; `numbers` are the candidates'."""

    numbers: IntArray
    contacts: Contacts
    inner: BoolArray
    load: FloatArray
    margin: FloatArray
    on_table: BoolArray

    def joined(self, other: _Measured) -> _Measured:
        return _Measured(
            np.concatenate([self.numbers, other.numbers]),
            self.contacts.joined(other.contacts),
            np.concatenate([self.inner, other.inner]),
            np.concatenate([self.load, other.load]),
            np.concatenate([self.margin, other.margin]),
            np.concatenate([self.on_table, other.on_table]),
        )

    def picks(self, judge: Judge, downs: FloatArray) -> BoolArray:
        taken = GraspCandidates(self.contacts.T, self.contacts.opening, self.inner)
        return _picks(judge, taken, downs)


def _cover_of(
    members: IntArray,
    able: GraspCandidates,
    score: FloatArray,
    picks: BoolArray,
    count: int,
    per_pose: int,
) -> IntArray:
    chosen = cover(able.T[members], score[members], picks[:, members], count, per_pose)
    return np.asarray(members[chosen], dtype=np.int64)


def _sorted_out(
    judge: Judge,
    tried: GraspCandidates,
    seeds: Seeds,
    picks: BoolArray,
    contact_mm2: float,
) -> tuple[GraspCandidates, FloatArray, FloatArray]:
    """Return the candidates that hold by coarse rays and clear the part, scores and contacts.

    In batches that take from every pose's picks and from all in turn, until there are
    `enough_count`: a part that is easy to hold is done soon, for a hard one every candidate is
    tried. `contact_mm2` is the least of either pad.
    """
    rules, jaw = judge.rules, judge.jaw
    order = _in_turn([*picks, np.ones(len(tried.T), dtype=bool)])
    part = PartTriangles(judge.solid)
    kept, values, count = [tried.take(order[:0])], [np.zeros((2, 0))], 0
    for rows in (order[k : k + BATCH_SIZE] for k in range(0, len(order), BATCH_SIZE)):
        batch = tried.take(rows)
        judge.tally.count("tried", len(rows))
        batch = batch.take(approach_seems_free(batch, seeds, jaw, rules))
        judge.tally.count(key("approach seems free"), len(batch.T))
        found = judge.close(batch.T, batch.gap, batch.inner, judge.coarse)
        good = judge.sort_out(found, batch.inner, judge.coarse, contact_mm2)
        shut = closed(batch, found, good)
        clear = clear_of_part(part, shut.T, shut.gap, shut.inner, jaw, rules)
        judge.tally.count(key("clear of the part"), int(clear.sum()))
        kept.append(shut.take(clear))
        values.append(np.stack([score_of(found)[good][clear], found.area[good][clear]]))
        count += int((values[-1][1] >= SORTING_SHARE * rules.min_contact_mm2).sum())
        if count >= rules.enough_count:
            break
    return (
        GraspCandidates(
            np.concatenate([k.T for k in kept]),
            np.concatenate([k.gap for k in kept]),
            np.concatenate([k.inner for k in kept]),
        ),
        *np.hstack(values),
    )


def _in_turn(groups: Sequence[BoolArray]) -> IntArray:
    """Return all numbers once, from each group in turn, spread within a group."""
    ranked: list[IntArray] = []
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


def _measured(
    judge: Judge,
    able: GraspCandidates,
    numbers: IntArray,
    down: FloatArray | None = None,
    table_mm2: float | None = None,
) -> _Measured:
    """Return the candidates of those numbered that hold by fine rays and at wrong poses.

    For a part on a table (`down`, (3,) in the part frame) only position and heading may be wrong,
    and less contact is enough: `table_mm2`, None for the contact of two lines.
    """
    rules, table = judge.rules, down is not None
    prefix = key("on the table: ") if table else key("measured finely: ")
    line_mm2 = rules.min_line_contact_mm2 if table_mm2 is None else table_mm2
    contact_mm2 = line_mm2 if table else rules.min_contact_mm2
    tried = able.take(numbers)
    found = judge.close(tried.T, tried.gap, tried.inner, judge.fine)
    rows = judge.sort_out(found, tried.inner, judge.fine, contact_mm2, prefix)
    found, inner = found.take(rows), tried.inner[rows]
    margin = margins(judge, found, inner, down, line_mm2)
    sure = np.flatnonzero(
        judge.tally.require(
            say("{prefix}sure", prefix=prefix), margin, rules.min_margin, key(" of wrong poses")
        )
    )
    found, inner = found.take(sure), inner[sure]
    load = judge.load(found, inner, judge.fine)
    return _Measured(
        numbers[rows[sure]], found.bare(), inner, load, margin[sure], np.full(len(sure), table)
    )


def _picks(judge: Judge, taken: GraspCandidates, downs: FloatArray) -> BoolArray:
    """Return a mask (k, n) of the candidates that take the part from above in each stable pose."""
    wide = open_gap(taken.gap, taken.inner, judge.jaw, judge.rules)
    picks = [lifts_off_table(taken.T, wide, judge.jaw, judge.hull, down) for down in downs]
    return np.array(picks, dtype=bool).reshape(len(downs), len(taken.T))
