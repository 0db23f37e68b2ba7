"""Holes and outer cylinders of a part: coaxial walls, their name and their mouth."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from controller.arrays import FloatArray
from controller.cad import Crease, Solid
from messages import say

from .._types import Rim
from ..edges import RoundWall
from ..edges.rims import COAXIAL_COS, SAME_MM, are_coaxial
from .sheet import size_text

# Least sweep of a wall with a diameter; drawings give the radius of arcs up to a half circle.
MIN_DIAMETER_RAD: Final = np.radians(190.0)
MIN_DEPTH_MM: Final = 0.5  # least depth of a wall; shallower ones are marks and letters


@dataclass(frozen=True, eq=False, slots=True)
class RoundFeature:
    """A hole or an outer cylinder, all walls on its axis.

    Attributes
    ----------
    walls : walls of a hole from the narrowest, of an outer cylinder from the widest; each has a rim
        of more than half a circle
    axis : (3,) unit, out of its mouth: the side of its widest rim; of two equal ones, the one
        towards the positive side of the axis
    centre_mm : (3,) centre of the rim at the mouth
    is_hole : True for a hole, False for an outer cylinder
    """

    walls: tuple[RoundWall, ...]
    axis: FloatArray
    centre_mm: FloatArray
    is_hole: bool

    @property
    def name(self) -> str:
        """Kind and size, such as ``hole 6.76 mm``."""
        return say(
            "{what} {size_text}",
            what="hole" if self.is_hole else "boss",
            size_text=size_text(2 * self.walls[0].radius_mm),
        )


def diameter_rims(wall: RoundWall) -> tuple[Rim, ...]:
    """Return the rims of a wall that sweep more than half a circle."""
    return tuple(rim for rim in wall.rims if rim.sweep_rad > MIN_DIAMETER_RAD)


def round_features(solid: Solid, walls: tuple[RoundWall, ...]) -> tuple[RoundFeature, ...]:
    """Return the holes and outer cylinders that have a diameter to measure."""
    usable = [wall for wall in walls if diameter_rims(wall) and wall.height_mm >= MIN_DEPTH_MM]
    neighbours = _neighbours(solid)
    root = list(range(len(usable)))

    def first(i: int) -> int:
        while root[i] != i:
            i = root[i]
        return i

    for i, j in _near_axes(usable):
        one, other = usable[i], usable[j]
        if not are_coaxial(one.axis, one.centre_mm, other.axis, other.centre_mm):
            continue
        beside, beside_other = (
            set().union(*(neighbours[face] for face in wall.faces)) for wall in (one, other)
        )
        if beside & beside_other or beside & set(other.faces):
            low, high = sorted((first(i), first(j)))
            root[high] = low
    grouped: dict[int, list[RoundWall]] = {}
    for i, wall in enumerate(usable):
        grouped.setdefault(first(i), []).append(wall)
    return tuple(_feature(group) for group in grouped.values())


def _near_axes(walls: list[RoundWall]) -> list[tuple[int, int]]:
    """Return the pairs of hole walls that may share an axis, by its nearest point to the origin.

    A plate may have a thousand bores, and comparing all pairs would take quadratic time.
    """
    holes = [i for i, wall in enumerate(walls) if wall.is_hole]
    if len(holes) < 2:
        return []
    centres = np.array([walls[i].centre_mm for i in holes])
    axes = np.array([walls[i].axis for i in holes])
    along = (centres * axes).sum(axis=1)
    feet = centres - along[:, None] * axes
    # Coaxial walls may be slightly inclined, and the offset grows with the distance to the origin.
    lean = 2 * float(np.sqrt(1 - COAXIAL_COS**2)) * float(np.abs(along).max())
    pairs = cKDTree(feet).query_pairs(SAME_MM + lean)
    return sorted((holes[i], holes[j]) for i, j in pairs)


def inner_faces(solid: Solid, features: Iterable[RoundFeature]) -> frozenset[int]:
    """Return the ledges and bottoms of holes: faces all of whose edges belong to hole walls."""
    inside = {i for f in features if f.is_hole for wall in f.walls for i in wall.faces}
    beside = _neighbours(solid)
    return frozenset(
        face.id
        for face in solid.faces
        if face.kind != "cylinder" and beside[face.id] and beside[face.id] <= inside
    )


def ends_inside(solid: Solid, wall: RoundWall, inner: frozenset[int]) -> bool:
    """Return True if a wall of a hole ends at a ledge or a bottom, below its mouth.

    Parameters
    ----------
    solid : the part
    wall : wall of a hole
    inner : faces from `inner_faces`
    """
    b = solid.boundary
    of_wall = np.isin(b.face, wall.faces)
    beyond = b.face[np.nonzero(of_wall)[0] ^ 1]
    concave = b.crease[np.nonzero(of_wall)[0] // 2] == Crease.CONCAVE
    return bool(np.isin(beyond[concave], list(inner)).any())


def _neighbours(solid: Solid) -> list[set[int]]:
    b = solid.boundary
    beside: list[set[int]] = [set() for _ in solid.faces]
    for half_edge, face in enumerate(b.face.tolist()):
        beside[face].add(int(b.face[half_edge ^ 1]))
    return beside


def _feature(walls: list[RoundWall]) -> RoundFeature:
    is_hole = walls[0].is_hole
    ordered = sorted(walls, key=lambda wall: wall.radius_mm * (1 if is_hole else -1))
    rims = [rim for wall in ordered for rim in diameter_rims(wall)]
    mouth = max(rims, key=_mouth_rank)
    return RoundFeature(tuple(ordered), mouth.axis, mouth.centre_mm, is_hole)


def _mouth_rank(rim: Rim) -> tuple[float, bool, float]:
    axis = rim.axis
    main = int(np.abs(axis).argmax())
    return round(rim.radius_mm, 2), bool(axis[main] > 0), float(rim.centre_mm @ axis)
