"""The stages that look at the part: acquiring, recognising, presenting, inspecting."""

from .acquire import AcquireAction
from .inspect import InspectAction
from .present import PresentAction, lamps_for
from .recognise import RecogniseAction

__all__ = [
    "AcquireAction",
    "InspectAction",
    "PresentAction",
    "RecogniseAction",
    "lamps_for",
]
