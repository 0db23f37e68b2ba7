"""How a part gets shown: grips, views, hand-offs, motions, their forecast, and "why not".

Arrays and dataclasses in, dataclasses out; no files, no clock, no device; same input, same plan.
The approach is that of planning.md 1.3 and 2.2.
"""

from ._planner import plan_from, plan_part
from ._prepare import prepare_part, with_grips, with_rests
from .certificates import Certificate, certify
from .errors import NoMotionError, NoPlanError, NotGraspableError, OutOfReachError
from .grip import Grip, GripRules
from .grips import resting_pose
from .layout import Box, CellLayout, Jaw, Pace, Tray
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
    shown_pose,
)
from .prepared import PlanOptions, PreparedPart
from .settling import Reading, plan_in_doubt, told
from .starts import InArm, InFixture, OnTable, Start

__all__ = [
    "Box",
    "CellLayout",
    "Certificate",
    "Doubt",
    "Grip",
    "GripRules",
    "HandOver",
    "InArm",
    "InFixture",
    "Jaw",
    "Look",
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
    "Reading",
    "Reason",
    "SetDown",
    "Start",
    "Step",
    "TakeBack",
    "Tray",
    "Unseen",
    "certify",
    "plan_from",
    "plan_in_doubt",
    "plan_part",
    "prepare_part",
    "resting_pose",
    "shown_pose",
    "told",
    "with_grips",
    "with_rests",
]
