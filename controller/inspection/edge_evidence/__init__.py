"""Edges of a part in pictures: their places, and their evidence on the part."""

from ._damage import find_damage
from ._depth import Floor, FloorLook, find_floor
from ._displaced import Displaced, find_displaced
from ._edges import KEPT_PARTS, PartEdges, find_edges
from ._faces import FaceEdges, MissingEdge
from ._floor_light import BlindBore, blind_bore, rise_by_light
from ._looks import EdgeLook, EdgeLooks, State, look_at_edges
from ._other_looks import refuted
from .evidence import EdgeEvidence, closest_pixel_mm, find_evidence

__all__ = [
    "KEPT_PARTS",
    "BlindBore",
    "Displaced",
    "EdgeEvidence",
    "EdgeLook",
    "EdgeLooks",
    "FaceEdges",
    "Floor",
    "FloorLook",
    "MissingEdge",
    "PartEdges",
    "State",
    "blind_bore",
    "closest_pixel_mm",
    "find_damage",
    "find_displaced",
    "find_edges",
    "find_evidence",
    "find_floor",
    "look_at_edges",
    "refuted",
    "rise_by_light",
]
