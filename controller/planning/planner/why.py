"""Reasons for surface not shown: one limit lifted at a time, the first that helps named.

The questions come in the order of planning-facts.md 1.3: hidden by the part itself, by the fingers,
out of reach, no path from this start, too weak a grasp. Each reason comes with its evidence, and
with the smallest change that was found to help.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.imaging import RayCaster
from messages import joined, key, say

from ..grasps import GraspProblem, clear_of_table, find_seeds, judge_grasps, resting_pose, spread
from ..model import CellLayout, Grasp, Jaw, OutOfReachError, PreparedPart, Reason, Unseen
from ..motion import Scene, inverse_rows, passed_limit
from ..views import hidden_by_gripper, view_poses, why_hidden

MIN_SHARE = 2e-4  # share of the surface; a smaller one is single samples on edges
THINNER = (0.75, 0.5, 0.25)  # shares of the fingers' width and thickness
WEAKEST = 20.0  # in friction limits; a weaker grasp is not mentioned
MOSTLY_HIDDEN = 0.5  # share of a piece
ASKED_GRASP_COUNT = 12  # most promising grasps for which the obstacle is named
# Possible places of a camera, seen from the part: along the reach line and square to it.
SENSOR_PLACES = {
    "to the right, looking along +y": (0.0, -1.0, 0.0),
    "to the left, looking along -y": (0.0, 1.0, 0.0),
    "ahead, looking at the column": (1.0, 0.0, 0.0),
    "45 degrees above, to the right": (0.0, -0.7071, 0.7071),
    "overhead": (0.0, 0.0, 1.0),
    "below": (0.0, 0.0, -1.0),
}


@dataclass(frozen=True, slots=True, eq=False)
class Missing:
    """Samples (n,) not shown for one reason, the reason as a sentence, and advice."""

    kind: Reason
    mask: BoolArray
    reason: str
    advice: str = ""


def unseen_pieces(
    part: PreparedPart,
    layout: CellLayout,
    seen: BoolArray,
    within_reach: Collection[int],
    *,
    apart: BoolArray,
    dropped: BoolArray,
    lies_in: int = -1,
    counted_seen: BoolArray | None = None,
) -> tuple[Unseen, ...]:
    """Return the unseen pieces of each face, with the reason.

    Parameters
    ----------
    part : prepared
    layout : the cell
    seen : (n,) samples that the plan shows or that were seen before
    within_reach : arm grasps any regrasp from here leads to
    apart : (n,) samples that a grasp shows which can be had, but not one after the plan's
    dropped : (n,) samples that a view each would have been too little for
    lies_in : index of the stable pose the part starts in, -1 if it is held
    counted_seen : (m,) points counted by that the plan shows; None where they are the samples
    """
    found = []
    samples = part.counted_samples
    weights = samples.areas_mm2 / samples.areas_mm2.sum()
    weak: tuple[Grasp, ...] | None = None  # sought once, when fingers hide something
    classes = _classes(part, layout, seen, within_reach, apart, dropped, lies_in)
    for missing, counted in _counted(part, classes, seen if counted_seen is None else counted_seen):
        for face_id in np.unique(samples.face_ids[counted]):
            which = counted & (samples.face_ids == face_id)
            share = float(weights[which].sum())
            if share < MIN_SHARE:
                continue
            piece = missing.mask & (part.samples.face_ids == face_id)
            kind, reason, advice = missing.kind, missing.reason, missing.advice
            if missing.kind is Reason.HIDDEN_BY_PART:
                limit = part.options.max_incidence_deg
                evidence = part.visibility_table if part.counted is None else part.counted.evidence
                reason, advice = why_hidden(part.solid, evidence, which, limit)
            elif missing.kind is Reason.FINGERS:
                weak = weak_grasps(part, layout) if weak is None else weak
                load = _load_of_a_grasp_that_shows(part, layout, piece, weak)
                if load is None:
                    reason, advice = _fingers(part, layout, piece)
                else:
                    kind = Reason.GRASP_STRENGTH
                    reason, advice = _too_weak(part, load)
            elif missing.kind is Reason.REACH:
                reason, advice = _reach(part, layout, piece)
            rows = tuple(np.flatnonzero(which).tolist())
            found.append(Unseen(int(face_id), share, reason, kind, advice, rows))
    return tuple(sorted(found, key=lambda u: (-u.area_fraction, u.face_id, u.reason)))


def _counted(
    part: PreparedPart, classes: Sequence[Missing], seen: BoolArray
) -> list[tuple[Missing, BoolArray]]:
    """Return each class with the counted points (m,) that are missing for its reason.

    A point is hidden by the part itself if it was searched for from everywhere in vain; otherwise
    it is missing for the reason of the sample nearest to it. If that sample is shown, the point
    lies between the samples that views were chosen by.

    Parameters
    ----------
    part : prepared
    classes : classes of the samples that views are chosen by
    seen : (m,) points that the plan shows
    """
    counted = part.counted
    if counted is None:
        return [(missing, missing.mask) for missing in classes]
    left = ~seen & ~counted.evidence.is_hidden
    out = []
    for missing in classes:
        if missing.kind is Reason.HIDDEN_BY_PART:
            out.append((missing, ~seen & counted.evidence.is_hidden))
            continue
        mine = left & missing.mask[counted.nearest]
        left &= ~mine
        out.append((missing, mine))
    between = _not_worth(part, np.zeros(len(part.samples.points_mm), dtype=bool))
    return [*out, (between, left)]


def nothing_shown(part: PreparedPart, layout: CellLayout, seen: BoolArray) -> OutOfReachError:
    """Return the reason why no view of the part is possible, with the figure that fails.

    Parameters
    ----------
    part : prepared
    layout : the cell
    seen : (n,) samples that need not be shown again
    """
    arm = layout.arm
    x, y, z = layout.station_mm
    away = float(np.hypot(*(layout.station_mm - layout.T_world_arm[:3, 3])[:2]))
    limit = arm.reach_mm
    where = say("the station at ({x:.0f}, {y:.0f}, {z:.0f})", x=x, y=y, z=z)
    if away > limit + arm.tool_mm:
        return OutOfReachError(
            say(
                "{name}: {where} is {away:.0f} mm from the arm's axis, the "
                "outstretched arm with its gripper reaches {limit:.0f} mm; move "
                "the station nearer",
                name=part.solid.name,
                where=where,
                away=away,
                limit=limit + arm.tool_mm,
            ),
            reach_mm=away,
            limit_mm=limit,
            where="station",
        )
    none = np.zeros_like(seen)
    every = range(len(part.arm_grasps))
    why = unseen_pieces(part, layout, seen, every, apart=none, dropped=none)
    reason = (
        say("{reason}; {advice}", reason=why[0].reason, advice=why[0].advice)
        if why
        else key("no view shows anything")
    )
    return OutOfReachError(
        say(
            "{name}: nothing of it can be shown at {where}: {reason}",
            name=part.solid.name,
            where=where,
            reason=reason,
        ),
        reach_mm=away,
        limit_mm=limit,
        where="station",
    )


def _classes(
    part: PreparedPart,
    layout: CellLayout,
    seen: BoolArray,
    within_reach: Collection[int],
    apart: BoolArray,
    dropped: BoolArray,
    lies_in: int,
) -> list[Missing]:
    by_part = ~part.visible.any(axis=0)
    shown = np.any([s.any(axis=0) for s in part.shown], axis=0)
    coverable = part.covered.any(axis=0)
    reach = sorted(set(within_reach))
    here = part.covered[reach].any(axis=0) if reach else np.zeros_like(coverable)
    classes = [
        Missing(Reason.HIDDEN_BY_PART, by_part & ~seen, ""),
        Missing(Reason.FINGERS, ~by_part & ~shown & ~seen, ""),
        Missing(Reason.REACH, shown & ~coverable & ~seen, ""),
    ]
    cut = coverable & ~here & ~seen
    if cut.any():
        reason, advice = _no_path(part, layout, cut, lies_in)
        classes.append(Missing(Reason.NO_REGRASP_PATH, cut, reason, advice))
    split = here & apart & ~seen
    if split.any():
        reason, advice = _no_path(part, layout, split, lies_in)
        classes.append(Missing(Reason.NO_REGRASP_PATH, split, reason, advice))
    rest = here & ~seen & ~apart
    if rest.any():
        classes.append(_left_out(part, rest, dropped))
    return classes


def _left_out(part: PreparedPart, rest: BoolArray, dropped: BoolArray) -> Missing:
    if (rest & dropped).sum() * 2 >= rest.sum():
        return _not_worth(part, rest)
    return Missing(
        Reason.LEFT_OUT,
        rest,
        key("no path free of contact was found to the views or grasps that would show it"),
        key("start with the part elsewhere on the table"),
    )


def _not_worth(part: PreparedPart, mask: BoolArray) -> Missing:
    """Return the class of what no view shows enough of to be worth its seconds."""
    least = part.options.least_gain
    if least:
        return Missing(
            Reason.LEFT_OUT,
            mask,
            say(
                "left out: a further view would add less than {least:.2%} of the surface",
                least=least,
            ),
            key("lower least_gain in the recipe"),
        )
    return Missing(
        Reason.LEFT_OUT,
        mask,
        key("left out: it lies between the points that the views were chosen by"),
        key("a further view would show it"),
    )


def weak_grasps(part: PreparedPart, layout: CellLayout) -> tuple[Grasp, ...]:
    """Return grasps of the arm gripper that fail by the part's weight alone, from all round."""
    rules = replace(part.options.rules.coarse().for_pads_of(layout.arm_gripper), max_load=WEAKEST)
    solid = part.solid
    caster = RayCaster(solid.mesh)
    downs = np.stack([-p.R[2] for p in part.poses]) if part.poses else np.zeros((0, 3))
    widest = layout.arm_gripper.max_mm - rules.jaw_reserve_mm
    seeds = find_seeds(solid, part.samples, caster, widest, rules)
    problem = GraspProblem(solid, seeds, caster, downs, rules)
    found = judge_grasps(problem, layout.arm_gripper, "arm").grasps
    weak = [g for g in found if g.load > part.options.rules.max_load]
    return tuple(weak[k] for k in spread(weak, range(len(weak)), ASKED_GRASP_COUNT))


