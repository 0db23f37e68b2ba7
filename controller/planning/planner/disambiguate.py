"""A plan that begins with a disambiguation view, which identifies the part in the arm gripper.

A part may be ambiguous to recognition: its mirror twin, or a pose that looks alike from above. The
part is taken with a grasp that holds under every hypothesis; the cheapest view that separates the
hypotheses comes first, and the plan continues by its result. If it is the planned part, the plan
just goes on; if it is that part in another pose, a new plan starts from the arm gripper; another
part, or one that is still ambiguous, goes to the quarantine tray (ADR 39).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from controller.arrays import BoolArray, FloatArray, Grey
from controller.cad import Solid
from controller.imaging import RayCaster, inverse_pose
from messages import say

from ..disambiguation import (
    DisambiguationRules,
    DisambiguationTree,
    Identification,
    apart,
    compare,
    discriminate,
    edges_shown,
    measured_picture,
    model_of,
    offered_views,
    predict_view,
    separating_views,
)
from ..model import (
    Ambiguity,
    CellLayout,
    Grasp,
    HeldHypothesis,
    InArm,
    Jaw,
    NoPlanError,
    OnTable,
    Plan,
    PreparedPart,
    Present,
    Step,
    lit_count,
)
from ..motion import Scene, connect, move_seconds, segment_seconds, shown_pose
from ..regrasps import PickPath, pick_paths
from .build import Build, Builder, RefutedError
from .planner import plan_from

GRASP_COUNT = 6  # grasps that hold every hypothesis, tried for a deciding view
SAME_OPENING_MM = 1.0  # jaws this alike could not distinguish the hypotheses
MIN_SHARE = 0.5  # share of the planned part's pad contact that the others must give too
PAD_STEP_MM = 2.0
PAD_GIVES_MM = 0.4


@dataclass(frozen=True, slots=True, eq=False)
class TableHypothesis:
    """Another hypothesis for the part on the table: its solid, and T_world_part (4, 4)."""

    name: str
    solid: Solid
    T_world_part: FloatArray


def plan_under_ambiguity(
    part: PreparedPart,
    layout: CellLayout,
    start: OnTable,
    others: Sequence[TableHypothesis],
    *,
    seen: BoolArray | None = None,
    avoid: frozenset[str] = frozenset(),
    rng_seed: int = 0,
) -> Plan:
    """Return a plan whose first view decides between the hypotheses for the part on the table.

    Its `Present.ambiguity` names them; the later steps are valid if it is the planned part. If no
    view can decide because all hypotheses are of one part that looks the same under each, the plan
    is one without ambiguity.

    Parameters
    ----------
    part : prepared for this cell: the hypothesis that is planned for
    layout : the cell
    start : present pose, read as that part
    others : further hypotheses of the part
    seen, avoid : as in `plan_from`
    rng_seed : seed of the random trees; the same one gives the same plan

    Raises
    ------
    NoPlanError : as in `plan_from`, or no view that can be had tells the hypotheses apart
    """
    failure: NoPlanError | None = None
    alike: DisambiguationTree | None = None
    for path in _common_paths(part, layout, start, others, avoid):
        try:
            found = _up_to_deciding_view(part, layout, start, others, path, rng_seed)
        except NoPlanError as error:
            failure = failure or error
            continue
        if isinstance(found, DisambiguationTree):
            alike = found
            if all(o.solid is part.solid for o in others):
                break  # one part that looks the same in whichever pose
            continue
        opening, held = found
        rest = plan_from(part, layout, held, seen=seen, avoid=avoid, rng_seed=rng_seed)
        return replace(
            rest,
            steps=(*opening, *rest.steps),
            grasps=(held.grasp, *rest.grasps[1:]) if rest.grasps else (held.grasp,),
        )
    if alike is not None and all(o.solid is part.solid for o in others):
        return plan_from(part, layout, start, seen=seen, avoid=avoid, rng_seed=rng_seed)
    names = ", ".join(sorted({o.name for o in others}))
    if alike is not None and alike.indistinguishable:
        raise NoPlanError(
            say(
                "{name} may be {names} as well, and no view distinguishes them: {reason}",
                name=part.solid.name,
                names=names,
                reason=alike.indistinguishable[0].reason,
            )
        )
    raise failure or NoPlanError(
        say(
            "{name} may be {names} as well, and no grasp from above holds both; turn it over",
            name=part.solid.name,
            names=names,
        )
    )


def identify(
    ambiguity: Ambiguity,
    layout: CellLayout,
    q: FloatArray,
    opening_mm: float,
    backlit: Grey,
    lit: Sequence[Grey],
) -> Identification:
    """Return the hypotheses that are left after the pictures of a `Present.ambiguity`.

    Parameters
    ----------
    ambiguity : ambiguity of the view
    layout : the cell
    q : (6,) joints of the arm
    opening_mm : opening of the arm gripper
    backlit, lit : (h, w) pictures of the inspection camera, for
        `disambiguation.measured_picture`
    """
    rules = DisambiguationRules()
    among = range(len(ambiguity.hypotheses))
    models = [model_of(c) for c in ambiguity.hypotheses]
    predicted = predict_view(ambiguity.hypotheses, models, layout, q, opening_mm, 1, rules)
    if predicted is None:
        return Identification(tuple(among), np.full(len(ambiguity.hypotheses), np.inf))
    measured = measured_picture(predicted, backlit, lit)
    return discriminate(
        compare(measured, predicted, ambiguity.light, among),
        apart(predicted, ambiguity.light),
        ambiguity.light,
        among,
        edges_shown(predicted) if ambiguity.light == "front" else None,
        rules,
    )


def _common_paths(
    part: PreparedPart,
    layout: CellLayout,
    start: OnTable,
    others: Sequence[TableHypothesis],
    avoid: frozenset[str],
) -> list[PickPath]:
    """Return pick paths with grasps that hold under every hypothesis, the quickest first."""
    q = layout.park_q if start.q is None else start.q
    paths = sorted(
        pick_paths(part, layout, start.T_world_part),
        key=lambda w: (float(segment_seconds(layout, q, w.down[0])), w.grasp),
    )
    casters = [RayCaster(o.solid.mesh) for o in others]
    own = RayCaster(part.solid.mesh)
    found: dict[int, PickPath] = {}
    for path in paths:
        grasp = part.arm_grasps[path.grasp]
        if path.grasp in found or grasp.id in avoid or grasp.is_inner:
            continue
        T_world_tcp = start.T_world_part @ grasp.T_part_tcp
        own_area, _ = _closed(own, grasp.T_part_tcp, layout.arm_gripper, grasp.pre_open_mm)
        if all(
            _holds_too(
                c,
                inverse_pose(o.T_world_part) @ T_world_tcp,
                layout,
                grasp,
                own_area,
                min(SAME_OPENING_MM, part.options.opening_tolerance_mm),
            )
            for c, o in zip(casters, others, strict=True)
        ):
            found[path.grasp] = path
        if len(found) == GRASP_COUNT:
            break
    return list(found.values())


def _holds_too(
    caster: RayCaster,
    T_part_tcp: FloatArray,
    layout: CellLayout,
    grasp: Grasp,
    area: float,
    tolerance_mm: float,
) -> bool:
    """Return True if jaws stop on another solid at the same place as on the part."""
    other, width = _closed(caster, T_part_tcp, layout.arm_gripper, grasp.pre_open_mm)
    return other >= MIN_SHARE * area and abs(width - grasp.opening_mm) <= tolerance_mm


def _closed(
    caster: RayCaster, T_part_tcp: FloatArray, jaw: Jaw, from_mm: float
) -> tuple[float, float]:
    """Return the smaller contact [mm2] and the width [mm] of jaws that close from `from_mm`."""
    x = -np.arange(PAD_STEP_MM / 2, jaw.pad_length_mm, PAD_STEP_MM)
    half = jaw.finger_width_mm / 2
    z = np.arange(-half + PAD_STEP_MM / 2, half, PAD_STEP_MM)
    grid = np.array(np.meshgrid(x, z, indexing="ij")).reshape(2, -1).T
    areas, depths = [], []
    for side in (1.0, -1.0):
        local = np.column_stack([grid[:, 0], np.full(len(grid), side * from_mm / 2), grid[:, 1]])
        origin = local @ T_part_tcp[:3, :3].T + T_part_tcp[:3, 3]
        inward = np.broadcast_to(-side * T_part_tcp[:3, 1], origin.shape)
        _, away = caster.first_hit(origin, inward)
        first = float(away.min())
        if not np.isfinite(first):
            return 0.0, 0.0
        areas.append(float((away <= first + PAD_GIVES_MM).sum()) * PAD_STEP_MM**2)
        depths.append(first)
    return min(areas), from_mm - sum(depths)


def _up_to_deciding_view(
    part: PreparedPart,
    layout: CellLayout,
    start: OnTable,
    others: Sequence[TableHypothesis],
    path: PickPath,
    rng_seed: int,
) -> tuple[tuple[Step, ...], InArm] | DisambiguationTree:
    """Return the steps up to the deciding view, and the hold of the part then.

    A `DisambiguationTree` without a first view if none of the views with this grasp decides.

    Raises
    ------
    NoPlanError : it cannot be picked, or the view not be driven to
    """
    grasp = part.arm_grasps[path.grasp]
    T_world_tcp = start.T_world_part @ grasp.T_part_tcp
    hypotheses = [
        HeldHypothesis.taken(part.solid.name, part.solid, start.T_world_part, T_world_tcp),
        *(HeldHypothesis.taken(o.name, o.solid, o.T_world_part, T_world_tcp) for o in others),
    ]
    q, seconds = offered_views(hypotheses, layout, grasp.opening_mm, path.up[-1])
    tree = separating_views(hypotheses, layout, q, seconds, grasp.opening_mm)
    first = tree.first
    if first is None:
        return tree
    parked = layout.park_q if start.q is None else start.q
    build = Build(parked, np.zeros(len(part.samples.points_mm), dtype=bool))
    try:
        Builder(part, layout, rng_seed).pick(build, [path], start.T_world_part)
    except RefutedError as error:
        raise error.reason from error
    scene = Scene(layout, grasp.opening_mm, layout.fixed_open_mm, carried_mesh=part.carried(grasp))
    target = q[first.view]
    what = say("{name}: path to the disambiguation view", name=part.solid.name)
    motion = connect(build.q, target, scene, what, rng_seed)
    T_world_part = shown_pose(layout, target, grasp.T_part_tcp)
    eye = inverse_pose(T_world_part) @ np.append(layout.inspection.position_mm, 1.0)
    towards = eye[:3] - part.solid.centroid_mm
    names = ", ".join(sorted({o.name for o in others}))
    times = layout.cell_times
    view = Present(
        seconds=move_seconds(layout, [build.q, *motion])
        + times.look_s(lit_count(is_square=False))
        + times.judge_s,
        wait_s=times.judge_s,
        label=say(
            "show with grasp {id}: {name} or {names}?",
            id=grasp.id,
            name=part.solid.name,
            names=names,
        ),
        view_id=f"{grasp.id}-D{first.view}",
        grasp=grasp,
        motion=motion,
        q=target,
        T_world_part=T_world_part,
        direction_part=towards / np.linalg.norm(towards),
        seen=np.zeros(len(part.counted_samples.points_mm), dtype=bool),
        square_to=-1,
        expected_opening_mm=grasp.opening_mm,
        ambiguity=Ambiguity(tuple(hypotheses), first.light, first.margin),
    )
    return (*build.steps, view), InArm(grasp, target)
