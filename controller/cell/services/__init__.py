"""The services of actions: one small service each for motion, grippers, imaging, views and so on.

An action gets its services in its constructor and uses their public names only. No service decides
on the next step; actions and the table do.
"""

from .codes import Codes
from .faults import Recoveries, Retries, fault_policy, faults_section
from .gate import Approval, Gate, Mover, Permit, Permits
from .going_on import Resumption, Standstill, hold_of, park_interrupted, verdict_of
from .grippers import Grippers
from .imaging import CameraName, Imaging
from .interlocks import Interlocks
from .leases import Leases
from .motion import Motion
from .steps import PlanSteps
from .table import Preparation
from .views import (
    Background,
    Disambiguation,
    HeldPose,
    JudgingAhead,
    PartFileWriter,
    StoredViews,
    Views,
    plain_name,
)

__all__ = [
    "Approval",
    "Background",
    "CameraName",
    "Codes",
    "Disambiguation",
    "Gate",
    "Grippers",
    "HeldPose",
    "Imaging",
    "Interlocks",
    "JudgingAhead",
    "Leases",
    "Motion",
    "Mover",
    "PartFileWriter",
    "Permit",
    "Permits",
    "PlanSteps",
    "Preparation",
    "Recoveries",
    "Resumption",
    "Retries",
    "Standstill",
    "StoredViews",
    "Views",
    "fault_policy",
    "faults_section",
    "hold_of",
    "park_interrupted",
    "plain_name",
    "verdict_of",
]
