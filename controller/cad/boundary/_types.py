"""A solid's boundary: surfaces, and the edges between them as a doubly connected edge list.

The edge list follows the paper (references.md P2.0), but its faces may have several loops, and its
edges know their curve, so that a tessellated bore has two circles and not two polygons.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from controller.arrays import BoolArray, FloatArray, Int32Array
from messages import say

FaceKind = Literal["plane", "cylinder", "cone", "sphere", "torus", "freeform"]

NO_DIRECTION: FloatArray = np.zeros(3)
# A wall that turns further is a bore, a boss, the end of a slot or a lug; a wall that turns less is
# a rounded edge or corner. A few degrees short of a half turn, since facets approximate the wall.
HALF_TURN_RAD: Final = float(np.radians(170.0))
_ARCS_RAD: Final = np.linspace(2 * np.pi, 1e-6, 721)
_ARC_SHARES: Final = np.sin(_ARCS_RAD / 2) / (_ARCS_RAD / 2)


def turn_of(mean_share: float) -> float:
    """Return the angle of an arc [rad] from the length of its mean normal, sin(a/2) / (a/2).

    Parameters
    ----------
    mean_share : length of the mean of unit normals, weighted by area
    """
    return float(np.interp(mean_share, _ARC_SHARES, _ARCS_RAD))


@dataclass(frozen=True, eq=False, slots=True)
class Face:
    """One surface of the part, in the CAD frame.

    Attributes
    ----------
    id : number of the face, from 0, largest area first
    kind : type of the surface
    area_mm2 : its area
    normal : (3,) mean outward normal, weighted by area; zeros where it cancels, as round a bore
    axis : (3,) axis of a cylinder, cone or torus; zeros otherwise
    centre_mm : (3,) area-weighted mean of its triangles; moved onto the axis of a cylinder or a
        cone; the centre of a sphere or a torus
    radius_mm : radius of a cylinder or a sphere; of a cone at ``centre_mm``; of a torus its larger
        one; else 0
    minor_radius_mm : minor radius of a torus, else 0
    half_angle_rad : half angle of a cone, between axis and wall, else 0; the cone widens along
        ``axis``
    concave : True for a bore, a fillet, a hollow
    turn_rad : angle over which the normals of a cylinder turn about its axis, 2 pi for a full one;
        else 0
    """

    id: int
    kind: FaceKind
    area_mm2: float
    normal: FloatArray
    axis: FloatArray
    centre_mm: FloatArray
    radius_mm: float
    minor_radius_mm: float
    half_angle_rad: float
    concave: bool
    turn_rad: float = 0.0

    @property
    def label(self) -> str:
        """The name that people use, as in ``F3 bore 8.0 mm``."""
        match self.kind:
            case "cylinder" if self.turn_rad < HALF_TURN_RAD:
                name = "fillet" if self.concave else "round"
                return say(
                    "F{id} {name} R{radius_mm:.1f} mm",
                    id=self.id,
                    name=name,
                    radius_mm=self.radius_mm,
                )
            case "cylinder":
                name = "bore" if self.concave else "boss"
                return say(
                    "F{id} {name} {diameter_mm:.1f} mm",
                    id=self.id,
                    name=name,
                    diameter_mm=2 * self.radius_mm,
                )
            case "sphere":
                return say(
                    "F{id} sphere {diameter_mm:.1f} mm", id=self.id, diameter_mm=2 * self.radius_mm
                )
            case _:
                return say("F{id} {kind}", id=self.id, kind=self.kind)


class Curve(IntEnum):
    """Type of an edge's curve, independent of its polyline."""

    LINE = 0
    CIRCLE = 1
    OTHER = 2


class Crease(IntEnum):
    """Kind of crease between the two faces at an edge."""

    CONVEX = 0
    CONCAVE = 1
    SMOOTH = 2


@dataclass(frozen=True, eq=False, slots=True)
class Boundary:
    """Vertices, half-edges, loops and faces of a solid.

    Half-edges ``2 e`` and ``2 e + 1`` are the two sides of edge ``e``. Each runs with its face to
    the left, seen from outside: anticlockwise round an outer loop, clockwise round a hole. A vertex
    is where three faces or more meet; an edge that closes on itself has one vertex on it, as in
    STEP. A face with no edge at all (a ball) has no loop.

    Attributes
    ----------
    vertex_ids : (v,) mesh vertex of each vertex
    vertices_mm : (v, 3)
    origin : (h,) vertex a half-edge leaves
    next, prev : (h,) half-edge after and before it on its loop
    face, loop : (h,) face to its left, and the loop it is on
    first : (l,) a half-edge of each loop
    loop_face : (l,) face of each loop
    is_hole : (l,) False for the outer loop of each face; a face without inside and outside, as the
        wall of a bore, has its longest loop as the outer one
    chain_start : (e + 1,) start of each edge's run in ``chain``
    chain : (p,) mesh vertices along each edge, from the origin of half-edge ``2 e`` to its end,
        both included
    curve : (e,) `Curve`
    centre_mm, axis, radius_mm : (e, 3), (e, 3), (e,) of circles, NaN otherwise
    crease : (e,) `Crease`
    angle_rad : (e,) mean angle between the normals of the two faces along the edge, 0 where smooth
    shell_count : closed surfaces: 1 and one more for each void inside
    genus : handles, as a through hole is one
    """

    vertex_ids: Int32Array
    vertices_mm: FloatArray
    origin: Int32Array
    next: Int32Array
    prev: Int32Array
    face: Int32Array
    loop: Int32Array
    first: Int32Array
    loop_face: Int32Array
    is_hole: BoolArray
    chain_start: Int32Array
    chain: Int32Array
    curve: NDArray[np.int8]
    centre_mm: FloatArray
    axis: FloatArray
    radius_mm: FloatArray
    crease: NDArray[np.int8]
    angle_rad: FloatArray
    shell_count: int
    genus: int

    @property
    def edge_count(self) -> int:
        """Number of edges."""
        return len(self.curve)

    def loop_edges(self, loop: int) -> Iterator[int]:
        """Yield the half-edges of a loop, once round (references.md P2.0)."""
        start = here = int(self.first[loop])
        while True:
            yield here
            here = int(self.next[here])
            if here == start:
                return

    def chain_of(self, edge: int) -> Int32Array:
        """Return the mesh vertices along an edge, (n,)."""
        return self.chain[self.chain_start[edge] : self.chain_start[edge + 1]]
