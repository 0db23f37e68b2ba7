"""Pockets and openings: walls that close round one direction, with a floor or without."""

from collections.abc import Iterator

import numpy as np

from controller.arrays import FloatArray

from ..boundary import Crease, Curve, Face
from ..graph import components
from ..solid import Solid
from ._bands import edge_lengths, half_edges_by_face
from ._slots import PARALLEL, SAME_MM, Slot, points_of

MIN_WALLS = 3  # fewer walls do not close


def recesses(solid: Solid, left_out: set[int]) -> list[Slot]:
    """Return the pockets and openings of a part.

    Their walls are planes, and the rounds in which two of these may meet, joined by edges along one
    direction to a ring that faces inwards. A ring that is open at both ends is an opening, one with
    a floor a pocket.

    Parameters
    ----------
    solid : the part
    left_out : faces that are walls of holes, or of slots with round ends
    """
    sides, lengths = half_edges_by_face(solid), edge_lengths(solid)
    found = (_recess(solid, sides, lengths, ring, along) for along, ring in _rings(solid, left_out))
    return [one for one in found if one is not None]


def _rings(solid: Solid, left_out: set[int]) -> Iterator[tuple[FloatArray, list[int]]]:
    """Yield the direction of each ring of walls, and their faces."""
    b = solid.boundary
    is_wall = np.array(
        [
            face.id not in left_out
            and (face.kind == "plane" or (face.kind == "cylinder" and face.concave))
            for face in solid.faces
        ]
    )
    is_plane = np.array([face.kind == "plane" for face in solid.faces])
    pairs = b.face.reshape(-1, 2)
    joins = (b.curve == Curve.LINE) & is_wall[pairs].all(axis=1)
    joins &= (b.crease == Crease.CONCAVE) | (
        (b.crease == Crease.SMOOTH) & ~is_plane[pairs].all(axis=1)
    )
    edges = np.nonzero(joins)[0]
    ways = b.vertices_mm[b.origin[2 * edges + 1]] - b.vertices_mm[b.origin[2 * edges]]
    ways /= np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-9)
    while len(edges):
        along = ways[0]
        mine = np.abs(ways @ along) > PARALLEL
        ends = np.unique(np.sort(pairs[edges[mine]], axis=1), axis=0)
        edges, ways = edges[~mine], ways[~mine]
        count = len(solid.faces)
        label = components(count, *ends.T)
        beside = np.bincount(ends.ravel(), minlength=count)
        for one in np.unique(label[ends[:, 0]]).tolist():
            ring = np.nonzero(label == one)[0]
            if len(ring) >= MIN_WALLS and (beside[ring] == 2).all():
                yield along, ring.tolist()


def _recess(
    solid: Solid, sides: list[list[int]], lengths: FloatArray, ring: list[int], along: FloatArray
) -> Slot | None:
    """Return the slot that a ring of walls forms; None where neither of its ends is open."""
    points = np.concatenate([points_of(solid, i) for i in ring])
    heights = points @ along
    low, high = float(heights.min()), float(heights.max())
    floors = _floors(solid, sides, lengths, ring, along, (low + high) / 2)
    if all(floors):
        return None
    planes = sorted(
        (solid.faces[i] for i in ring if solid.faces[i].kind == "plane"),
        key=lambda face: (-face.area_mm2, face.id),
    )
    if not planes:
        return None
    facing = sorted(_facing(planes), key=lambda pair: round(pair[0], 2))
    across = solid.faces[facing[0][1]].normal if facing else planes[0].normal
    beside = np.cross(along, across)
    width = facing[0][0] if facing else float(np.ptp(points @ across))
    inward = along if floors[1] else -along
    middle = [float((v.min() + v.max()) / 2) for v in (points @ across, points @ beside)]
    mouth = low if floors[1] else high
    floor = floors[0] or floors[1]
    return Slot(
        kind="pocket" if floor else "opening",
        faces=tuple(sorted({*ring, *floor})),
        width_mm=width,
        length_mm=float(np.ptp(points @ beside)),
        depth_mm=high - low,
        inward=inward,
        position_mm=middle[0] * across + middle[1] * beside + mouth * along,
        is_through=not floor,
        across=tuple((i, j) for _, i, j in facing),
        ends=tuple(sorted(i for i in floor if solid.faces[i].kind == "plane")),
    )


def _facing(planes: list[Face]) -> Iterator[tuple[float, int, int]]:
    """Yield the distance and the ids of walls that face each other, each wall once."""
    left = list(planes)
    while left:
        one = left.pop(0)
        for other in left:
            gap = float((other.centre_mm - one.centre_mm) @ one.normal)
            if one.normal @ other.normal < -PARALLEL and gap > SAME_MM:
                left.remove(other)
                yield gap, one.id, other.id
                break


def _floors(
    solid: Solid,
    sides: list[list[int]],
    lengths: FloatArray,
    ring: list[int],
    along: FloatArray,
    middle: float,
) -> tuple[set[int], set[int]]:
    """Return the faces that close the lower and the upper end of a ring, none where it is open.

    An end is closed if more of it runs into hollow edges, or smoothly into hollow rounds, than into
    outer ones.
    """
    b = solid.boundary
    inside = set(ring)
    closed, beyond = [0.0, 0.0], (set[int](), set[int]())
    for h in (h for i in ring for h in sides[i]):
        face, edge = int(b.face[h ^ 1]), h // 2
        if face in inside:
            continue
        run = solid.mesh.vertices[b.chain_of(edge)]
        end = int(float((run @ along).mean()) > middle)
        is_hollow = b.crease[edge] == Crease.CONCAVE or (
            b.crease[edge] == Crease.SMOOTH and solid.faces[face].concave
        )
        closed[end] += float(lengths[edge]) if is_hollow else -float(lengths[edge])
        if not is_hollow:
            continue
        beyond[end].add(face)
        if b.crease[edge] == Crease.SMOOTH:  # a round at the foot of the walls: its floor as well
            feet = {int(b.face[g ^ 1]) for g in sides[face] if b.crease[g // 2] == Crease.SMOOTH}
            beyond[end].update(feet - inside)
    low, high = (faces if size > 0 else set() for size, faces in zip(closed, beyond, strict=True))
    return low, high
