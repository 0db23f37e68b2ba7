"""Putting the part down on the table to take it up with another grasp.

The part comes straight down and the arm gripper leaves along its approach; picking it up again is
the same two lines in reverse, so a place on the table serves like the fixed gripper.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from controller.arrays import FloatArray
from controller.cad import Solid, StablePose
from controller.imaging import inverse_pose

from ..geometry import PartShape, PlacedShape, stack
from ..grasps import clear_of_table, resting_pose
from ..model import TABLE_MARGIN_MM, CellLayout, Grasp, HandOff, Rest
from ..motion import Scene, inverse_rows, same_branch
from ._handoff import APPROACH_MM, CLOSE_MARGIN_MM, PART_MARGIN_MM, STEP_MM
from ._neighbours import free_spot

TURN_COUNT = 8  # turns about the vertical for each stable pose
KEPT_BRANCH_COUNT = 2
# Margin to the table on which the part is put, which it touches; the bounding box reaches lower.
PART_TABLE_MARGIN_MM = -1.0


def rests(solid: Solid, poses: Sequence[StablePose], layout: CellLayout) -> tuple[Rest, ...]:
    """Return the stable poses for setting the part down, in the middle of the area for that.

    With neighbours on the table it is where the area is farthest from them.

    A pose that tips when it is lifted by half a millimetre, or rolls, or rocks, is no target
    (planning-facts.md 4).

    Parameters
    ----------
    solid : the part
    poses : its stable poses
    layout : the cell; `set_down_mm` is that area
    """
    x, y = free_spot(layout)
    return tuple(
        Rest(pose.index, resting_pose(solid, pose, float(x), float(y), 2 * np.pi * k / TURN_COUNT))
        for pose in poses
        if not (pose.rolling or pose.marginal or pose.rocking)
        for k in range(TURN_COUNT)
    )


def set_downs(
    layout: CellLayout, part: PartShape, rest: Rest, arm_gripper_grasps: Sequence[Grasp]
) -> dict[int, HandOff]:
    """Return the ways to set the part down in one rest, by place of the arm grasp in the sequence.

    Parameters
    ----------
    layout : the cell
    part : its triangles
    rest : stable pose and position on the table
    arm_gripper_grasps : grasps of the arm gripper
    """
    members = np.flatnonzero(
        clear_of_table(rest.T_world_part, arm_gripper_grasps, layout.arm_gripper)
    )
    if len(members) == 0:
        return {}
    grasps = [arm_gripper_grasps[k] for k in members.tolist()]
    T_hold = np.stack([rest.T_world_part @ g.T_part_tcp for g in grasps])
    index, branch, q = inverse_rows(layout, T_hold)
    if len(index) == 0:
        return {}
    steps = np.arange(1, round(APPROACH_MM / STEP_MM) + 1) * STEP_MM
    T_rows = T_hold[index]
    T_in, T_out = (np.repeat(T_rows[:, None], len(steps), axis=1) for _ in range(2))
    T_in[..., 2, 3] += steps
    T_out[..., :3, 3] -= steps[None, :, None] * T_rows[:, None, :3, 0]
    entry, retreat = same_branch(layout, T_in, branch), same_branch(layout, T_out, branch)
    whole = np.isfinite(entry).all(axis=(1, 2)) & np.isfinite(retreat).all(axis=(1, 2))
    found: dict[int, HandOff] = {}
    tried = np.zeros(len(grasps), dtype=int)
    for row in np.flatnonzero(whole):
        k = int(index[row])
        if int(members[k]) in found or tried[k] == KEPT_BRANCH_COUNT:
            continue
        tried[k] += 1
        if _is_free(layout, part, grasps[k], entry[row], retreat[row], q[row]):
            found[int(members[k])] = HandOff(
                q[row], np.vstack([entry[row][::-1], q[row]]), np.vstack([q[row], retreat[row]])
            )
    return found


def _is_free(
    layout: CellLayout,
    part: PartShape,
    grasp: Grasp,
    entry: FloatArray,
    retreat: FloatArray,
    q: FloatArray,
) -> bool:
    shut = Scene(
        layout,
        grasp.opening_mm,
        layout.fixed_open_mm,
        carried_mesh=PlacedShape(part, inverse_pose(grasp.T_part_tcp)),
    )
    path = np.vstack([q[None], entry])
    if not shut.free(path, PART_MARGIN_MM, PART_TABLE_MARGIN_MM).all():
        return False
    open_ = Scene(layout, grasp.pre_open_mm, layout.fixed_open_mm)
    T_box, half = stack(
        [
            *layout.arm_gripper.body,
            *layout.arm_gripper.fingers(grasp.opening_mm, until_mm=grasp.pre_open_mm),
        ]
    )
    path = np.vstack([q[None], retreat])
    arm_gripper = (
        np.broadcast_to(T_box, (len(path), *T_box.shape)),
        np.broadcast_to(half, (len(path), *half.shape)),
    )
    return bool(open_.free(path, CLOSE_MARGIN_MM, TABLE_MARGIN_MM, arm_gripper=arm_gripper).all())
