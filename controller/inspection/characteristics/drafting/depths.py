"""Depths of blind holes, counterbores, slots and pockets, from mouth to floor.

A picture taken at an angle to the axis shows the floor's edge displaced against the mouth's, by the
depth times the sine of the angle. Both edges of a wall move together where the wall is elsewhere,
so a depth is given by pairs of edges, one pair for each wall.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.cad import Curve, Recess, Solid, find_recesses

from .._types import EdgeLine, EdgePairGeometry, Rim
from ..edges import RoundWall
from ..edges.lines import MIN_LENGTH_MM
from ..edges.rims import COAXIAL_COS
from .holes import MIN_DEPTH_MM
from .planes import SAME_LEVEL_MM

# Least sweep of a round wall whose place and radius its own edges determine: the end of a slot. The
# corners of a pocket sweep a quarter turn.
MIN_SWEEP_RAD: Final = np.radians(170.0)


@dataclass(frozen=True, eq=False, slots=True)
class Depth:
    """A blind recess with a depth: ids of its walls and of its floors, geometry, nominal depth."""

    walls: frozenset[int]
    floors: frozenset[int]
    geometry: EdgePairGeometry
    depth_mm: float


def depths(solid: Solid, walls: Sequence[RoundWall]) -> list[Depth]:
    """Return the depths of a part that views at an angle to the axis show.

    Parameters
    ----------
    solid, walls : solid and round walls of the part
    """
    found = (_depth(solid, recess, walls) for recess in find_recesses(solid))
    return [one for one in found if one is not None]


def _depth(solid: Solid, recess: Recess, walls: Sequence[RoundWall]) -> Depth | None:
    """Return the depth of a recess; None if its floor is not plane, or no wall has equal edges."""
    if recess.is_through or recess.depth_mm < MIN_DEPTH_MM:
        return None
    b = solid.boundary
    vertices = np.asarray(solid.mesh.vertices, dtype=np.float64)
    mouth, floor = (
        np.concatenate([vertices[b.chain_of(edge)] for edge in sorted(edges)]) @ recess.axis
        for edges in (recess.mouths[0], recess.floor)
    )
    if float(np.ptp(floor)) > SAME_LEVEL_MM:
        return None
    # Drawings give the depth of a keyway in a shaft from the shaft's crest.
    depth_mm = float(mouth.max() - floor.mean())
    below = _beyond(solid, recess.floor, recess.walls)
    around = _beyond(solid, recess.mouths[0], recess.walls)
    lines = [
        line
        for edge in sorted(recess.mouths[0])
        if (line := _line(solid, edge, recess, vertices)) is not None and line.faces[0] in below
    ]
    rims = [
        rim
        for wall in walls
        if set(wall.faces) <= recess.walls
        for rim in wall.rims
        if rim.course is None
        and rim.sweep_rad >= MIN_SWEEP_RAD
        and rim.wall in below
        and float(rim.axis @ recess.axis) > COAXIAL_COS
    ]
    levels = np.array([*(x.start_mm for x in lines), *(x.end_mm for x in lines),
                       *(x.centre_mm for x in rims)]).reshape(-1, 3) @ recess.axis  # fmt: skip
    if len(levels) == 0 or float(np.ptp(levels)) > SAME_LEVEL_MM:
        return None
    down = -float(levels.mean() - floor.mean()) * recess.axis
    at_mouth = np.mean([*(0.5 * (x.start_mm + x.end_mm) for x in lines),
                        *(x.centre_mm for x in rims)], axis=0)  # fmt: skip
    return Depth(
        recess.walls,
        recess.bottom(solid),
        EdgePairGeometry(
            one=tuple(_moved_line(line, down, below) for line in lines),
            other=tuple(lines),
            direction=recess.axis,
            one_face=min(recess.bottom(solid)),
            other_face=min(around.values()),
            one_rims=tuple(_moved_rim(rim, down, below) for rim in rims),
            other_rims=tuple(rims),
            middle_mm=at_mouth + 0.5 * down,
            is_depth=True,
        ),
        depth_mm,
    )


def _beyond(solid: Solid, edges: frozenset[int], walls: frozenset[int]) -> dict[int, int]:
    """Return the face beyond some edges of walls, by wall."""
    out: dict[int, int] = {}
    for edge in sorted(edges):
        sides = solid.boundary.face[2 * edge : 2 * edge + 2].tolist()
        for wall, other in (sides, sides[::-1]):
            if wall in walls and other not in walls:
                out.setdefault(int(wall), int(other))
    return out


def _line(solid: Solid, edge: int, recess: Recess, vertices: FloatArray) -> EdgeLine | None:
    """Return a straight edge of a mouth, the wall's face first; None for any other or a short one.

    Parameters
    ----------
    solid, recess : the part, and its recess
    edge : number of the edge in the boundary
    vertices : (v, 3) vertices of the part
    """
    b = solid.boundary
    chain = b.chain_of(edge)
    start, end = vertices[chain[0]], vertices[chain[-1]]
    if b.curve[edge] != Curve.LINE or float(np.linalg.norm(end - start)) < MIN_LENGTH_MM:
        return None
    sides = [int(face) for face in b.face[2 * edge : 2 * edge + 2]]
    wall, top = sides if sides[0] in recess.walls else sides[::-1]
    if solid.faces[wall].kind != "plane":
        return None
    return EdgeLine(start, end, (wall, top))


def _moved_line(line: EdgeLine, by_mm: FloatArray, beyond: dict[int, int]) -> EdgeLine:
    faces = line.faces[0], beyond[line.faces[0]]
    return EdgeLine(line.start_mm + by_mm, line.end_mm + by_mm, faces)


def _moved_rim(rim: Rim, by_mm: FloatArray, beyond: dict[int, int]) -> Rim:
    return replace(rim, centre_mm=rim.centre_mm + by_mm, beyond=beyond[rim.wall])
