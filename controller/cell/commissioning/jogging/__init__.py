"""Jogging: a person or a script moves the cell by orders, before it is calibrated, too.

`orders.py` reads them, `goals.py` finds where they lead and whether the arm may go there,
`jogger.py` carries them out through the cell's services, `session.py` is the visit.
"""

from .goals import (
    RefusedMotionError,
    clearance_mm,
    inside_limits,
    near_by,
    require_free,
    shifted,
    turned,
)
from .jogger import Jogger, Reading
from .orders import GRAMMAR, JogOrder, Verb, WrongOrderError, read_order
from .session import JogOrders, JogSession, Pilot, Taken

__all__ = [
    "GRAMMAR",
    "JogOrder",
    "JogOrders",
    "JogSession",
    "Jogger",
    "Pilot",
    "Reading",
    "RefusedMotionError",
    "Taken",
    "Verb",
    "WrongOrderError",
    "clearance_mm",
    "inside_limits",
    "near_by",
    "read_order",
    "require_free",
    "shifted",
    "turned",
]
