"""What planning speaks of: the cell, grips, visibility, steps and plans, and why there is none.

Dataclasses and names; nothing here plans. mm, rad and seconds; poses in the world frame.
"""

from .arm import JOINT_COUNT, ArmLink, ArmModel, TimingModel
from .candidates import LIGHTS, Candidate, Light
from .errors import NoMotionError, NoPlanError, NotGraspableError, OutOfReachError
from .grip import TABLE_MARGIN_MM, Grip, GripRules, Holder
from .layout import CellLayout, Jaw, Pace, Tray
from .plan import (
    Doubt,
    HandOver,
    Look,
    Motion,
    Park,
    Pick,
    Place,
    Plan,
    Present,
    Proof,
    Reason,
    SetDown,
    Step,
    TakeBack,
    Unseen,
)
from .prepared import HandOff, PlanOptions, PreparedPart, Rest
from .starts import InArm, InFixture, OnTable, Start
from .visibility import Directions, Lookout

__all__ = [
    "JOINT_COUNT",
    "LIGHTS",
    "TABLE_MARGIN_MM",
    "ArmLink",
    "ArmModel",
    "Candidate",
    "CellLayout",
    "Directions",
    "Doubt",
    "Grip",
    "GripRules",
    "HandOff",
    "HandOver",
    "Holder",
    "InArm",
    "InFixture",
    "Jaw",
    "Light",
    "Look",
    "Lookout",
    "Motion",
    "NoMotionError",
    "NoPlanError",
    "NotGraspableError",
    "OnTable",
    "OutOfReachError",
    "Pace",
    "Park",
    "Pick",
    "Place",
    "Plan",
    "PlanOptions",
    "PreparedPart",
    "Present",
    "Proof",
    "Reason",
    "Rest",
    "SetDown",
    "Start",
    "Step",
    "TakeBack",
    "TimingModel",
    "Tray",
    "Unseen",
]
