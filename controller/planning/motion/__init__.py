"""Reach, contacts and paths of the arm, from one configuration to another."""

from ..geometry import PartShape, PlacedShape
from ._kinematics import inverse_rows, link_boxes, passed_limit, shown_pose, slides, tcp_pose
from ._lines import fewest_waypoints, same_branch
from ._paths import connect, path_free
from .scene import Scene
from .segments import END_MARGIN_MM, MARGIN_MM
from .sweep import SWEEP_MARGIN_MM, ProvenMove, Swept, prove_move, prove_sweep
from .timing import move_seconds, segment_seconds, segment_tube, travel_seconds

__all__ = [
    "END_MARGIN_MM",
    "MARGIN_MM",
    "SWEEP_MARGIN_MM",
    "PartShape",
    "PlacedShape",
    "ProvenMove",
    "Scene",
    "Swept",
    "connect",
    "fewest_waypoints",
    "inverse_rows",
    "link_boxes",
    "move_seconds",
    "passed_limit",
    "path_free",
    "prove_move",
    "prove_sweep",
    "same_branch",
    "segment_seconds",
    "segment_tube",
    "shown_pose",
    "slides",
    "tcp_pose",
    "travel_seconds",
]
