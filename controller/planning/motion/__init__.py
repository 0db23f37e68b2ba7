"""Where the arm can be, what it touches there, and its ways from one place to the other."""

from ..geometry import PartShape, PlacedShape
from ._kinematics import inverse_rows, link_boxes, passed_limit, shown_pose, tip_pose
from ._lines import fewest_waypoints, same_branch
from ._ways import connect, path_free
from .scene import Scene
from .timing import leg_seconds, leg_tube, move_seconds, travel_seconds

__all__ = [
    "PartShape",
    "PlacedShape",
    "Scene",
    "connect",
    "fewest_waypoints",
    "inverse_rows",
    "leg_seconds",
    "leg_tube",
    "link_boxes",
    "move_seconds",
    "passed_limit",
    "path_free",
    "same_branch",
    "shown_pose",
    "tip_pose",
    "travel_seconds",
]
