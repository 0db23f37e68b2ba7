"""A Universal Robots e-Series arm: joints and controller (`UrArm`), its ports (`UrServer`).

A second reading of universal_robots.md, shared with nobody. `python -m emulators.ur_arm` serves one
arm without a world.
"""

from ._facts import (
    CYCLE_S,
    DH_ALPHA_RAD,
    JOINTS,
    MODELS,
    UR3E,
    UR5E,
    UR10E,
    Software,
    UrFacts,
    software_of,
)
from ._kinematics import flange_pose, inverse, link_poses, pose_of, pose_vector
from ._model import JointErrors, Message, UrArm, UrJoints
from ._modes import JointMode, RobotMode, RuntimeState, SafetyMode
from ._motion import JointMove, Ramp, Sample
from ._script import Program, ScriptError, ScriptReader
from ._server import STANDARD_PORTS, Faults, Ports, UrServer
from ._verbs import UrVerbs
from .wires import DashboardSession, RtdeSession, UrcapSession

__all__ = [
    "CYCLE_S",
    "DH_ALPHA_RAD",
    "JOINTS",
    "MODELS",
    "STANDARD_PORTS",
    "UR3E",
    "UR5E",
    "UR10E",
    "DashboardSession",
    "Faults",
    "JointErrors",
    "JointMode",
    "JointMove",
    "Message",
    "Ports",
    "Program",
    "Ramp",
    "RobotMode",
    "RtdeSession",
    "RuntimeState",
    "SafetyMode",
    "Sample",
    "ScriptError",
    "ScriptReader",
    "Software",
    "UrArm",
    "UrFacts",
    "UrJoints",
    "UrServer",
    "UrVerbs",
    "UrcapSession",
    "flange_pose",
    "inverse",
    "link_poses",
    "pose_of",
    "pose_vector",
    "software_of",
]
