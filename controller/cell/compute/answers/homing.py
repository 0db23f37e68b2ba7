"""Answers about motions that are no plan: the path home, homing with a part, and back."""

import numpy as np

from controller.arrays import FloatArray
from controller.cell.custody import ALONE, Around
from controller.imaging import inverse_pose
from controller.planning import (
    Box,
    JointPath,
)
from controller.planning.motion import (
    ProvenMove,
    Scene,
    Swept,
    connect,
    prove_move,
    prove_sweep,
)
from messages import key, say

from ..job import Job, context
from ..neighbours import layout_among


def path_home(
    job: Job,
    q: FloatArray,
    arm_opening_mm: float,
    fixed_opening_mm: float,
    T_part_tcp: FloatArray | None,
    around: Around = ALONE,
) -> JointPath:
    """Return a joint path from any configuration to the park position.

    Parameters
    ----------
    job : recipe and cell
    q : (6,) configuration of the arm
    arm_opening_mm, fixed_opening_mm : openings of both grippers
    T_part_tcp : (4, 4) pose of a part that may still be in the arm gripper, or None
    around : other objects in the cell

    Raises
    ------
    NoMotionError : no path is free of contact
    """
    c = context(job)
    carried = None if T_part_tcp is None else _part_box(job, inverse_pose(T_part_tcp))
    scene = Scene(layout_among(c, around), arm_opening_mm, fixed_opening_mm, carried)
    return connect(q, c.layout.park_q, scene, say("{name}: path home", name=c.solid.name))


def homing_swept(
    job: Job,
    low: FloatArray,
    high: FloatArray,
    arm_opening_mm: float | None,
    T_part_tcp: FloatArray | None,
    fixed_opening_mm: float,
    T_part_fixed: FloatArray | None,
    around: Around = ALONE,
) -> Swept:
    """Return whether homing without opening a jaw is free of contact all the way.

    Parameters
    ----------
    job : recipe and cell
    low, high : (6,) bounds of where the arm stands
    arm_opening_mm : opening of the arm gripper on the part; None for an empty one, however wide
    T_part_tcp : (4, 4) pose of a part in the arm gripper, or None
    fixed_opening_mm : opening of the fixed gripper
    T_part_fixed : (4, 4) T_part_tcp of a part in the fixed gripper, or None
    around : other objects in the cell
    """
    layout = layout_among(context(job), around)
    phases = layout.arm.homing_sweep(low, high)
    if not phases:
        return Swept(
            phase=key("it homes"), touches=key("everything: this arm has no homing with a part")
        )
    carried, standing = _held(job, T_part_tcp, T_part_fixed)
    # an empty gripper may stand at any opening: its fingers reach furthest when it is wide open,
    # and stand between when it is shut
    openings = (layout.arm_gripper.max_mm, 0.0) if arm_opening_mm is None else (arm_opening_mm,)
    swept = Swept()
    for opening_mm in openings:
        scene = Scene(layout, opening_mm, fixed_opening_mm, carried, standing)
        swept = prove_sweep(scene, phases)
        if not swept.is_free:
            break
    return swept


def proven_back(
    job: Job,
    q: FloatArray,
    q_begin: FloatArray,
    arm_opening_mm: float,
    T_part_tcp: FloatArray | None,
    fixed_opening_mm: float,
    T_part_fixed: FloatArray | None,
    around: Around = ALONE,
) -> ProvenMove:
    """Return the move back to its start, free of contact whichever axis goes first.

    Parameters
    ----------
    job : recipe and cell
    q : (6,) present joints of the arm
    q_begin : (6,) joints at the start of its move
    arm_opening_mm, fixed_opening_mm : openings of the two grippers
    T_part_tcp : (4, 4) pose of a part in the arm gripper, or None
    T_part_fixed : (4, 4) T_part_tcp of a part in the fixed gripper, or None
    around : other objects in the cell
    """
    layout = layout_among(context(job), around)
    carried, standing = _held(job, T_part_tcp, T_part_fixed)
    scene = Scene(layout, arm_opening_mm, fixed_opening_mm, carried, standing)
    return prove_move(scene, q, q_begin)


def _held(
    job: Job, T_part_tcp: FloatArray | None, T_part_fixed: FloatArray | None
) -> tuple[Box | None, tuple[Box, ...]]:
    """Return a part in the arm gripper in the TCP frame, and one in the fixed gripper's jaws."""
    carried = None if T_part_tcp is None else _part_box(job, inverse_pose(T_part_tcp))
    if T_part_fixed is None:
        return carried, ()
    T_world_part = context(job).layout.T_world_fixed_tcp @ inverse_pose(T_part_fixed)
    return carried, (_part_box(job, T_world_part),)


def _part_box(job: Job, T: FloatArray) -> Box:
    """Return the part's bounding box, placed by T (4, 4)."""
    low, high = context(job).solid.mesh.bounds
    return Box.from_bounds(*np.column_stack([low, high]).ravel()).placed(T)
