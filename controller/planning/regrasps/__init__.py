"""Regrasps: pick, hand-off, set-down."""

from ._handoff import hand_offs
from ._neighbours import clear_hand_offs
from ._pick import PickPath, is_pickable, pick_paths
from ._place import PlacePath, is_steady, place_paths, stands_steadily
from ._table import rests, set_downs

__all__ = [
    "PickPath",
    "PlacePath",
    "clear_hand_offs",
    "hand_offs",
    "is_pickable",
    "is_steady",
    "pick_paths",
    "place_paths",
    "rests",
    "set_downs",
    "stands_steadily",
]
