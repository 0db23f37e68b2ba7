"""The checks before every motion: the gate, which holds a pause, and the permit."""

from .approval import Approval
from .gate import JAWS_S, STOP_RAMP_S, Gate, Mover
from .permits import Permit, Permits

__all__ = ["JAWS_S", "STOP_RAMP_S", "Approval", "Gate", "Mover", "Permit", "Permits"]
