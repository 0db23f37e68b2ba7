"""The cell's action in each state: one per effect of the table, each ending in one event.

An action is a small object with the services it needs in its constructor; `run` reads like a page.
The stages that look at the part are in `perception`, those that move it in `manipulation`. The
services are in `controller.cell.services`; `controller.cell.batch.assembly` hands them out.
"""

from .action import Action, Actions
from .complete import CompleteAction
from .consult import ConsultAction
from .home import HomeAction, ReadyAction, ResetAction
from .manipulation import GraspAction, HandOffAction, PlaceAction, SetDownAction, WithdrawAction
from .pause import SuspendAction, UnsuspendAction
from .perception import AcquireAction, InspectAction, PresentAction, RecogniseAction, lamps_for
from .plan import PlanAction
from .recover import RecoverAction
from .stop import AbortMotionAction, ClearFaultAction, HoldAction, StopMotionAction

__all__ = [
    "AbortMotionAction",
    "AcquireAction",
    "Action",
    "Actions",
    "ClearFaultAction",
    "CompleteAction",
    "ConsultAction",
    "GraspAction",
    "HandOffAction",
    "HoldAction",
    "HomeAction",
    "InspectAction",
    "PlaceAction",
    "PlanAction",
    "PresentAction",
    "ReadyAction",
    "RecogniseAction",
    "RecoverAction",
    "ResetAction",
    "SetDownAction",
    "StopMotionAction",
    "SuspendAction",
    "UnsuspendAction",
    "WithdrawAction",
    "lamps_for",
]
