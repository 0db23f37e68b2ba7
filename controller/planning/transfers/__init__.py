"""Taking the part up, passing it over, putting it down."""

from ._handoff import hand_offs
from ._pick import PickWay, pick_ways
from ._place import PlaceWay, place_ways
from ._table import rests, set_downs

__all__ = ["PickWay", "PlaceWay", "hand_offs", "pick_ways", "place_ways", "rests", "set_downs"]
