"""Hand-offs between the arm gripper and the fixed gripper: pairs of grasps that allow one.

The part is where the fixed gripper's grasp puts it. It comes in along the fixed gripper's approach,
the arm gripper leaves along its own; both paths are straight lines on one elbow branch. Receiving
is the same two lines in reverse, so one table serves both.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from controller.arrays import BoolArray, FloatArray, IntArray
from controller.imaging import inverse_pose
from messages import key

from ..geometry import PartShape, stack
from ..model import CellLayout, Grasp, HandOff
from ..motion import Scene, inverse_rows, same_branch

APPROACH_MM = 80.0  # length of the straight path in and out
STEP_MM = 10.0
CLOSE_MARGIN_MM = 2.0  # margin between two grippers at one part, where both stand still or creep
PART_MARGIN_MM = 5.0


def hand_offs(
    layout: CellLayout, part: PartShape, fixed_grasp: Grasp, arm_gripper_grasps: Sequence[Grasp]
) -> dict[int, HandOff]:
    """Return the hand-offs of one fixed grasp with arm grasps, by their place in the sequence.

    Parameters
    ----------
    layout : the cell
    part : its triangles
    fixed_grasp : grasp of the fixed gripper
    arm_gripper_grasps : grasps of the arm gripper
    """
    T_fixed_tcp = layout.T_world_fixed_tcp
    T_world_part = T_fixed_tcp @ inverse_pose(fixed_grasp.T_part_tcp)
    T_hold = np.stack([T_world_part @ g.T_part_tcp for g in arm_gripper_grasps])
    grasp, branch, q = inverse_rows(layout, T_hold)
    if len(grasp) == 0:
        return {}
    steps = np.arange(1, round(APPROACH_MM / STEP_MM) + 1) * STEP_MM

    gripper_only = _gripper_opening(layout, arm_gripper_grasps)
    closed_grippers = _gripper_closed(layout, arm_gripper_grasps)
    T_tcp_part = np.stack([inverse_pose(g.T_part_tcp) for g in arm_gripper_grasps])
    around = Scene(
        layout, 0.0, fixed_grasp.pre_open_mm, ignore=frozenset({"fixture", key("fixture fingers")})
    )
    gripper = Scene(layout, 0.0, fixed_grasp.pre_open_mm)
    closed = Scene(layout, 0.0, fixed_grasp.opening_mm)

    def ok(rows_q: FloatArray, rows_grasp: IntArray) -> BoolArray:
        """Free with both jaws at any opening they have here, the part clear of all but them."""
        arm_gripper = gripper_only[0][rows_grasp], gripper_only[1][rows_grasp]
        free = gripper.free(rows_q, CLOSE_MARGIN_MM, arm_gripper=arm_gripper)
        rest = np.flatnonzero(free)
        free[rest] = closed.free(
            rows_q[rest], CLOSE_MARGIN_MM, arm_gripper=(arm_gripper[0][rest], arm_gripper[1][rest])
        )
        rest = np.flatnonzero(free)
        q_rest, of_rest = rows_q[rest], rows_grasp[rest]
        free[rest] = around.free(
            q_rest,
            PART_MARGIN_MM,
            arm_gripper=(closed_grippers[0][of_rest], closed_grippers[1][of_rest]),
            part=(part, T_tcp_part[of_rest]),
        )
        return np.asarray(free)

    keep = np.flatnonzero(ok(q, grasp))
    found: dict[int, HandOff] = {}
    # at most a few branches per grasp are followed along their lines
    tried: dict[int, int] = {}
    chosen = []
    for row in keep:
        g = int(grasp[row])
        if tried.get(g, 0) < 3:
            tried[g] = tried.get(g, 0) + 1
            chosen.append(row)
    if not chosen:
        return {}
    rows = np.array(chosen)
    forward = T_fixed_tcp[:3, 0]
    T_rows = T_hold[grasp[rows]]
    T_in = np.repeat(T_rows[:, None], len(steps), axis=1)
    T_in[..., :3, 3] += steps[None, :, None] * forward
    T_out = np.repeat(T_rows[:, None], len(steps), axis=1)
    T_out[..., :3, 3] -= steps[None, :, None] * T_rows[:, None, :3, 0]
    entry = same_branch(layout, T_in, branch[rows])
    retreat = same_branch(layout, T_out, branch[rows])
    whole = np.isfinite(entry).all(axis=(1, 2)) & np.isfinite(retreat).all(axis=(1, 2))
    rows, entry, retreat = rows[whole], entry[whole], retreat[whole]
    if len(rows) == 0:
        return {}
    k = len(steps)
    owner = np.repeat(grasp[rows], k)
    good = ok(entry.reshape(-1, 6), owner).reshape(-1, k).all(axis=1)
    arm_gripper = gripper_only[0][owner], gripper_only[1][owner]
    good &= (
        closed.free(retreat.reshape(-1, 6), CLOSE_MARGIN_MM, arm_gripper=arm_gripper)
        .reshape(-1, k)
        .all(axis=1)
    )
    for place in np.flatnonzero(good):
        g = int(grasp[rows[place]])
        if g not in found:
            contact = q[rows[place]]
            found[g] = HandOff(
                contact,
                np.vstack([entry[place][::-1], contact]),
                np.vstack([contact, retreat[place]]),
            )
    return found


def _gripper_opening(layout: CellLayout, grasps: Sequence[Grasp]) -> tuple[FloatArray, FloatArray]:
    pairs = [
        stack(
            [
                *layout.arm_gripper.body,
                *layout.arm_gripper.fingers(g.opening_mm, until_mm=g.pre_open_mm),
            ]
        )
        for g in grasps
    ]
    return np.stack([p[0] for p in pairs]), np.stack([p[1] for p in pairs])


def _gripper_closed(layout: CellLayout, grasps: Sequence[Grasp]) -> tuple[FloatArray, FloatArray]:
    pairs = [
        stack([*layout.arm_gripper.body, *layout.arm_gripper.fingers(g.opening_mm)]) for g in grasps
    ]
    return np.stack([p[0] for p in pairs]), np.stack([p[1] for p in pairs])