def _load_of_a_grasp_that_shows(
    part: PreparedPart, layout: CellLayout, piece: BoolArray, weak: Sequence[Grasp]
) -> float | None:
    """Return the least load among weak grasps that leave most of a piece in sight."""
    loads = [
        g.load
        for g in weak
        if _still_hidden(part, layout, g, layout.arm_gripper, piece) < MOSTLY_HIDDEN
    ]
    return min(loads, default=None)


def _too_weak(part: PreparedPart, load: float) -> tuple[str, str]:
    rules = part.options.rules
    return (
        say(
            "grasp strength: the grasps that leave it in sight hold too "
            "weakly, the best uses {load:.2f} of the friction limit, "
            "{max_load:g} is allowed",
            load=load,
            max_load=rules.max_load,
        ),
        key("press harder, or fit pads with more friction"),
    )


def _fingers(part: PreparedPart, layout: CellLayout, piece: BoolArray) -> tuple[str, str]:
    """Name the grasps nearest to showing a piece, and thinner fingers that would."""
    hides = np.stack([part.visible & ~shown for shown in part.shown[: _distinct(part)]])
    left = (part.visible[None] & ~hides)[:, :, piece].any(axis=1).mean(axis=1)
    order = np.argsort(-left, kind="stable")[:ASKED_GRASP_COUNT]
    best = part.arm_grasps[int(order[0])]
    reason = say("hidden by the fingers in every grasp; grasp {id} comes nearest", id=best.id)
    for share in THINNER:
        arm_gripper = _thinner(layout.arm_gripper, share)
        for g in order:
            grasp = part.arm_grasps[int(g)]
            if _still_hidden(part, layout, grasp, arm_gripper, piece) < MOSTLY_HIDDEN:
                return reason, (
                    say(
                        "fingers {finger_width_mm:.0f} mm wide and "
                        "{finger_thickness_mm:.0f} mm thick would do",
                        finger_width_mm=arm_gripper.finger_width_mm,
                        finger_thickness_mm=arm_gripper.finger_thickness_mm,
                    )
                )
    return reason, key("hold the part by other faces: a gripper of another kind")


