"""Proof that a mesh is one solid: closed, oriented outwards, one body, without crossings.

A solid is one outer shell and any number of voids inside it. Not detected: a surface that
intersects itself by less than `touch_mm`, and one that lies flat on itself over less than about a
thousandth of its area.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import trimesh

from controller.arrays import BoolArray, FloatArray, Int32Array, IntArray
from controller.imaging import RayCaster
from controller.memory import give_back

from .errors import (
    InsideOutCadError,
    ManySolidsCadError,
    OpenCadError,
    SelfIntersectingCadError,
)
from .graph import components
from .large import AT_ONCE, drop_derived, spans

TOUCH_MM = 1e-3  # ten times what corners are merged at: merging may fold a sliver over
FLOAT32_ULPS = 32.0  # STL keeps seven digits, which is more than TOUCH_MM on a part of metres
PROBE_COUNT = 1500  # points of the surface whose two sides are looked at
FEW_PROBES = 2  # one wrong probe may be a grazing ray
DIRECTIONS = np.array(  # directions that lie in no plane a draughtsman would draw
    [[0.613, 0.347, 0.710], [-0.291, 0.853, 0.433], [0.177, -0.529, -0.830]]
)
EDGES_AT_ONCE = 200_000  # a hit takes some hundred bytes on its way
MANY_HITS = 400  # a straight line through a part that meets more surfaces is not followed on


@dataclass(frozen=True, eq=False, slots=True)
class _Sides:
    """The triangle sides of a mesh, grouped by their two corners."""

    ends: Int32Array  # (e, 2) corners of each edge
    count: Int32Array  # (e,) sides on it
    first: Int32Array  # (e,) first of its sides in `side`
    side: Int32Array  # (3 n,) directed sides, edge by edge; side s is of triangle s // 3
    forward: BoolArray  # (3 n,) runs from the lower corner to the higher


def check_soundness(mesh: trimesh.Trimesh, where: str) -> None:
    """Prove that a mesh [mm] with merged corners is the surface of one solid.

    Takes n log n time: sorted sides, then each edge and some probes cast as rays.

    Raises
    ------
    OpenCadError, InsideOutCadError, ManySolidsCadError, SelfIntersectingCadError
    """
    triangles = np.asarray(mesh.faces, dtype=np.int64)
    # Embree works in single precision, which is finest round the origin
    middle = np.asarray(mesh.bounds).mean(axis=0)
    centred = trimesh.Trimesh(np.asarray(mesh.vertices) - middle, triangles, process=False)
    sides = _sort_sides(triangles)
    _check_closed(triangles, sides, where)
    _ = centred.face_normals, centred.area_faces
    drop_derived(centred)
    touch_mm = touch_of(centred)
    shell, volumes = _shells(centred, sides)
    bodies = _check_outwards(volumes, float(np.max(centred.extents)), where)
    if bodies > 1:
        raise ManySolidsCadError(
            f"{where}: holds {bodies} separate bodies, one part is one body; unite them "
            "or export them one by one"
        )
    ends = sides.ends
    del sides
    caster = RayCaster(centred)
    _check_crossings(centred, ends, caster, touch_mm, middle, where)
    _check_voids(centred, shell, volumes, caster, touch_mm, where)
    _check_probes(centred, caster, touch_mm, middle, where)
    if len(triangles) > AT_ONCE:
        del centred, caster
        give_back()


def touch_of(mesh: trimesh.Trimesh) -> float:
    """Return the largest overlap of a surface with itself that still counts as touching [mm]."""
    reach = float(np.abs(mesh.vertices).max())
    return max(TOUCH_MM, FLOAT32_ULPS * float(np.finfo(np.float32).eps) * reach)


def _sort_sides(triangles: IntArray) -> _Sides:
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    forward = start < end
    corner_count = int(triangles.max()) + 1
    key = np.minimum(start, end) * corner_count + np.maximum(start, end)
    del start, end
    order = np.argsort(key, kind="stable")
    key = key[order]
    first = np.flatnonzero(np.concatenate(([True], key[1:] != key[:-1])))
    count = np.diff(np.append(first, len(key))).astype(np.int32)
    low, high = np.divmod(key[first], corner_count)
    ends = np.column_stack((low.astype(np.int32), high.astype(np.int32)))
    sides = order.astype(np.int32)
    return _Sides(ends, count, first.astype(np.int32), sides, forward[order])


def _check_closed(triangles: IntArray, sides: _Sides, where: str) -> None:
    if (sides.count == 1).any():
        raise OpenCadError(
            f"{where}: the surface is not closed ({int((sides.count == 1).sum())} open triangle "
            "sides); repair it in the CAD system and export it again"
        )
    if (sides.count > 2).any():
        corners = np.sort(triangles, axis=1)
        twice = len(corners) - len(np.unique(corners, axis=0))
        if twice:
            raise SelfIntersectingCadError(
                f"{where}: {twice} triangles coincide with others; were faces "
                "exported twice, or bodies put together and not united? unite them and export again"
            )
        raise SelfIntersectingCadError(
            f"{where}: the surface touches itself along {int((sides.count > 2).sum())} edges; "
            "separate the bodies there or unite them, and export again"
        )
    if (sides.forward[sides.first] == sides.forward[sides.first + 1]).any():
        raise InsideOutCadError(
            f"{where}: some triangles face inwards, others outwards; "
            "repair it in the CAD system and export it again"
        )


def _shells(mesh: trimesh.Trimesh, sides: _Sides) -> tuple[Int32Array, FloatArray]:
    """Return the shell of each triangle (n,), and the volume each shell encloses [mm3]."""
    one, other = sides.side[sides.first] // 3, sides.side[sides.first + 1] // 3
    count = len(mesh.faces)
    shell = components(count, one, other).astype(np.int32)
    vertices, triangles = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    wedge = np.empty(count)
    for some in spans(count):
        a, b, c = (vertices[triangles[some, i]] for i in range(3))
        wedge[some] = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
    return shell, np.bincount(shell, weights=wedge).astype(np.float64)


def _check_outwards(volumes: FloatArray, size_mm: float, where: str) -> int:
    """Return the number of shells that are bodies, not voids."""
    if np.abs(volumes).max() <= 1e-9 * size_mm**3:
        raise OpenCadError(
            f"{where}: the surface is flat and encloses no volume; "
            "export the solid body, not a surface"
        )
    bodies = int((volumes > 0).sum())
    if bodies == 0 or volumes.sum() <= 0:
        raise InsideOutCadError(
            f"{where}: the surface is turned inside out (volume "
            f"{volumes.sum():.1f} mm3); flip its normals and export it again"
        )
    return bodies


def _check_crossings(
    mesh: trimesh.Trimesh,
    ends: Int32Array,
    caster: RayCaster,
    touch_mm: float,
    middle: FloatArray,
    where: str,
) -> None:
    """Raise where an edge runs through the inside of a triangle it shares no corner with."""
    points, triangles = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    for some in spans(len(ends), EDGES_AT_ONCE):
        _check_edges(points, triangles, ends[some], caster, touch_mm, middle, where)


def _check_edges(
    points: FloatArray,
    triangles: IntArray,
    ends: Int32Array,
    caster: RayCaster,
    touch_mm: float,
    middle: FloatArray,
    where: str,
) -> None:
    length = np.linalg.norm(points[ends[:, 1]] - points[ends[:, 0]], axis=1)
    long = length > 2 * touch_mm
    ends, length = ends[long], length[long]
    start, along = points[ends[:, 0]], points[ends[:, 1]] - points[ends[:, 0]]
    found = _hits(caster, start, along, touch_mm / length, 1.0 - touch_mm / length)
    for edge, triangle in found:
        corners = triangles[triangle]
        apart = (corners[:, :, None] != ends[edge][:, None, :]).all(axis=(1, 2))
        edge, corners = edge[apart], corners[apart]
        through, at = _pierces(start[edge], start[edge] + along[edge], points[corners], touch_mm)
        if through.any():
            x, y, z = at[through][0] + middle
            raise SelfIntersectingCadError(
                f"{where}: the surface runs through itself near ({x:.2f}, {y:.2f}, {z:.2f}) mm; "
                "unite the bodies in the CAD system and export it again"
            )


def _pierces(
    a: FloatArray, b: FloatArray, corners: FloatArray, touch_mm: float
) -> tuple[BoolArray, FloatArray]:
    """Return a mask (n,) of segments a-b (n, 3) that clearly pierce their triangle, and the points.

    Clearly: both ends at least ``touch_mm`` off its plane, the crossing as far inside its sides.
    """
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1)
    normal /= np.where(area > 0, area, 1.0)[:, None]
    above = np.einsum("ij,ij->i", a - corners[:, 0], normal)
    below = np.einsum("ij,ij->i", b - corners[:, 0], normal)
    through = (area > 0) & (above * below < 0)
    through &= np.minimum(np.abs(above), np.abs(below)) > touch_mm
    share = np.where(through, above / np.where(through, above - below, 1.0), 0.0)
    at = a + share[:, None] * (b - a)
    for i in range(3):
        side = corners[:, (i + 1) % 3] - corners[:, i]
        inwards = np.cross(normal, side)
        distance = np.einsum("ij,ij->i", at - corners[:, i], inwards)
        through &= distance > touch_mm * np.linalg.norm(side, axis=1)
    return through, at


def _check_voids(
    mesh: trimesh.Trimesh,
    shell: Int32Array,
    volumes: FloatArray,
    caster: RayCaster,
    touch_mm: float,
    where: str,
) -> None:
    """Raise where a shell turned inwards is not a void in the body."""
    voids = np.flatnonzero(volumes <= 0)
    if len(voids) == 0:
        return
    one_triangle = np.unique(shell, return_index=True)[1][voids]
    origins = np.asarray(mesh.vertices)[np.asarray(mesh.faces)[one_triangle]].mean(axis=1)
    turns = np.stack(
        [
            _winding(mesh, caster, origins, direction, touch_mm, shell, voids)
            for direction in DIRECTIONS
        ]
    )
    outside = int((np.median(turns, axis=0) != 1).sum())
    if outside:
        raise ManySolidsCadError(
            f"{where}: {outside} of its {len(volumes)} shells are turned inwards and are no void "
            "in the body; flip their normals, and export bodies one by one"
        )


def _check_probes(
    mesh: trimesh.Trimesh, caster: RayCaster, touch_mm: float, middle: FloatArray, where: str
) -> None:
    """Raise where a surface lies on itself: points just off it must be outside and inside."""
    rng = np.random.default_rng(0)  # a fixed draw: the same file gets the same answer
    area = np.asarray(mesh.area_faces)
    chosen = rng.choice(len(area), PROBE_COUNT, p=area / area.sum())
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.faces)[chosen]]
    weights = rng.dirichlet((2.0, 2.0, 2.0), PROBE_COUNT)
    points = np.einsum("ij,ijk->ik", weights, corners)
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    # by a sharp edge, the point off one face is already beyond the other
    sure = weights.min(axis=1) * 2 * area[chosen] / np.maximum(longest, touch_mm) > 20 * touch_mm
    points, normals = points[sure], np.asarray(mesh.face_normals)[chosen[sure]]
    wrong = np.ones(len(points), dtype=bool)
    for direction in DIRECTIONS:
        todo = np.flatnonzero(wrong)
        if len(todo) < FEW_PROBES:
            return
        off = 2 * touch_mm * normals[todo]
        outer = _winding(mesh, caster, points[todo] + off, direction, touch_mm)
        inner = _winding(mesh, caster, points[todo] - off, direction, touch_mm)
        wrong[todo] = (outer != 0) | (inner != 1)
    if wrong.sum() >= FEW_PROBES:
        x, y, z = points[np.flatnonzero(wrong)[0]] + middle
        raise SelfIntersectingCadError(
            f"{where}: the surface touches or crosses itself near ({x:.2f}, {y:.2f}, {z:.2f}) mm; "
            "unite the bodies in the CAD system and export it again"
        )


def _winding(
    mesh: trimesh.Trimesh,
    caster: RayCaster,
    origins: FloatArray,
    direction: FloatArray,
    touch_mm: float,
    shell: Int32Array | None = None,
    own_shell: IntArray | None = None,
) -> IntArray:
    """Return the winding number of the surface about each point: 0 outside, 1 inside, (n,).

    Counts the surfaces a ray leaves by less those it enters by; ``own_shell`` (n,) is not counted.
    """
    directions = np.broadcast_to(direction / np.linalg.norm(direction), origins.shape)
    normals = np.asarray(mesh.face_normals)
    turns = np.zeros(len(origins), dtype=np.int64)
    step = np.full(len(origins), 0.1 * touch_mm)
    far = np.full(len(origins), np.inf)
    for ray, triangle in _hits(caster, origins, directions, step, far):
        if shell is not None and own_shell is not None:
            counted = shell[triangle] != own_shell[ray]
            ray, triangle = ray[counted], triangle[counted]
        leaves = np.einsum("ij,ij->i", normals[triangle], directions[ray])
        np.add.at(turns, ray, np.sign(leaves).astype(np.int64))
    return turns


def _hits(
    caster: RayCaster,
    origins: FloatArray,
    directions: FloatArray,
    step: FloatArray,
    limit: FloatArray,
) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield all hits of rays, in turns: the rays, and the next triangle that each meets.

    ``step`` (n,) is how far a ray starts behind its origin and goes on behind each hit, ``limit``
    (n,) where it ends, both in units of its direction's length. A ray within a triangle's plane
    meets it again and again: it is reported once, and the steps grow until the ray is past it.
    """
    ray = np.arange(len(origins))
    reached, stride = step.copy(), step.copy()
    last = np.full((len(origins), 2), -1, dtype=np.int64)
    for _ in range(MANY_HITS):
        triangle, ahead = caster.first_hit(
            origins[ray] + reached[ray, None] * directions[ray],
            directions[ray],
            limit[ray] - reached[ray],
        )
        distance = reached[ray] + ahead
        met = (triangle >= 0) & (distance < limit[ray])
        ray, hit, distance = ray[met], triangle[met].astype(np.int64), distance[met]
        if len(ray) == 0:
            return
        fresh = (last[ray] != hit[:, None]).all(axis=1)
        if fresh.any():
            yield ray[fresh], hit[fresh]
        last[ray, 1] = np.where(last[ray, 0] == hit, last[ray, 1], last[ray, 0])
        last[ray, 0] = hit
        stride[ray] = np.where(fresh, step[ray], 2 * stride[ray])
        reached[ray] = distance + stride[ray]
