"""What the actions of the cell work with: one small service for each thing there is to do.

A service is handed to an action by its constructor and is used through its public names only. None
of them decides what comes next; that is for the actions and for the table.
"""

from .grippers import Grippers
from .imaging import CameraName, Imaging
from .motion import Motion
from .preparation import Preparation
from .recoveries import Recoveries
from .steps import PlanSteps
from .views import Disambiguation, HeldPose, Views

__all__ = [
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
