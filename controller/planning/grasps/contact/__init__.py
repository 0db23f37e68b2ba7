"""What the pads of a gripper touch, and how much of the friction limit the part's weight uses."""

from ._pads import Contacts, PadGrid, close_pads
from ._strength import GRAVITY_N_PER_KG, least_load, loads, still_gravities

__all__ = [
    "GRAVITY_N_PER_KG",
    "Contacts",
    "PadGrid",
    "close_pads",
    "least_load",
    "loads",
    "still_gravities",
]
