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
from .jogger import ArmReading, Jogger
from .orders import GRAMMAR, JogOrder, Verb, WrongOrderError, read_order
from .session import JogOrders, JogSession, Pilot, TakenOver

__all__ = [
    "GRAMMAR",
    "ArmReading",
    "JogOrder",
    "JogOrders",
    "JogSession",
    "Jogger",
    "Pilot",
    "RefusedMotionError",
    "TakenOver",
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
