"""Pictures of fingers -> TCP and opening of the arm gripper; touches -> pose of the fixed one.

Arrays in, dataclasses out; the models of arm and cameras come from `kinematics`.
"""

from .fingers import (
    FingerLook,
    FingerRays,
    FingersError,
    FingerShape,
    TcpFit,
    finger_rays,
    locate_tcp,
    look_at_fingers,
)
from .fixed import FixedGripperFit, Touch, TouchError, TouchNoise, locate_fixed_gripper

__all__ = [
    "FingerLook",
    "FingerRays",
    "FingerShape",
    "FingersError",
    "FixedGripperFit",
    "TcpFit",
    "Touch",
    "TouchError",
    "TouchNoise",
    "finger_rays",
    "locate_fixed_gripper",
    "locate_tcp",
    "look_at_fingers",
]
