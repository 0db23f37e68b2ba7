"""The fingers of the arm gripper: looked at before the panel, and set down by a person."""

from .guided import close_the_fingers, path_above, set_down
from .look import look_at_the_fingers

__all__ = ["close_the_fingers", "look_at_the_fingers", "path_above", "set_down"]