def _distinct(part: PreparedPart) -> int:
    """Return the number of arm grasps before the first one that is turned over."""
    for k, grasp in enumerate(part.arm_grasps):
        if grasp.id.endswith("'"):
            return max(k, 1)
    return len(part.arm_grasps)


def _thinner(arm_gripper: Jaw, share: float) -> Jaw:
    return replace(
        arm_gripper,
        finger_width_mm=arm_gripper.finger_width_mm * share,
        finger_thickness_mm=arm_gripper.finger_thickness_mm * share,
    )


def _still_hidden(
    part: PreparedPart, layout: CellLayout, grasp: Grasp, arm_gripper: Jaw, piece: BoolArray
) -> float:
    """Return the share of a piece that a gripper with other fingers leaves hidden."""
    visible = part.visible & piece
    hidden = hidden_by_gripper(
        part.solid,
        part.samples,
        visible,
        part.directions.vectors,
        float(np.linalg.norm(layout.inspection.position_mm - layout.station_mm)),
        grasp.T_part_tcp,
        [*arm_gripper.body, *arm_gripper.fingers(grasp.opening_mm)],
    )
    left = np.asarray(visible & ~hidden)[:, piece]
    return 1.0 - float(left.any(axis=0).mean())


def _reach(part: PreparedPart, layout: CellLayout, piece: BoolArray) -> tuple[str, str]:
    """Name the limit between the arm and the best view of a piece, and a camera place that does."""
    gains = np.stack([s[:, piece].sum(axis=1) for s in part.shown])
    order = np.argsort(-gains, axis=None, kind="stable")[:ASKED_GRASP_COUNT]
    pairs = [tuple(int(i) for i in np.unravel_index(k, gains.shape)) for k in order]
    grasp, view = pairs[0]
    T, inside = view_poses(part.solid, layout, part.directions.vectors[view : view + 1])
    if not inside.any():
        return _out_of_picture(part, layout)
    held = part.arm_grasps[grasp]
    T_tcp = T[0][inside[0]] @ held.T_part_tcp
    index, _, q = inverse_rows(layout, T_tcp)
    if len(index):
        scene = Scene(layout, held.opening_mm, layout.fixed_open_mm, part.carried_box(held))
        blockers = sorted({scene.names()[k] for k in scene.contacts(q) if k >= 0})
        names = joined(", ", blockers) or "nothing"
        return say("out of reach: the arm would touch {names}", names=names), say(
            "move {names} away", names=names
        )
    limit = passed_limit(layout, T_tcp) or key("beyond the outstretched arm")
    return say("out of reach: {limit}", limit=limit), _better_place(part, layout, pairs)


