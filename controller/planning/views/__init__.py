"""Visibility of a part: directions, and the surface that part, gripper and arm leave in sight.

Directions are unit vectors in the part frame from its centre of mass to the camera.
"""

from ..model import Directions, VisibilityTable
from ._poses import Showing, hold_up, view_poses
from ._reach import GraspViews, reachable_views
from .counting import CameraSight, Counter, nearest_on_face
from .gripper import hidden_by_gripper, holding_boxes
from .light import by_element, directions_to_openings, find_openings, lit_from, lit_past
from .visibility import (
    VisibilityRules,
    candidate_directions,
    directions_into_wedges,
    even_sphere,
    eyes_of,
    hidden_ones,
    in_picture,
    look_out,
    most_worth,
    table_views,
    visible_from,
    why_hidden,
    with_directions,
)

__all__ = [
    "CameraSight",
    "Counter",
    "Directions",
    "GraspViews",
    "Showing",
    "VisibilityRules",
    "VisibilityTable",
    "by_element",
    "candidate_directions",
    "directions_into_wedges",
    "directions_to_openings",
    "even_sphere",
    "eyes_of",
    "find_openings",
    "hidden_by_gripper",
    "hidden_ones",
    "hold_up",
    "holding_boxes",
    "in_picture",
    "lit_from",
    "lit_past",
    "look_out",
    "most_worth",
    "nearest_on_face",
    "reachable_views",
    "table_views",
    "view_poses",
    "visible_from",
    "why_hidden",
    "with_directions",
]
