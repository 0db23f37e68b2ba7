"""Where the arm can be, what it touches there, and its ways from one place to the other."""

from ._lines import fewest_waypoints, same_branch
from ._scene import Scene, inverse_rows, tip_pose
from ._ways import connect, move_seconds, path_free

__all__ = [
    "Scene",
    "connect",
    "fewest_waypoints",
    "inverse_rows",
    "move_seconds",
    "path_free",
    "same_branch",
    "tip_pose",
]
