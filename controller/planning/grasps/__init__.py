"""Grasps of a part by a jaw, and the choice of those to plan with."""

from ._select import clear_of_table, resting_pose, select_arm_grasps, spread, turned_over
from ._synthesis import GraspProblem, Synthesis, judge_grasps, synthesise_grasps
from .contact import still_gravities
from .judge import FilterStage
from .seeds import FacePair, Seeds, find_seeds, needed_friction, opposed_faces

__all__ = [
    "FacePair",
    "FilterStage",
    "GraspProblem",
    "Seeds",
    "Synthesis",
    "clear_of_table",
    "find_seeds",
    "judge_grasps",
    "needed_friction",
    "opposed_faces",
    "resting_pose",
    "select_arm_grasps",
    "spread",
    "still_gravities",
    "synthesise_grasps",
    "turned_over",
]