def _out_of_picture(part: PreparedPart, layout: CellLayout) -> tuple[str, str]:
    camera = layout.inspection
    away = float(np.linalg.norm(camera.position_mm - layout.station_mm))
    width, height = (
        n * away / f for n, f in zip(camera.size_px, (camera.K[0, 0], camera.K[1, 1]), strict=True)
    )
    span = float(2 * np.linalg.norm(part.part_box.half_mm))
    return (
        say(
            "out of the picture: the camera sees {width:.0f} x {height:.0f} mm "
            "at the station, the part is {span:.0f} mm across",
            width=width,
            height=height,
            span=span,
        ),
        key("move the camera back, or take a shorter focal length"),
    )


def _better_place(part: PreparedPart, layout: CellLayout, pairs: Sequence[tuple[int, ...]]) -> str:
    """Return advice on the place of camera or station by which one of some views is possible."""
    for name, towards in SENSOR_PLACES.items():
        for grasp, view in pairs:
            T = _poses_towards(part, layout, part.directions.vectors[view], np.array(towards))
            index, _, _ = inverse_rows(layout, T @ part.arm_grasps[grasp].T_part_tcp)
            if len(index):
                return say("a camera {name} would see it", name=name)
    reach_mm = layout.arm.reach_mm
    away = float(np.hypot(*(layout.station_mm - layout.T_world_arm[:3, 3])[:2]))
    if away > reach_mm:
        return say(
            "move the station, {away:.0f} mm from the arm's axis, to where the "
            "wrist gets round it: within {reach_mm:.0f} mm",
            away=away,
            reach_mm=reach_mm,
        )
    return key("another start pose or another gripper; no camera place that was tried would do")


