"""A plan that begins with the view which tells what is in the hand.

Recognition may leave a part in doubt with a mirror twin or with a pose that looks alike from above.
The part is taken with a grip that holds whichever it is; the cheapest view that parts the
candidates comes first, and the plan goes on by its answer: for the part that was planned for it
just goes on, for another reading of it a new plan starts from the hand, and another part is put by
(ADR 12).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from controller.arrays import BoolArray, FloatArray, Grey
from controller.cad import Solid
from controller.imaging import RayCaster, inverse_pose

from ..doubt import (
    DoubtRules,
    Settling,
    Told,
    apart,
    compare,
    edges_shown,
    measured_picture,
    model_of,
    offered_views,
    predict_view,
    separating_views,
    tell_apart,
)
from ..model import (
    Candidate,
    CellLayout,
    Doubt,
    Grip,
    InArm,
    Jaw,
    NoPlanError,
    OnTable,
    Plan,
    PreparedPart,
    Present,
    Step,
)
from ..motion import Scene, connect, leg_seconds, move_seconds, shown_pose
from ..transfers import PickWay, pick_ways
from .build import Build, Builder, RefutedError
from .planner import plan_from

GRIPS_N = 6  # that hold every candidate, tried for a view that tells
SAME_WIDTH_MM = 1.0  # jaws this alike could not tell what they hold
LEAST_SHARE = 0.5  # of the pads' contact on the part planned for, that the others must give too
PAD_STEP_MM = 2.0
PAD_GIVES_MM = 0.4


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """What the part may be as well: which solid, and T_world_part (4, 4) if it is that."""

    name: str
    solid: Solid
    T_world_part: FloatArray


def plan_in_doubt(
    part: PreparedPart,
    layout: CellLayout,
    start: OnTable,
    others: Sequence[Reading],
    *,
    seen: BoolArray | None = None,
    avoid: frozenset[str] = frozenset(),
    rng_seed: int = 0,
) -> Plan:
    """Return a plan whose first view parts the readings of what lies on the table.

    Its `Present.doubt` says between what; what follows holds if it is the part planned for. Where
    no view can tell because all readings are of one part that looks the same whichever it is,
    the plan is one without doubt.

    Parameters
    ----------
    part : prepared for this cell: the reading that is planned for
    layout : the cell
    start : where it lies, read as that part
    others : what it may be beside the part; seen, avoid : as `plan_from`
    rng_seed : of the random trees; the same one gives the same plan

    Raises
    ------
    NoPlanError : as `plan_from`, or no view that can be had tells the readings apart
    """
    failure: NoPlanError | None = None
    alike: Settling | None = None
    for way in _common_ways(part, layout, start, others, avoid):
        try:
            found = _settled(part, layout, start, others, way, rng_seed)
        except NoPlanError as error:
            failure = failure or error
            continue
        if isinstance(found, Settling):
            alike = found
            if all(o.solid is part.solid for o in others):
                break  # one part that looks the same whichever way it lies
            continue
        opening, held = found
        rest = plan_from(part, layout, held, seen=seen, avoid=avoid, rng_seed=rng_seed)
        return replace(
            rest,
            steps=(*opening, *rest.steps),
            forecast_s=rest.forecast_s + sum(s.seconds for s in opening),
            grips=(held.grip, *rest.grips[1:]) if rest.grips else (held.grip,),
        )
    if alike is not None and all(o.solid is part.solid for o in others):
        return plan_from(part, layout, start, seen=seen, avoid=avoid, rng_seed=rng_seed)
    names = ", ".join(sorted({o.name for o in others}))
    if alike is not None and alike.unsettled:
        raise NoPlanError(
            f"{part.solid.name} may be {names} as well, and no view distinguishes them: "
            f"{alike.unsettled[0].reason}"
        )
    raise failure or NoPlanError(
        f"{part.solid.name} may be {names} as well, and no grasp from above holds both; "
        "turn it over"
    )


def told(
    doubt: Doubt,
    layout: CellLayout,
    q: FloatArray,
    opening_mm: float,
    backlit: Grey,
    lit: Sequence[Grey],
) -> Told:
    """Return which candidates the pictures of a `Present.doubt` leave.

    Parameters
    ----------
    doubt : of the view
    layout : the cell
    q : (6,) where the arm stood; opening_mm : of the hand
    backlit, lit : (h, w) pictures of the inspection camera, as `doubt.measured_picture` takes them
    """
    rules = DoubtRules()
    among = range(len(doubt.candidates))
    models = [model_of(c) for c in doubt.candidates]
    predicted = predict_view(doubt.candidates, models, layout, q, opening_mm, 1, rules)
    if predicted is None:
        return Told(tuple(among), np.full(len(doubt.candidates), np.inf))
    measured = measured_picture(predicted, backlit, lit)
    return tell_apart(
        compare(measured, predicted, doubt.light, among),
        apart(predicted, doubt.light),
        doubt.light,
        among,
        edges_shown(predicted) if doubt.light == "front" else None,
        rules,
    )


def _common_ways(
    part: PreparedPart,
    layout: CellLayout,
    start: OnTable,
    others: Sequence[Reading],
    avoid: frozenset[str],
) -> list[PickWay]:
    """Return ways to pick with grips that hold whichever it is, the quickest first."""
    q = layout.park_q if start.q is None else start.q
    ways = sorted(
        pick_ways(part, layout, start.T_world_part),
        key=lambda w: (float(leg_seconds(layout, q, w.down[0])), w.grip),
    )
    casters = [RayCaster(o.solid.mesh) for o in others]
    own = RayCaster(part.solid.mesh)
    found: dict[int, PickWay] = {}
    for way in ways:
        grip = part.arm_grips[way.grip]
        if way.grip in found or grip.id in avoid or grip.is_inner:
            continue
        T_world_hand = start.T_world_part @ grip.T_part_hand
        own_area, _ = _closed(own, grip.T_part_hand, layout.hand, grip.pre_open_mm)
        if all(
            _holds_too(
                c,
                inverse_pose(o.T_world_part) @ T_world_hand,
                layout,
                grip,
                own_area,
                min(SAME_WIDTH_MM, part.options.width_tolerance_mm),
            )
            for c, o in zip(casters, others, strict=True)
        ):
            found[way.grip] = way
        if len(found) == GRIPS_N:
            break
    return list(found.values())


def _holds_too(
    caster: RayCaster,
    T_part_hand: FloatArray,
    layout: CellLayout,
    grip: Grip,
    area: float,
    tolerance_mm: float,
) -> bool:
    """Return whether jaws that close on another solid there stop as they would on the part."""
    other, width = _closed(caster, T_part_hand, layout.hand, grip.pre_open_mm)
    return other >= LEAST_SHARE * area and abs(width - grip.opening_mm) <= tolerance_mm


def _closed(
    caster: RayCaster, T_part_hand: FloatArray, jaw: Jaw, from_mm: float
) -> tuple[float, float]:
    """Return the smaller contact [mm2] and the width [mm] of jaws that close from `from_mm`."""
    x = -np.arange(PAD_STEP_MM / 2, jaw.pad_length_mm, PAD_STEP_MM)
    half = jaw.finger_width_mm / 2
    z = np.arange(-half + PAD_STEP_MM / 2, half, PAD_STEP_MM)
    grid = np.array(np.meshgrid(x, z, indexing="ij")).reshape(2, -1).T
    areas, depths = [], []
    for side in (1.0, -1.0):
        local = np.column_stack([grid[:, 0], np.full(len(grid), side * from_mm / 2), grid[:, 1]])
        origin = local @ T_part_hand[:3, :3].T + T_part_hand[:3, 3]
        inward = np.broadcast_to(-side * T_part_hand[:3, 1], origin.shape)
        _, away = caster.first_hit(origin, inward)
        first = float(away.min())
        if not np.isfinite(first):
            return 0.0, 0.0
        areas.append(float((away <= first + PAD_GIVES_MM).sum()) * PAD_STEP_MM**2)
        depths.append(first)
    return min(areas), from_mm - sum(depths)


def _settled(
    part: PreparedPart,
    layout: CellLayout,
    start: OnTable,
    others: Sequence[Reading],
    way: PickWay,
    rng_seed: int,
) -> tuple[tuple[Step, ...], InArm] | Settling:
    """Return the steps up to the view that tells and how the part is held then.

    A `Settling` without a first view where none of the views with this grip tells.

    Raises
    ------
    NoPlanError : it cannot be picked, or the view not be driven to
    """
    grip = part.arm_grips[way.grip]
    T_world_hand = start.T_world_part @ grip.T_part_hand
    candidates = [
        Candidate.taken(part.solid.name, part.solid, start.T_world_part, T_world_hand),
        *(Candidate.taken(o.name, o.solid, o.T_world_part, T_world_hand) for o in others),
    ]
    q, seconds = offered_views(candidates, layout, grip.opening_mm, way.up[-1])
    settling = separating_views(candidates, layout, q, seconds, grip.opening_mm)
    ask = settling.first
    if ask is None:
        return settling
    parked = layout.park_q if start.q is None else start.q
    build = Build(parked, np.zeros(len(part.samples.points_mm), dtype=bool))
    try:
        Builder(part, layout, rng_seed).pick(build, [way], start.T_world_part)
    except RefutedError as error:
        raise error.reason from error
    scene = Scene(layout, grip.opening_mm, layout.fixture_open_mm, carried_mesh=part.carried(grip))
    target = q[ask.view]
    what = f"{part.solid.name}: path to the disambiguation view"
    motion = connect(build.q, target, scene, what, rng_seed)
    T_world_part = shown_pose(layout, target, grip.T_part_hand)
    eye = inverse_pose(T_world_part) @ np.append(layout.inspection.position_mm, 1.0)
    towards = eye[:3] - part.solid.centroid_mm
    names = ", ".join(sorted({o.name for o in others}))
    view = Present(
        seconds=move_seconds(layout, [build.q, *motion]) + layout.pace.look_s,
        label=f"show with grasp {grip.id}: {part.solid.name} or {names}?",
        view_id=f"{grip.id}-D{ask.view}",
        grip=grip,
        motion=motion,
        q=target,
        T_world_part=T_world_part,
        direction_part=towards / np.linalg.norm(towards),
        seen=np.zeros(len(part.samples.points_mm), dtype=bool),
        square_to=-1,
        expected_opening_mm=grip.opening_mm,
        doubt=Doubt(tuple(candidates), ask.light, ask.margin),
    )
    return (*build.steps, view), InArm(grip, target)
