"""Taking a resting part off the table, and why it cannot be taken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from controller.arrays import FloatArray, IntArray
from controller.imaging import inverse_pose
from messages import joined, key, say

from ..geometry import Box, narrowest_mm, stack
from ..grasps import clear_of_table, resting_pose
from ..model import (
    TABLE_MARGIN_MM,
    CellLayout,
    Grasp,
    NoMotionError,
    NoPlanError,
    NotGraspableError,
    OutOfReachError,
    PreparedPart,
)
from ..motion import Scene, fewest_waypoints, inverse_rows, passed_limit, same_branch
from ._handoff import CLOSE_MARGIN_MM, PART_MARGIN_MM
from ._neighbours import beside_alone, lift_mm, what_covers

STEP_MM = 10.0
RIM_STEP_MM = 0.5  # steps of height at which pads are tried


@dataclass(frozen=True, slots=True, eq=False)
class PickPath:
    """Pick path of one arm grasp: joints down (k, 6) to the hold and up (k, 6) from it."""

    grasp: int
    down: FloatArray
    up: FloatArray


def pick_paths(part: PreparedPart, layout: CellLayout, T_world_part: FloatArray) -> list[PickPath]:
    """Return the pick paths of all arm grasps that can take the part where it lies.

    Parameters
    ----------
    part : prepared
    layout : the cell
    T_world_part : (4, 4) pose of the part on the table [mm]

    Raises
    ------
    NotGraspableError, OutOfReachError, NoMotionError : none can, with the nearest reason
    """
    return [
        PickPath(grasp, fewest_waypoints(layout, down), fewest_waypoints(layout, lift))
        for grasp, down, lift in _free_paths(part, layout, T_world_part)
    ]


def is_pickable(part: PreparedPart, layout: CellLayout, T_world_part: FloatArray) -> bool:
    """Return True if any arm grasp can take the part where it lies.

    Parameters
    ----------
    part : prepared
    layout : the cell
    T_world_part : (4, 4) pose of the part on the table [mm]
    """
    try:
        return bool(_free_paths(part, layout, T_world_part))
    except NoPlanError:
        return False


def _free_paths(
    part: PreparedPart, layout: CellLayout, T_world_part: FloatArray
) -> list[tuple[int, FloatArray, FloatArray]]:
    """Return each arm grasp that takes the part, with its dense paths (k, 6) down and up.

    Parameters and errors are those of `pick_paths`.
    """
    grasps = part.arm_grasps
    x, y = (T_world_part[:3, :3] @ part.solid.centroid_mm + T_world_part[:3, 3])[:2]
    where = say("{name} on the table at ({x:.0f}, {y:.0f})", name=part.solid.name, x=x, y=y)
    members = np.flatnonzero(clear_of_table(T_world_part, grasps, layout.arm_gripper))
    if len(members) == 0:
        raise NotGraspableError(
            say(
                "{where}: {no_grasp_from_above}",
                where=where,
                no_grasp_from_above=_no_grasp_from_above(part, layout, T_world_part),
            )
        )
    if (reason := what_covers(part, layout, T_world_part)) is not None:
        raise NoMotionError(say("{where}: {reason}", where=where, reason=reason))
    T_hold = T_world_part @ np.stack([grasps[k].T_part_tcp for k in members])
    index, branch, q = inverse_rows(layout, T_hold)
    if len(index) == 0:
        raise _out_of_reach(layout, T_hold, where)
    k = np.arange(1, ceil(lift_mm(part, layout, T_world_part) / STEP_MM) + 1) * STEP_MM
    T_above = np.repeat(T_hold[index][:, None], len(k), axis=1)
    T_above[..., :3, 3] -= k[None, :, None] * T_hold[index][:, None, :3, 0]
    T_up = np.repeat(T_hold[index][:, None], len(k), axis=1)
    T_up[..., 2, 3] += k
    above, up = same_branch(layout, T_above, branch), same_branch(layout, T_up, branch)
    whole = np.isfinite(above).all(axis=(1, 2)) & np.isfinite(up).all(axis=(1, 2))
    rows = np.flatnonzero(whole)
    held = [grasps[members[index[row]]] for row in rows]
    down = np.concatenate([above[rows][:, ::-1], q[rows][:, None]], axis=1)
    lift = np.concatenate([q[rows][:, None], up[rows]], axis=1)
    open_scene = Scene(layout, 0.0, layout.fixed_open_mm)
    # what is straight above the part was looked at; beside it the part may touch a neighbour
    bare = Scene(replace(layout, neighbours=()), 0.0, layout.fixed_open_mm)
    full = _full_grippers(layout, held)
    phases = [
        (open_scene, _contacts(open_scene, down, _open_grippers(layout, held), TABLE_MARGIN_MM)),
        (bare, _contacts(bare, lift, full, -1.0, PART_MARGIN_MM, (part, held))),
    ]
    if layout.neighbours:
        beside = Scene(beside_alone(layout), 0.0, 0.0)
        phases.append((beside, _contacts(beside, lift, full, -1.0)))
    blocked = {
        scene.names()[k]
        for scene, touched in phases
        for k in touched.max(axis=1, initial=-1)
        if k >= 0
    }
    clear = np.hstack([touched < 0 for _, touched in phases]).all(axis=1)
    free = np.flatnonzero(clear)
    if len(free) == 0:
        if blocked:
            raise NoMotionError(
                say(
                    "{where}: every approach touches {blocked}; move the part away",
                    where=where,
                    blocked=joined(", ", sorted(blocked)),
                )
            )
        raise _out_of_reach(layout, T_up[:, -1], where)
    return [(int(members[index[rows[k]]]), down[k], lift[k]) for k in free]


def _contacts(
    scene: Scene,
    q: FloatArray,
    grippers: tuple[FloatArray, FloatArray],
    table_margin_mm: float,
    margin_mm: float = CLOSE_MARGIN_MM,
    held: tuple[PreparedPart, Sequence[Grasp]] | None = None,
) -> IntArray:
    """Return the contacts (n, k) along paths (n, k, 6), each with a gripper of its own.

    Parameters
    ----------
    held : the part in the arm gripper, and the grasp of each path
    """
    n, k = q.shape[:2]
    T, half = (np.repeat(h, k, axis=0) for h in grippers)
    carried = None
    if held is not None and n:
        T_tcp_part = np.stack([inverse_pose(g.T_part_tcp) for g in held[1]])
        carried = held[0].shape, np.repeat(T_tcp_part, k, axis=0)
    found = scene.contacts(
        q.reshape(-1, 6), margin_mm, table_margin_mm, arm_gripper=(T, half), part=carried
    )
    return found.reshape(n, k)


def _open_grippers(layout: CellLayout, grasps: Sequence[Grasp]) -> tuple[FloatArray, FloatArray]:
    return _stacked(
        [[*layout.arm_gripper.body, *layout.arm_gripper.fingers(g.pre_open_mm)] for g in grasps],
        layout,
    )


def _full_grippers(layout: CellLayout, grasps: Sequence[Grasp]) -> tuple[FloatArray, FloatArray]:
    return _stacked(
        [[*layout.arm_gripper.body, *layout.arm_gripper.fingers(g.opening_mm)] for g in grasps],
        layout,
    )


def _stacked(grippers: Sequence[list[Box]], layout: CellLayout) -> tuple[FloatArray, FloatArray]:
    if not grippers:
        m = len(layout.arm_gripper.body) + 2
        return np.zeros((0, m, 4, 4)), np.zeros((0, m, 3))
    pairs = [stack(boxes) for boxes in grippers]
    return np.stack([p[0] for p in pairs]), np.stack([p[1] for p in pairs])


def _no_grasp_from_above(part: PreparedPart, layout: CellLayout, T_world_part: FloatArray) -> str:
    """Return a message: the reason for no grasp, advice, and the stable poses that have one."""
    hull = part.solid.hull_mm @ T_world_part[:3, :3].T
    high = float(np.ptp(hull[:, 2]))
    text = say("no pick in this pose: in it the part is {high:.1f} mm high", high=high)
    rules, jaw = part.options.rules.for_pads_of(layout.arm_gripper), layout.arm_gripper
    wide, widest = narrowest_mm(hull[:, :2]), jaw.max_mm - rules.jaw_reserve_mm
    room = TABLE_MARGIN_MM + layout.clearance_mm
    rim = rules.min_rim_contact_mm2 / jaw.finger_width_mm  # height of what the pads must meet
    if wide > widest:
        text += say(
            " and nowhere less than {wide:.0f} mm wide; the jaws take {widest:.0f} mm",
            wide=wide,
            widest=widest,
        )
        remedy = key("fit a wider jaw")
    elif high < rim:
        text += say(
            ", and pads must meet {rim:.1f} mm of its rim; such parts take a vacuum gripper",
            rim=rim,
        )
        remedy = key("no finger holds it")
    elif high - room < rim + RIM_STEP_MM:
        left, support = max(0.0, high - room), max(1, ceil(room + 2 * rim - high))
        text += say(
            "; fingertips stay {room:.1f} mm off the table, {left:.1f} mm of its rim are left",
            room=room,
            left=left,
        )
        remedy = say(
            "lay it {support} mm higher, on a support that ends within its "
            "outline, with the table plane measured on its top",
            support=support,
        )
    else:
        text += say(
            ", and none of its {arm_grasps_count} grasps from above clears the "
            "table by {room:g} mm",
            arm_grasps_count=len(part.arm_grasps),
            room=room,
        )
        remedy = key("fit other fingers")
    x, y = layout.set_down_mm.mean(axis=1)
    able = []
    for pose in part.poses:
        T = resting_pose(part.solid, pose, float(x), float(y))
        lies_so = np.allclose(T[2, :3], T_world_part[2, :3], atol=0.02)
        if pose.marginal or pose.rocking or lies_so:
            continue
        if clear_of_table(T, part.arm_grasps, layout.arm_gripper).any():
            able.append(str(pose.index))
    if able:
        return say(
            "{text}; {remedy}, or lay it down in stable pose {able}",
            text=text,
            remedy=remedy,
            able=joined(" or ", able),
        )
    return say(
        "{text}, and no other pose does that is more than barely stable; {remedy}",
        text=text,
        remedy=remedy,
    )


def _out_of_reach(layout: CellLayout, T_tcp: FloatArray, where: str) -> OutOfReachError:
    T = np.linalg.inv(layout.T_world_arm) @ T_tcp
    wrist = T[:, :3, 3] - layout.arm.tool_mm * T[:, :3, 0]
    reach = np.hypot(wrist[:, 0], wrist[:, 1])
    limit = layout.arm.reach_mm
    best = float(reach.min())
    if best > limit:
        text = say(
            "{where}: {best:.0f} mm are required of the wrist, the arm reaches "
            "{limit:.0f} mm; move the part closer",
            where=where,
            best=best,
            limit=limit,
        )
    else:
        passed = passed_limit(layout, T_tcp) or key("beyond the arm's reach")
        text = say("{where}: {passed}; turn the part or move it", where=where, passed=passed)
    return OutOfReachError(text, reach_mm=best, limit_mm=limit, where=where)
