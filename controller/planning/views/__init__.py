"""What can be seen of a part, and what the hand leaves in sight."""

from ._views import (
    Directions,
    candidate_directions,
    hidden_by_hand,
    reachable_views,
    view_poses,
    visible_from,
)

__all__ = [
    "Directions",
    "candidate_directions",
    "hidden_by_hand",
    "reachable_views",
    "view_poses",
    "visible_from",
]
