"""Contacts of a gripper's pads, and the share of the friction limit that the weight uses."""

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
