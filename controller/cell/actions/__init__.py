"""What the cell does in each state: an action per effect of the table, each ending in one event.

An action is a small object with the services it needs in its constructor; `run` reads like a page.
Which services there are: `controller.cell.services`. Who puts them together:
`controller.cell.assembly`.
"""

from .acquire import AcquireAction
from .action import Action, Actions
from .complete import CompleteAction
from .grasp import GraspAction
from .hand_off import HandOffAction
from .home import HomeAction
from .inspect import InspectAction
from .place import PlaceAction
from .plan import PlanAction
from .present import PresentAction, lamps_for
from .recognise import RecogniseAction
from .set_down import SetDownAction
from .stop import AbortMotionAction, ClearFaultAction, HoldAction, StopMotionAction
from .withdraw import WithdrawAction

__all__ = [
    "AbortMotionAction",
    "AcquireAction",
    "Action",
    "Actions",
    "ClearFaultAction",
    "CompleteAction",
    "GraspAction",
    "HandOffAction",
    "HoldAction",
    "HomeAction",
    "InspectAction",
    "PlaceAction",
    "PlanAction",
    "PresentAction",
    "RecogniseAction",
    "SetDownAction",
    "StopMotionAction",
    "WithdrawAction",
    "lamps_for",
]
