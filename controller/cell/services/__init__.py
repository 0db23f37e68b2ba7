"""What the actions of the cell work with: one small service for each thing there is to do.

A service is handed to an action by its constructor and is used through its public names only. None
of them decides what comes next; that is for the actions and for the table.
"""

from .disambiguation import Disambiguation
from .grippers import Grippers
from .held_pose import HeldPose
from .imaging import CameraName, Imaging
from .motion import Motion
from .preparation import Preparation
from .record import BatchRecord
from .recoveries import Recoveries
from .steps import PlanSteps
from .views import Views

__all__ = [
    "BatchRecord",
    "CameraName",
    "Disambiguation",
    "Grippers",
    "HeldPose",
    "Imaging",
    "Motion",
    "PlanSteps",
    "Preparation",
    "Recoveries",
    "Views",
]
