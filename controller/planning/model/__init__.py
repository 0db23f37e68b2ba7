"""Data of planning: the cell, grasps, visibility, steps and plans, and reasons for no plan.

Dataclasses and names; nothing here plans. mm, rad and seconds; poses in the world frame.
"""

from .arm import JOINT_COUNT, ArmLink, ArmModel, JointLimit, TimingModel
from .errors import NoMotionError, NoPlanError, NotGraspableError, OutOfReachError
from .grasp import TABLE_MARGIN_MM, Grasp, GraspRules, Holder
from .hypotheses import LIGHTS, HeldHypothesis, Light
from .layout import CellLayout, CellTimes, Jaw, Nest, Pads, Tray
from .plan import (
    Ambiguity,
    GiveStep,
    JointPath,
    Look,
    Park,
    Pick,
    Place,
    Plan,
    Present,
    Proof,
    Reason,
    ReceiveStep,
    SetDown,
    Step,
    Unseen,
    lit_count,
)
from .prepared import FaceToShowAgain, HandOff, PlanOptions, PreparedPart, Rest, of_faces
from .starts import InArm, InFixedGripper, OnTable, Start
from .visibility import BoreOpenings, Counted, Directions, HiddenEvidence, VisibilityTable

__all__ = [
    "JOINT_COUNT",
    "LIGHTS",
    "TABLE_MARGIN_MM",
    "Ambiguity",
    "ArmLink",
    "ArmModel",
    "BoreOpenings",
    "CellLayout",
    "CellTimes",
    "Counted",
    "Directions",
    "FaceToShowAgain",
    "GiveStep",
    "Grasp",
    "GraspRules",
    "HandOff",
    "HeldHypothesis",
    "HiddenEvidence",
    "Holder",
    "InArm",
    "InFixedGripper",
    "Jaw",
    "JointLimit",
    "JointPath",
    "Light",
    "Look",
    "Nest",
    "NoMotionError",
    "NoPlanError",
    "NotGraspableError",
    "OnTable",
    "OutOfReachError",
    "Pads",
    "Park",
    "Pick",
    "Place",
    "Plan",
    "PlanOptions",
    "PreparedPart",
    "Present",
    "Proof",
    "Reason",
    "ReceiveStep",
    "Rest",
    "SetDown",
    "Start",
    "Step",
    "TimingModel",
    "Tray",
    "Unseen",
    "VisibilityTable",
    "lit_count",
    "of_faces",
]
