"""The stages that move the part, or the arm away from it."""

from .grasp import GraspAction
from .hand_off import HandOffAction
from .place import PlaceAction
from .set_down import SetDownAction
from .withdraw import WithdrawAction

__all__ = [
    "GraspAction",
    "HandOffAction",
    "PlaceAction",
    "SetDownAction",
    "WithdrawAction",
]