def _poses_towards(
    part: PreparedPart, layout: CellLayout, direction: FloatArray, towards: FloatArray
) -> FloatArray:
    """Return T_world_part (12, 4, 4) at the station, a direction of the part turned to a place."""
    turns = np.arange(12) * np.pi / 6
    axis = direction / np.linalg.norm(direction)
    u = np.eye(3)[int(np.argmin(np.abs(axis)))]
    u = u - axis * (u @ axis)
    u /= np.linalg.norm(u)
    on_part = np.column_stack([u, np.cross(axis, u), axis])
    w = np.eye(3)[int(np.argmin(np.abs(towards)))]
    w = w - towards * (w @ towards)
    w /= np.linalg.norm(w)
    at_station = np.column_stack([w, np.cross(towards, w), towards])
    T = np.tile(np.eye(4), (len(turns), 1, 1))
    c, s = np.cos(turns), np.sin(turns)
    spin = np.zeros((len(turns), 3, 3))
    spin[:, 0, 0], spin[:, 0, 1], spin[:, 1, 0], spin[:, 1, 1] = c, -s, s, c
    spin[:, 2, 2] = 1.0
    T[:, :3, :3] = at_station @ spin @ on_part.T
    T[:, :3, 3] = layout.station_mm - T[:, :3, :3] @ part.solid.centroid_mm
    return T


def _no_path(
    part: PreparedPart, layout: CellLayout, cut: BoolArray, lies_in: int
) -> tuple[str, str]:
    """Name the missing link between the grasps available here and those that show a piece."""
    wanted = [g for g in range(len(part.arm_grasps)) if part.covered[g][cut].any()]
    names = ", ".join(part.arm_grasps[g].id for g in wanted[:4])
    others = [
        p.index for p in part.poses if p.index != lies_in and _starts(part, layout, p.index, wanted)
    ]
    advice = ""
    if others:
        poses = ", ".join(str(p) for p in others)
        advice = say("put the part down in stable pose {poses}", poses=poses)
    if layout.fixed_gripper is None:
        return (
            say(
                "no regrasp path from here to a grasp that shows it ({names}): the "
                "cell has no fixed gripper, and no pose on the table leads on",
                names=names,
            ),
            advice or key("a second gripper"),
        )
    if not part.fixed_grasps:
        return (
            say(
                "no regrasp path from here to a grasp that shows it ({names}): the "
                "fixed gripper finds nothing to hold the part by while the arm "
                "gripper releases it",
                names=names,
            ),
            advice or key("other jaws for the fixed gripper"),
        )
    if not any(part.hand_offs):
        return (
            say(
                "no regrasp path from here to a grasp that shows it ({names}): the "
                "arm cannot bring the part to the fixed gripper where it stands",
                names=names,
            ),
            advice or key("move the fixed gripper into the arm's reach"),
        )
    return (
        say(
            "no regrasp path from here to a grasp that shows it ({names}): no "
            "hand-off and no pose on the table joins them",
            names=names,
        ),
        advice or key("turn the fixed gripper"),
    )


def _starts(part: PreparedPart, layout: CellLayout, pose_index: int, wanted: Sequence[int]) -> bool:
    """Return True if one of some grasps picks the part from a stable pose."""
    pose = next(p for p in part.poses if p.index == pose_index)
    x, y = layout.set_down_mm.mean(axis=1)
    T = resting_pose(part.solid, pose, float(x), float(y))
    return bool(clear_of_table(T, [part.arm_grasps[g] for g in wanted], layout.arm_gripper).any())
