"""Round walls of a part, and stacks of them on one axis."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from controller.arrays import FloatArray

from ..boundary import Boundary, Crease, Face
from ..solid import Solid

COAXIAL_COS = 1 - 1e-5  # 0.26 degrees
COAXIAL_MM = 0.02
ROUND_KINDS = ("cylinder", "cone", "torus")


@dataclass(frozen=True, eq=False, slots=True)
class WallRim:
    """A loop that goes once round the axis of its wall.

    Attributes
    ----------
    loop : its number in the boundary
    point_mm : (3,) intersection of its level with the axis
    radius_mm : mean distance of its points from the axis
    beyond : face on its other side
    crease : type of the edge where the wall meets that face
    """

    loop: int
    point_mm: FloatArray
    radius_mm: float
    beyond: int
    crease: int


@dataclass(frozen=True, eq=False, slots=True)
class Wall:
    """A surface that closes round its axis, with the rims it has."""

    face: Face
    rims: tuple[WallRim, ...]


def loops_by_face(boundary: Boundary, face_count: int) -> list[list[int]]:
    """Return the loops of each face."""
    loops: list[list[int]] = [[] for _ in range(face_count)]
    for loop, face in enumerate(boundary.loop_face.tolist()):
        loops[face].append(loop)
    return loops


def loop_points(solid: Solid, loop: int) -> FloatArray:
    """Return the points of a loop in its order, the first one not repeated (n, 3)."""
    b = solid.boundary
    runs = []
    for half_edge in b.loop_edges(loop):
        chain = b.chain_of(half_edge // 2)
        runs.append(chain[:-1] if half_edge % 2 == 0 else chain[:0:-1])
    return np.asarray(solid.mesh.vertices[np.concatenate(runs)])


def winding(points: FloatArray, axis: FloatArray, centre_mm: FloatArray) -> int:
    """Return the number of turns of a closed run of points about an axis, anticlockwise positive.

    Parameters
    ----------
    points : (n, 3) in order, the first one not repeated
    axis : (3,) unit
    centre_mm : (3,) on the axis
    """
    offset = points - centre_mm
    radial = offset - (offset @ axis)[:, None] * axis
    after = np.roll(radial, -1, axis=0)
    sine = np.cross(radial, after) @ axis
    return round(float(np.arctan2(sine, (radial * after).sum(axis=1)).sum()) / (2 * np.pi))


def rim_of(solid: Solid, loop: int, axis: FloatArray, centre_mm: FloatArray) -> WallRim | None:
    """Return a loop as a rim of the wall round an axis; None if it does not go round.

    Parameters
    ----------
    solid : the part
    loop : number of a loop in its boundary
    axis : (3,) unit, CAD frame
    centre_mm : (3,) on the axis
    """
    points = loop_points(solid, loop)
    if winding(points, axis, centre_mm) == 0:
        return None
    b = solid.boundary
    offset = points - centre_mm
    height = offset @ axis
    level = (float(height.min()) + float(height.max())) / 2
    away = np.linalg.norm(offset - height[:, None] * axis, axis=1)
    # a rim may pass several faces; the longest part says what is beyond, convex or concave by sum
    lengths: dict[int, float] = {}
    creases: dict[int, float] = {}
    longest = (-1.0, -1)
    for half_edge in b.loop_edges(loop):
        run = solid.mesh.vertices[b.chain_of(half_edge // 2)]
        length = float(np.linalg.norm(np.diff(run, axis=0), axis=1).sum())
        beyond, crease = int(b.face[half_edge ^ 1]), int(b.crease[half_edge // 2])
        lengths[beyond] = lengths.get(beyond, 0.0) + length
        creases[crease] = creases.get(crease, 0.0) + length
        longest = max(longest, (lengths[beyond], beyond))
    return WallRim(
        loop,
        centre_mm + level * axis,
        float(away.mean()),
        longest[1],
        max(creases, key=lambda crease: creases[crease]),
    )


def find_walls(solid: Solid) -> dict[int, Wall]:
    """Return the surfaces that close round their axis, by face."""
    loops = loops_by_face(solid.boundary, len(solid.faces))
    walls = {}
    for face in solid.faces:
        if face.kind not in ROUND_KINDS:
            continue
        rims = [rim_of(solid, loop, face.axis, face.centre_mm) for loop in loops[face.id]]
        round_rims = tuple(rim for rim in rims if rim is not None)
        if round_rims:
            walls[face.id] = Wall(face, round_rims)
    return walls


def coaxial(one: Face, other: Face) -> bool:
    """Return True if two round surfaces share their axis."""
    if abs(float(one.axis @ other.axis)) < COAXIAL_COS:
        return False
    offset = other.centre_mm - one.centre_mm
    return bool(np.linalg.norm(offset - (offset @ one.axis) * one.axis) < COAXIAL_MM)


def stacks(solid: Solid, walls: dict[int, Wall], *, concave: bool) -> list[list[Wall]]:
    """Return the walls that follow on one axis, group by group.

    Walls follow each other where they share a rim; those of a hole also where a ledge square to
    the axis lies between their rims. Rounded rims (tori) belong to the wall they run into.

    Parameters
    ----------
    solid : the part
    walls : by number of their face, tori among them
    concave : True for the walls of holes, False for those of bosses
    """
    mine = {
        i: wall
        for i, wall in walls.items()
        if wall.face.kind != "torus" and wall.face.concave == concave
    }
    rounds: dict[int, int] = {}
    for i, wall in mine.items():
        for rim in wall.rims:
            ring = walls.get(rim.beyond)
            if ring is not None and ring.face.kind == "torus" and coaxial(ring.face, wall.face):
                rounds.setdefault(rim.beyond, i)
    members = {**mine, **{ring: walls[ring] for ring in rounds}}
    group = {i: i for i in members}

    def root(i: int) -> int:
        while group[i] != i:
            group[i] = group[group[i]]
            i = group[i]
        return i

    by_ledge: dict[int, list[int]] = {}
    for i, wall in members.items():
        for rim in wall.rims:
            beyond = rim.beyond
            if beyond in members and coaxial(wall.face, members[beyond].face):
                group[root(i)] = root(beyond)
            elif concave and _is_square(solid.faces[beyond], wall.face):
                by_ledge.setdefault(beyond, []).append(i)
    for ledge, sharing in by_ledge.items():
        for i, j in _near_axes(solid.faces[ledge], [members[k].face for k in sharing]):
            if coaxial(members[sharing[i]].face, members[sharing[j]].face):
                group[root(sharing[i])] = root(sharing[j])
    grouped: dict[int, list[Wall]] = {}
    for i, wall in members.items():
        grouped.setdefault(root(i), []).append(wall)
    return list(grouped.values())


def _near_axes(plane: Face, walls: list[Face]) -> list[tuple[int, int]]:
    """Return the pairs of walls square to a plane that may share an axis, by where they meet it.

    A plate has a thousand bores in one plane; comparing each with each would grow as their square.
    """
    if len(walls) < 2:
        return []
    centres = np.stack([wall.centre_mm for wall in walls])
    offsets = centres - plane.centre_mm
    feet = offsets - np.outer(offsets @ plane.normal, plane.normal)
    # axes lean from the normal as far as square allows, over the height between two centres
    lean = 2 * float(np.sqrt(1 - COAXIAL_COS**2)) * float(np.ptp(offsets @ plane.normal))
    pairs = cKDTree(feet).query_pairs(COAXIAL_MM + lean + 1e-9)
    return sorted((j, i) for i, j in pairs)


def _is_square(plane: Face, wall: Face) -> bool:
    return plane.kind == "plane" and abs(float(plane.normal @ wall.axis)) > COAXIAL_COS


@dataclass(frozen=True, eq=False, slots=True)
class End:
    """One end of a stack.

    Attributes
    ----------
    point_mm : (3,) on the axis
    radius_mm : radius of the rim there, 0 at an apex
    is_open : True where the wall ends in a convex edge: at a mouth, or at the free end of a boss
    beyond : face that closes it, or round its mouth; None at an apex
    """

    point_mm: FloatArray
    radius_mm: float
    is_open: bool
    beyond: int | None


def ends_of(solid: Solid, stack: list[Wall], axis: FloatArray) -> tuple[End, End] | None:
    """Return the two ends of a stack, the lower one along ``axis`` first; None without two.

    Parameters
    ----------
    solid : the part
    stack : walls on one axis, as `stacks` groups them
    axis : (3,) unit, CAD frame
    """
    inside = {wall.face.id for wall in stack}
    ledges = [rim.beyond for wall in stack for rim in wall.rims if rim.beyond not in inside]
    ends = []
    for wall in stack:
        for rim in wall.rims:
            if rim.beyond in inside:
                continue
            if ledges.count(rim.beyond) > 1 and solid.faces[rim.beyond].kind == "plane":
                continue  # a ledge between two walls
            ends.append(_end(solid, wall, rim, axis))
        tip = _tip(wall)
        if tip is not None:
            ends.append(tip)
    if len(ends) != 2:
        return None
    low, high = sorted(ends, key=lambda end: float(end.point_mm @ axis))
    return low, high


def _end(solid: Solid, wall: Wall, rim: WallRim, axis: FloatArray) -> End:
    beyond = solid.faces[rim.beyond]
    if (
        beyond.kind == "sphere"
        and beyond.concave == wall.face.concave
        and rim.crease != (Crease.CONVEX if wall.face.concave else Crease.CONCAVE)
    ):
        # a hole with a round bottom, a boss with a round head: its pole is the end
        middle = wall.face.centre_mm
        outward = 1.0 if (rim.point_mm - middle) @ axis > 0 else -1.0
        pole = beyond.centre_mm + outward * beyond.radius_mm * axis
        return End(pole, 0.0, not wall.face.concave, rim.beyond)
    return End(rim.point_mm, rim.radius_mm, rim.crease != Crease.CONCAVE, rim.beyond)


def _tip(wall: Wall) -> End | None:
    """Return the apex of a cone with one rim only."""
    face = wall.face
    if face.kind != "cone" or len(wall.rims) != 1:
        return None
    apex = face.centre_mm - face.axis * face.radius_mm / np.tan(face.half_angle_rad)
    return End(apex, 0.0, not face.concave, None)
