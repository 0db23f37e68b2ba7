"""Preparation of a part in a cell before one is on the table; the caller caches it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.cad import Solid, SurfaceSamples, stable_poses
from controller.imaging import RayCaster

from ..geometry import PartShape
from ..grasps import (
    GraspProblem,
    clear_of_table,
    find_seeds,
    resting_pose,
    select_arm_grasps,
    spread,
    still_gravities,
    synthesise_grasps,
    turned_over,
)
from ..model import (
    CellLayout,
    Counted,
    FaceToShowAgain,
    Grasp,
    HandOff,
    NotGraspableError,
    PlanOptions,
    PreparedPart,
)
from ..motion import Scene, segment_seconds
from ..regrasps import clear_hand_offs, hand_offs, rests, set_downs
from ..views import (
    VisibilityRules,
    by_element,
    directions_to_openings,
    eyes_of,
    find_openings,
    hidden_by_gripper,
    hold_up,
    holding_boxes,
    lit_from,
    lit_past,
    look_out,
    reachable_views,
    with_directions,
)
from .choice import dense_points, into_wedges, make_counted, with_hard_spots

TURNED = "'"  # ends the ids of grasps with the arm gripper turned over


def prepare_part(
    solid: Solid,
    samples: SurfaceSamples,
    layout: CellLayout,
    options: PlanOptions | None = None,
    counted: SurfaceSamples | None = None,
) -> PreparedPart:
    """Return a part's grasps by both grippers, the surface left in sight, and the hand-offs.

    Parameters
    ----------
    solid : the part
    samples : samples of `controller.cad.sample_surface`, by which views are chosen
    layout : the cell
    options : requirements on plans; None for the defaults
    counted : of `controller.cad.counted_samples`, by which coverage is counted and which plans
        speak of; None for `samples`

    Raises
    ------
    NotGraspableError : no grasp of the arm gripper holds it
    """
    options = options or PlanOptions()
    poses = tuple(p for p in stable_poses(solid) if not (p.rolling and p.marginal))
    caster = RayCaster(solid.mesh)
    downs = np.stack([-p.R[2] for p in poses]) if poses else np.zeros((0, 3))
    widest = max(layout.arm_gripper.max_mm, layout.fixed_open_mm) - options.rules.jaw_reserve_mm
    jaws = [layout.arm_gripper, *([] if layout.fixed_gripper is None else [layout.fixed_gripper])]
    seeds = find_seeds(
        solid, samples, caster, widest, options.rules.for_pads_of(*jaws), spreading=jaws
    )
    problem = GraspProblem(solid, seeds, caster, downs, options.rules, layout.clearance_mm)
    every = synthesise_grasps(problem, layout.arm_gripper, "arm")
    base = select_arm_grasps(
        solid,
        poses,
        every,
        layout.arm_gripper,
        options.arm_grasps_per_pose,
        options.arm_grasps_round,
    )
    fixed: tuple[Grasp, ...] = ()  # views without a hand-off may be enough
    if layout.fixed_gripper is not None:
        with suppress(NotGraspableError):
            fixed = synthesise_grasps(
                problem,
                layout.fixed_gripper,
                "fixture",
                still_gravities(layout.T_world_fixed_tcp),
            )
    fixed_base = [fixed[k] for k in spread(fixed, range(len(fixed)), options.fixed_grasps)]

    rules = VisibilityRules.of_station(layout, options.max_incidence_deg, options.min_px_per_mm)
    by: Counted | None = None
    if counted is None:
        visibility_table = look_out(solid, samples, caster, rules, options.direction_count)
    else:
        dense = dense_points(solid, caster, rules, options.direction_count)
        samples = with_hard_spots(samples, dense)
        visibility_table = look_out(solid, samples, caster, rules, options.direction_count)
        visibility_table, probes = into_wedges(
            dense, visibility_table, solid, samples, caster, rules, options
        )
        by = make_counted(solid, samples, counted, probes, caster, rules, visibility_table)
    openings = find_openings(solid)
    vectors = directions_to_openings(
        openings, solid, caster, visibility_table.directions.vectors, rules
    )
    visibility_table = with_directions(visibility_table, vectors, solid, samples, caster, rules)
    arm_grasps = (*base, *(turned_over(g) for g in base))
    fixed_grasps = (*fixed_base, *(turned_over(g) for g in fixed_base))
    bare = PreparedPart(
        solid=solid,
        samples=samples,
        options=options,
        shape=PartShape.of(solid),
        poses=poses,
        arm_grasps=(),
        fixed_grasps=fixed_grasps,
        visibility_table=visibility_table,
        shown=(),
        openings=openings,
        shown_open=(),
        view_q=(),
        hand_offs=tuple({} for _ in fixed_grasps),
        covered=np.zeros((0, len(samples.points_mm)), dtype=bool),
        home_q=np.zeros((0, 6)),
        counted=by,
    )
    part = with_grasps(bare, layout, arm_grasps)
    return part if _is_joined(part, layout) else with_rests(part, layout)


def with_grasps(part: PreparedPart, layout: CellLayout, grasps: Sequence[Grasp]) -> PreparedPart:
    """Return the part with more grasps of the arm, their views and their regrasps.

    A measured grasp that differs from the planned one comes in this way.

    Parameters
    ----------
    part : prepared for this cell; left as it is
    layout : the cell
    grasps : grasps to add, numbered after the existing ones
    """
    rules = VisibilityRules.of_station(
        layout, part.options.max_incidence_deg, part.options.min_px_per_mm
    )
    showing = hold_up(part.solid, part.samples, layout, part.directions.vectors)
    shown: list[BoolArray] = []
    view_q: list[Mapping[int, FloatArray]] = []
    eyes = eyes_of(part.solid, part.directions.vectors, rules)
    lit = lit_from(part.openings, RayCaster(part.solid.mesh), eyes)
    shown_open: list[BoolArray] = []
    by_gripper: dict[str, tuple[BoolArray, BoolArray]] = {}
    for grasp in grasps:
        base = _unturned(grasp.id)
        if base not in by_gripper:  # turned over, a gripper hides the same
            boxes = holding_boxes(layout.arm_gripper, grasp)
            hidden = hidden_by_gripper(
                part.solid,
                part.samples,
                part.visible,
                part.directions.vectors,
                rules.distance_mm,
                grasp.T_part_tcp,
                boxes,
            )
            past = lit_past(part.openings, lit, eyes, grasp.T_part_tcp, boxes)
            by_gripper[base] = part.visible & ~hidden, by_element(part.openings, past)
        scene = Scene(layout, grasp.opening_mm, layout.fixed_open_mm, part.carried_box(grasp))
        views = reachable_views(
            layout,
            scene,
            part.samples,
            showing,
            by_gripper[base][0],
            grasp.T_part_tcp,
            layout.park_q,
        )
        shown.append(views.shown)
        shown_open.append(by_gripper[base][1])
        view_q.append(views.q)
    covered = [
        s[sorted(q)].any(axis=0) if q else np.zeros(s.shape[1], dtype=bool)
        for s, q in zip(shown, view_q, strict=True)
    ]
    first = len(part.arm_grasps)

    def joined(old: Mapping[int, HandOff], found: Mapping[int, HandOff]) -> Mapping[int, HandOff]:
        return {**old, **{first + k: path for k, path in found.items()}}

    return replace(
        part,
        arm_grasps=(*part.arm_grasps, *grasps),
        shown=(*part.shown, *shown),
        shown_open=(*part.shown_open, *shown_open),
        view_q=(*part.view_q, *view_q),
        covered=np.vstack([part.covered, np.reshape(covered, (len(grasps), -1))]),
        home_q=np.vstack([part.home_q, *(_home_q_of(layout, q) for q in view_q)]),
        hand_offs=tuple(
            joined(old, hand_offs(layout, part.shape, f, grasps))
            for old, f in zip(part.hand_offs, part.fixed_grasps, strict=True)
        ),
        set_downs=tuple(
            joined(old, set_downs(layout, part.shape, rest, grasps))
            for old, rest in zip(part.set_downs, part.rests, strict=True)
        ),
    )


def without_short(part: PreparedPart, short: Collection[FaceToShowAgain]) -> PreparedPart:
    """Return the part as if some grasps did not show some faces; turned over, none shows more.

    Parameters
    ----------
    part : prepared; left as it is
    short : pairs of grasp and face
    """
    if not short:
        return part
    faces: dict[str, list[int]] = {}
    for one in short:
        faces.setdefault(_unturned(one.grasp), []).append(one.face)
    of_grasp = [faces.get(_unturned(grasp.id), []) for grasp in part.arm_grasps]
    hidden = [np.isin(part.samples.face_ids, some) for some in of_grasp]
    closed = [np.isin(part.openings.faces, some) for some in of_grasp]
    return replace(
        part,
        shown=tuple(s & ~h for s, h in zip(part.shown, hidden, strict=True)),
        shown_open=tuple(s & ~c for s, c in zip(part.shown_open, closed, strict=True)),
        covered=part.covered & ~np.array(hidden),
    )


def _unturned(grasp: str) -> str:
    """Return the id that a grasp has without the arm gripper turned over."""
    return grasp.removesuffix(TURNED)


def _home_q_of(layout: CellLayout, views: Mapping[int, FloatArray]) -> FloatArray:
    """Return the configuration (1, 6) nearest to all views of a grasp; parked where it has none."""
    if not views:
        return layout.park_q[None]
    q = np.stack([views[v][0] for v in sorted(views)])
    away = segment_seconds(layout, q[:, None], q[None])
    nearest = int(np.argmin(away.sum(axis=1)))
    return q[nearest : nearest + 1]


def with_rests(part: PreparedPart, layout: CellLayout) -> PreparedPart:
    """Return the part with poses on the table in which it can be set down to regrasp."""
    places = rests(part.solid, part.poses, layout)
    return replace(
        part,
        rests=places,
        set_downs=tuple(set_downs(layout, part.shape, r, part.arm_grasps) for r in places),
    )


def among_neighbours(part: PreparedPart, layout: CellLayout) -> PreparedPart:
    """Return the part without hand-offs and rests that its neighbours on the table block (ADR 66).

    Parameters
    ----------
    part : prepared for this cell, which had no neighbours then; left as it is
    layout : the cell, with what is on the table now
    """
    if not layout.neighbours:
        return part
    clear = clear_hand_offs(part, layout)
    return with_rests(clear, layout) if part.rests else clear


def _is_joined(part: PreparedPart, layout: CellLayout) -> bool:
    """Return True if the fixed gripper alone leads from every pose to all that can be shown."""
    count = len(part.arm_grasps)
    can = np.zeros((count, count), dtype=bool)
    for table in part.hand_offs:
        members = np.array(sorted(table), dtype=int)
        can[np.ix_(members, members)] = True
    able = part.covered.any(axis=0)
    x, y = layout.set_down_mm.mean(axis=1)
    for pose in part.poses:
        T = resting_pose(part.solid, pose, float(x), float(y))
        had = np.asarray(clear_of_table(T, part.arm_grasps, layout.arm_gripper), dtype=bool)
        # the part comes up in one grasp only: one of them has to lead on to everything
        firsts = (np.arange(count) == g for g in np.flatnonzero(had))
        if had.any() and not any(
            part.covered[_reached(first, can)][:, able].any(axis=0).all() for first in firsts
        ):
            return False
    return True


def _reached(had: BoolArray, can: BoolArray) -> BoolArray:
    while True:
        more = had | can[had].any(axis=0)
        if (more == had).all():
            return had
        had = more
