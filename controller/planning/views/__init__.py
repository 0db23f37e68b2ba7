"""What can be seen of a part, and from where: what itself, gripper and arm leave in sight.

Directions are unit vectors in the part frame from its centre of mass to the camera.
"""

from ..model import Directions, VisibilityTable
from ._poses import Showing, hold_up, view_poses
from ._reach import GraspViews, reachable_views
from .gripper import hidden_by_gripper, holding_boxes
from .visibility import (
    VisibilityRules,
    candidate_directions,
    even_sphere,
    in_picture,
    look_out,
    table_views,
    visible_from,
    why_hidden,
)

__all__ = [
    "Directions",
    "GraspViews",
    "Showing",
    "VisibilityRules",
    "VisibilityTable",
    "candidate_directions",
    "even_sphere",
    "hidden_by_gripper",
    "hold_up",
    "holding_boxes",
    "in_picture",
    "look_out",
    "reachable_views",
    "table_views",
    "view_poses",
    "visible_from",
    "why_hidden",
]
