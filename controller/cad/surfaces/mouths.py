"""Holes, slots and pockets as mouths, walls and floors, without sizes or kinds."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.arrays import FloatArray

from ..boundary import Boundary, Crease, Face
from ..solid import Solid

ALONG: Final = 0.5  # least cosine between a way and its mouth, which may be cut at 60 degrees


@dataclass(frozen=True, eq=False, slots=True)
class Recess:
    """Walls of a hollow, from mouth to mouth or from mouth to floor.

    Attributes
    ----------
    walls : ids of its faces
    mouths : edges of its openings, one set for each end; a blind recess has one
    floor : edges of its walls at the bottom; empty for a through recess
    axis : (3,) unit, CAD frame, out of the first mouth
    depth_mm : distance between both mouths, or from mouth to floor
    """

    walls: frozenset[int]
    mouths: tuple[frozenset[int], ...]
    floor: frozenset[int]
    axis: FloatArray
    depth_mm: float

    @property
    def is_through(self) -> bool:
        """True if it has two mouths."""
        return len(self.mouths) == 2

    def bottom(self, solid: Solid) -> frozenset[int]:
        """Return the ids of the faces at which its walls end."""
        b = solid.boundary
        around = (int(f) for edge in self.floor for f in b.face[2 * edge : 2 * edge + 2])
        return frozenset(around) - self.walls


@dataclass(frozen=True, slots=True)
class Mouth:
    """An opening of a hollow: its edges, and the ids of the walls that lead inwards from them."""

    edges: frozenset[int]
    walls: frozenset[int]


def find_mouths(solid: Solid) -> tuple[Mouth, ...]:
    """Return the openings of a part's hollows, whatever their walls lead to."""
    b = solid.boundary
    return tuple(
        Mouth(edges, walls)
        for loop in range(len(b.first))
        if (edges := frozenset(h // 2 for h in b.loop_edges(loop)))
        and (walls := _walls(solid, b, loop))
    )


def find_recesses(solid: Solid) -> tuple[Recess, ...]:
    """Return the recesses of a part whose walls run straight from end to end."""
    b = solid.boundary
    mouths = find_mouths(solid)
    found: list[Recess] = []
    for i, one in enumerate(mouths):
        others = [
            (j, other.edges)
            for j, other in enumerate(mouths)
            if j != i and other.walls == one.walls and not other.edges & one.edges
        ]
        rest = _ends(b, one.walls) - one.edges
        if len(others) == 1 and rest == others[0][1]:
            if i < others[0][0]:
                found.append(_recess(solid, one.walls, (one.edges, rest), frozenset()))
        elif rest and all(b.crease[edge] == Crease.CONCAVE for edge in rest):
            found.append(_recess(solid, one.walls, (one.edges,), rest))
    return tuple(found)


def _walls(solid: Solid, b: Boundary, loop: int) -> frozenset[int]:
    """Return the faces that lead into the material from a loop; none if it is no mouth."""
    around = list(b.loop_edges(loop))
    if any(b.crease[h // 2] != Crease.CONVEX for h in around):
        return frozenset()
    walls = frozenset(int(b.face[h ^ 1]) for h in around)
    own = int(b.loop_face[loop])
    if own in walls:
        return frozenset()
    if solid.faces[own].kind == "plane":
        return walls if b.is_hole[loop] else frozenset()
    points = _polyline(solid, around)
    if solid.faces[own].kind == "cylinder" and not solid.faces[own].concave:
        # A keyway or a cross hole opens to the outside of a shaft.
        return walls if _is_hole(solid.faces[own], points) else frozenset()
    # A cross hole opens into a bore; the bore does not open into the cross hole.
    way = np.cross(points[:-1] - points[0], points[1:] - points[0]).sum(axis=0)
    is_bore = all(
        solid.faces[w].kind == "cylinder"
        and solid.faces[w].concave
        and abs(float(solid.faces[w].axis @ way)) > ALONG * np.linalg.norm(way)
        for w in walls
    )
    return walls if is_bore else frozenset()


def _polyline(solid: Solid, around: Sequence[int]) -> FloatArray:
    """Return the points (n, 3) along a loop of half-edges; the last is the first."""
    vertices = np.asarray(solid.mesh.vertices, dtype=np.float64)
    way = [vertices[solid.boundary.chain_of(h // 2)[:: -1 if h % 2 else 1]] for h in around]
    return np.concatenate([way[0][:1], *(one[1:] for one in way)])


def _is_hole(cylinder: Face, points: FloatArray) -> bool:
    """Return True if a closed polyline (n, 3) goes round a hole in an outer cylinder's wall.

    Seen from outside, a loop round a hole runs clockwise; a loop at an end runs round the axis.
    """
    first = points[0] - cylinder.centre_mm
    first -= float(first @ cylinder.axis) * cylinder.axis
    off = points - cylinder.centre_mm
    second = np.cross(cylinder.axis, first)
    turn, along = np.unwrap(np.arctan2(off @ second, off @ first)), off @ cylinder.axis
    area = 0.5 * float((turn[:-1] * along[1:] - turn[1:] * along[:-1]).sum())
    return abs(float(turn[-1] - turn[0])) < np.pi and area < 0.0


def _ends(b: Boundary, walls: frozenset[int]) -> frozenset[int]:
    """Return the edges at the ends of walls, without those between two walls."""
    sides = b.face.reshape(-1, 2)
    is_wall = np.isin(sides, list(walls))
    return frozenset(np.flatnonzero(is_wall.sum(axis=1) == 1).tolist())


def _recess(
    solid: Solid,
    walls: frozenset[int],
    mouths: tuple[frozenset[int], ...],
    floor: frozenset[int],
) -> Recess:
    top = _middle(solid, mouths[0])
    bottom = _middle(solid, mouths[1] if len(mouths) > 1 else floor)
    way = top - bottom
    depth = float(np.linalg.norm(way))
    return Recess(walls, mouths, floor, way / max(depth, 1e-9), depth)


def _middle(solid: Solid, edges: frozenset[int]) -> FloatArray:
    """Return the mean position (3,) of edges, weighted by length."""
    b = solid.boundary
    vertices = np.asarray(solid.mesh.vertices, dtype=np.float64)
    total, weight = np.zeros(3), 0.0
    for edge in sorted(edges):
        way = vertices[b.chain_of(edge)]
        length = np.linalg.norm(np.diff(way, axis=0), axis=1)
        total += (0.5 * (way[1:] + way[:-1]) * length[:, None]).sum(axis=0)
        weight += float(length.sum())
    return np.asarray(total / max(weight, 1e-9))
