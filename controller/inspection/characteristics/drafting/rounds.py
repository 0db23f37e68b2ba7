"""Radii of fillets, rounds and other arcs of less than half a circle, and lengths of slots."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.cad import Feature

from .._types import Rim
from ..edges import RoundWall
from .holes import MIN_DEPTH_MM, MIN_DIAMETER_RAD

# Least sweep of an arc whose radius is measured; that of a shorter arc is lost in its noise.
MIN_ARC_RAD: Final = np.radians(60.0)
MIN_RADIUS_MM: Final = 0.5  # smallest radius in ISO 2768-1


@dataclass(frozen=True, eq=False, slots=True)
class Round:
    """An arc with a radius of its own: its wall and the rims that show it."""

    wall: RoundWall
    rims: tuple[Rim, ...]

    @property
    def name(self) -> str:
        """Kind of round: a fillet in an inner corner, a round on an outer one."""
        return "fillet" if self.wall.is_hole else "round"


@dataclass(frozen=True, eq=False, slots=True)
class RoundSlot:
    """A slot or keyway with round ends: name, faces, sizes, rims of both ends, and open side."""

    word: str
    faces: tuple[int, ...]
    width_mm: float
    length_mm: float
    rims: tuple[Rim, ...]
    axis: FloatArray


def rounds(walls: Sequence[RoundWall], features: Sequence[Feature]) -> list[Round]:
    """Return the arcs from 60 degrees to just over a half circle, except the ends of slots.

    Parameters
    ----------
    walls : round walls of a part
    features : features of the same part; a slot's ends belong to its width
    """
    slotted = {i for f in features if f.kind in ("slot", "keyway") for i in f.faces}
    found = []
    for wall in walls:
        arcs = tuple(r for r in wall.rims if MIN_ARC_RAD <= r.sweep_rad <= MIN_DIAMETER_RAD)
        if not arcs or wall.sweep_rad > MIN_DIAMETER_RAD or slotted & set(wall.faces):
            continue
        if wall.radius_mm >= MIN_RADIUS_MM and wall.height_mm >= MIN_DEPTH_MM:
            found.append(Round(wall, arcs))
    return found


def round_slots(walls: Sequence[RoundWall], features: Sequence[Feature]) -> list[RoundSlot]:
    """Return the slots with round ends that are both visible.

    Parameters
    ----------
    walls : round walls of a part
    features : of the same part
    """
    found = []
    for feature in features:
        if feature.kind not in ("slot", "keyway"):
            continue
        ends = [wall for wall in walls if wall.is_hole and set(wall.faces) <= set(feature.faces)]
        if len(ends) != 2 or not all(end.rims for end in ends):
            continue
        axis = -feature.axis
        # Rims of the mouth come first; a through slot shows on its other side too.
        rims = sorted((r for end in ends for r in end.rims), key=lambda r: -float(r.axis @ axis))
        found.append(
            RoundSlot(
                feature.kind, feature.faces, feature.width_mm, feature.length_mm, tuple(rims), axis
            )
        )
    return found
