"""Possible starts of a plan: where the part is now, as measured and not as planned."""

from __future__ import annotations

from dataclasses import dataclass

from controller.arrays import FloatArray

from .grasp import Grasp


@dataclass(frozen=True, slots=True, eq=False)
class OnTable:
    """The part lies on the table.

    Attributes
    ----------
    pose_index : index of the stable pose, -1 if it leans
    T_world_part : (4, 4) pose as seen
    q : (6,) joints of the arm, None for its park position
    """

    pose_index: int
    T_world_part: FloatArray
    q: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class InArm:
    """The arm holds the part.

    Attributes
    ----------
    grasp : with `T_part_tcp` and opening as measured; its id may be that of a planned grasp
    q : (6,) joints of the arm, free of contact with all but the part
    """

    grasp: Grasp
    q: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class InFixedGripper:
    """The fixed gripper alone holds the part.

    Attributes
    ----------
    grasp : grasp of the fixed gripper, as measured
    q : (6,) joints of the empty arm
    """

    grasp: Grasp
    q: FloatArray


Start = OnTable | InArm | InFixedGripper
