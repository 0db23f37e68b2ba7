"""Pictures of fingers and plates -> the TCP of the arm gripper and its opening.

Arrays in, dataclasses out; what the arm and the cameras are comes from `kinematics`.
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

__all__ = [
    "FingerLook",
    "FingerRays",
    "FingerShape",
    "FingersError",
    "TcpFit",
    "finger_rays",
    "locate_tcp",
    "look_at_fingers",
]
