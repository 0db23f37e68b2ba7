"""Round walls of a part, and the circular edges at their ends.

A wall is one cylinder in the machinist's sense. STEP files split it into halves, and other faces
may cut into its rim, so it may have several faces and several arcs per rim.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.cad import Boundary, Crease, Curve, Face, Solid

from .._types import Rim, rim_directions
from .courses import course_rims

# Cosine of the largest angle between coaxial axes, 0.26 degrees, as for the CAD's features.
COAXIAL_COS: Final = 1 - 1e-5
# Largest difference of axes and radii of one cylinder; in a mesh they are good to a few microns.
SAME_MM: Final = 0.02
LEVEL_MM: Final = 0.01
FULL_RAD: Final = 2 * np.pi - 1e-3
GAP_RAD: Final = 1e-3  # gap below which arcs are consecutive
# Least sweep of an arc of a rim; a shorter one determines neither centre nor radius.
MIN_ARC_RAD: Final = np.radians(10.0)


@dataclass(frozen=True, eq=False, slots=True)
class RoundWall:
    """A cylinder, or the portion of one that exists.

    Attributes
    ----------
    faces : its faces, lowest id first
    axis, centre_mm : (3,) unit axis and (3,) a point on it, CAD frame
    radius_mm : nominal radius
    is_hole : True if the wall faces its axis
    rims : arcs at its open ends, the longest first; where no arc is a full circle, full curves in
        space come before them; empty where the ends are rounded or end in inner corners
    height_mm : extent along its axis
    has_edge : True if it ends in outer edges, whether these are rims or not
    """

    faces: tuple[int, ...]
    axis: FloatArray
    centre_mm: FloatArray
    radius_mm: float
    is_hole: bool
    rims: tuple[Rim, ...] = ()
    height_mm: float = 0.0
    has_edge: bool = False

    @property
    def sweep_rad(self) -> float:
        """Sweep of its longest rim."""
        return max((rim.sweep_rad for rim in self.rims), default=0.0)


@dataclass(frozen=True, slots=True)
class _Arc:
    """Arc about a wall's axis: height over its centre, start, and sweep."""

    level_mm: float
    start_rad: float
    sweep_rad: float
    wall: int
    beyond: int


