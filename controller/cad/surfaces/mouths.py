"""Holes, slots and pockets as mouths, walls and floors, without sizes or kinds."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.arrays import FloatArray

from ..boundary import Boundary, Crease
from ..solid import Solid

LEVEL_MM: Final = 0.01  # depth of a shoulder's face, which leads nowhere, by rounding


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


def find_recesses(solid: Solid) -> tuple[Recess, ...]:
    """Return the recesses of a part whose walls run straight from end to end."""
    b = solid.boundary
    mouths = [
        (edges, walls)
        for loop in range(len(b.first))
        if (edges := frozenset(h // 2 for h in b.loop_edges(loop)))
        and (walls := _walls(solid, b, loop))
    ]
    found: list[Recess] = []
    for i, (edges, walls) in enumerate(mouths):
        others = [
            (other, other_walls)
            for j, (other, other_walls) in enumerate(mouths)
            if j != i and other_walls == walls and not other & edges
        ]
        rest = _ends(b, walls) - edges
        if len(others) == 1 and rest == others[0][0]:
            if i < [m[0] for m in mouths].index(others[0][0]):
                found.append(_recess(solid, walls, (edges, others[0][0]), frozenset()))
        elif rest and all(b.crease[edge] == Crease.CONCAVE for edge in rest):
            found.append(_recess(solid, walls, (edges,), frozenset(rest)))
    return tuple(recess for recess in found if recess.depth_mm > LEVEL_MM)


def _walls(solid: Solid, b: Boundary, loop: int) -> frozenset[int]:
    """Return the faces that lead into the material from a loop; none if it is no mouth."""
    around = list(b.loop_edges(loop))
    if any(b.crease[h // 2] != Crease.CONVEX for h in around):
        return frozenset()
    walls = frozenset(int(b.face[h ^ 1]) for h in around)
    own = int(b.loop_face[loop])
    if own in walls:
        return frozenset()
    # A keyway in a shaft opens to the outside of a cylinder.
    is_outside = solid.faces[own].kind == "cylinder" and not solid.faces[own].concave
    if b.is_hole[loop] and is_outside:
        return walls
    if solid.faces[own].kind == "plane":
        return walls if b.is_hole[loop] else frozenset()
    is_bore = all(solid.faces[w].kind == "cylinder" and solid.faces[w].concave for w in walls)
    return walls if is_bore else frozenset()


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