def round_walls(solid: Solid) -> tuple[RoundWall, ...]:
    """Return the cylinders of a part with their open rims, in the order of their lowest faces."""
    b = solid.boundary
    sides: list[list[int]] = [[] for _ in solid.faces]
    for half_edge, face in enumerate(b.face.tolist()):
        sides[face].append(half_edge)
    triangles = np.argsort(solid.face_of_triangle, kind="stable")
    begin = np.searchsorted(solid.face_of_triangle[triangles], np.arange(len(sides) + 1))
    corners = np.asarray(solid.mesh.triangles, dtype=np.float64)
    walls = []
    for group in _pieces(solid, sides):
        faces = [solid.faces[i] for i in group]
        largest = max(faces, key=lambda face: face.area_mm2)
        axis, area = largest.axis, sum(face.area_mm2 for face in faces)
        radius = sum(face.radius_mm * face.area_mm2 for face in faces) / area
        reach = [float((f.centre_mm - largest.centre_mm) @ axis) * f.area_mm2 for f in faces]
        centre = largest.centre_mm + axis * sum(reach) / area
        own = [half_edge for face in group for half_edge in sides[face]]
        levels = [corners[triangles[begin[i] : begin[i + 1]]].reshape(-1, 3) @ axis for i in group]
        bare = RoundWall(
            tuple(group),
            axis,
            centre,
            radius,
            largest.concave,
            height_mm=float(np.ptp(np.concatenate(levels))),
            has_edge=any(b.crease[h // 2] == Crease.CONVEX for h in own),
        )
        arcs = [arc for h in own if (arc := _arc(solid, bare, h)) is not None]
        rims = _rims(bare, arcs)
        if max((rim.sweep_rad for rim in rims), default=0.0) < FULL_RAD:
            # Where no arc is a full circle, a curve in space may go all the way round.
            courses = course_rims(solid, group, own, axis, centre, radius, is_hole=largest.concave)
            rims = [*courses, *rims]
        walls.append(replace(bare, rims=tuple(rims)))
    return tuple(walls)


def plane_rims(solid: Solid) -> dict[int, tuple[Rim, ...]]:
    """Return the outer circular edges of each plane that has any, by face id, longest first."""
    b = solid.boundary
    circles: dict[tuple[int, tuple[int, ...]], list[int]] = {}
    for edge in np.nonzero((b.curve == Curve.CIRCLE) & (b.crease == Crease.CONVEX))[0].tolist():
        for half_edge in (2 * edge, 2 * edge + 1):
            plane, beside = (solid.faces[int(b.face[h])] for h in (half_edge, half_edge ^ 1))
            if plane.kind != "plane" or beside.kind == "plane" or beside.concave:
                continue
            if abs(float(plane.normal @ b.axis[edge])) < COAXIAL_COS:
                continue
            place = (*b.centre_mm[edge], b.radius_mm[edge])
            key = plane.id, tuple(round(float(v) / SAME_MM) for v in place)
            circles.setdefault(key, []).append(half_edge ^ 1)
    found: dict[int, list[Rim]] = {}
    for (plane_id, _), half_edges in circles.items():
        edge = half_edges[0] // 2
        normal = solid.faces[plane_id].normal
        axis = normal / np.linalg.norm(normal)
        # Its centre lies below the plane, so that its rims open out of the plane.
        wall = RoundWall((), axis, b.centre_mm[edge] - axis, float(b.radius_mm[edge]), False)
        arcs = [arc for h in half_edges if (arc := _arc(solid, wall, h)) is not None]
        found.setdefault(plane_id, []).extend(_rims(wall, arcs))
    return {i: tuple(sorted(rims, key=lambda r: -r.radius_mm)) for i, rims in found.items()}


def _pieces(solid: Solid, sides: list[list[int]]) -> list[list[int]]:
    """Return the cylindrical faces, grouped as pieces of one cylinder."""
    b = solid.boundary
    root = {face.id: face.id for face in solid.faces if face.kind == "cylinder"}

    def first(i: int) -> int:
        while root[i] != i:
            i = root[i]
        return i

    for i in root:
        for half_edge in sides[i]:
            j = int(b.face[half_edge ^ 1])
            if j in root and _is_same_cylinder(solid.faces[i], solid.faces[j]):
                low, high = sorted((first(i), first(j)))
                root[high] = low
    grouped: dict[int, list[int]] = {}
    for i in sorted(root):
        grouped.setdefault(first(i), []).append(i)
    return list(grouped.values())


def _is_same_cylinder(one: Face, other: Face) -> bool:
    return (
        one.concave == other.concave
        and abs(one.radius_mm - other.radius_mm) < SAME_MM
        and are_coaxial(one.axis, one.centre_mm, other.axis, other.centre_mm)
    )


def are_coaxial(
    axis: FloatArray, centre_mm: FloatArray, other_axis: FloatArray, other_mm: FloatArray
) -> bool:
    """Return True if two axes coincide.

    Parameters
    ----------
    axis, centre_mm : (3,) unit axis, and (3,) a point on it
    other_axis, other_mm : the same of the other axis
    """
    if abs(float(axis @ other_axis)) < COAXIAL_COS:
        return False
    offset = other_mm - centre_mm
    return bool(np.linalg.norm(offset - (offset @ axis) * axis) < SAME_MM)


def _arc(solid: Solid, wall: RoundWall, half_edge: int) -> _Arc | None:
    """Return an edge of a wall as an arc of its rim; None for an invisible edge."""
    b: Boundary = solid.boundary
    edge = half_edge // 2
    if b.curve[edge] != Curve.CIRCLE or b.crease[edge] != Crease.CONVEX:
        return None
    if not are_coaxial(wall.axis, wall.centre_mm, b.axis[edge], b.centre_mm[edge]):
        return None
    if abs(float(b.radius_mm[edge]) - wall.radius_mm) > SAME_MM:
        return None
    level = float((b.centre_mm[edge] - wall.centre_mm) @ wall.axis)
    u, v = rim_directions(wall.axis)
    offset = np.asarray(solid.mesh.vertices)[b.chain_of(edge)] - wall.centre_mm
    angle = np.unwrap(np.arctan2(offset @ v, offset @ u))
    start, end = float(angle[0]), float(angle[-1])
    return _Arc(
        level,
        min(start, end) % (2 * np.pi),
        abs(end - start),
        int(b.face[half_edge]),
        int(b.face[half_edge ^ 1]),
    )


def _rims(wall: RoundWall, arcs: Iterable[_Arc]) -> list[Rim]:
    by_level: dict[int, list[_Arc]] = {}
    for arc in arcs:
        by_level.setdefault(round(arc.level_mm / LEVEL_MM), []).append(arc)
    rims = []
    for at_level in by_level.values():
        for run in _runs(sorted(at_level, key=lambda arc: arc.start_rad)):
            sweep = sum(arc.sweep_rad for arc in run)
            if sweep >= MIN_ARC_RAD:
                rims.append(_rim(wall, run, sweep))
    return sorted(rims, key=lambda rim: (-round(rim.sweep_rad, 3), rim.beyond, rim.wall))


def _runs(arcs: list[_Arc]) -> list[list[_Arc]]:
    """Return the arcs of one circle, with consecutive ones merged."""
    runs: list[list[_Arc]] = []
    for arc in arcs:
        if runs and _meet(runs[-1][-1], arc):
            runs[-1].append(arc)
        else:
            runs.append([arc])
    if len(runs) > 1 and _meet(runs[-1][-1], runs[0][0]):
        runs[0] = [*runs.pop(), *runs[0]]
    return runs


def _meet(one: _Arc, other: _Arc) -> bool:
    gap = (other.start_rad - one.start_rad - one.sweep_rad) % (2 * np.pi)
    return min(gap, 2 * np.pi - gap) < GAP_RAD


def _rim(wall: RoundWall, run: list[_Arc], sweep_rad: float) -> Rim:
    longest = max(run, key=lambda arc: arc.sweep_rad)
    level = longest.level_mm
    axis = wall.axis if level > 0 else -wall.axis
    u, v = rim_directions(wall.axis)
    begin = run[0].start_rad if level > 0 else run[0].start_rad + sweep_rad
    return Rim(
        centre_mm=wall.centre_mm + level * wall.axis,
        axis=axis,
        radius_mm=wall.radius_mm,
        start=np.cos(begin) * u + np.sin(begin) * v,
        sweep_rad=2 * np.pi if sweep_rad > FULL_RAD else sweep_rad,
        wall=longest.wall,
        beyond=longest.beyond,
        is_hole=wall.is_hole,
    )
