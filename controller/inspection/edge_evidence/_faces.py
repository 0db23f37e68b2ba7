"""Which faces their edges stand for: walls of holes, and faces with no room for a comparison."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from controller.arrays import BoolArray, FloatArray, IndexArray
from controller.cad import Solid

from ..dimensions import MeasuringSettings
from ._depth import is_floor_in_place
from ._edges import PartEdges
from ._looks import EdgeLook, State
from ._recesses import Recess, find_recesses

GREATER_PART: Final = 0.5  # of the edges of a face, in place
BESIDE: Final = 1.5  # times their spacing, points of two mouths are one above the other
PER_FACE: Final = 400  # random points on a face find its largest disc to some per cent


@dataclass(frozen=True, slots=True)
class FaceEdges:
    """What its edges prove of a face.

    Attributes
    ----------
    share : of the length of its sharp edges, in place; of a wall, of its mouths
    look_count : pictures that show any of it in place
    is_verified : they stand for a surface that cannot be compared
    how : by what, in words; empty where it is not verified
    """

    share: float
    look_count: int
    is_verified: bool = False
    how: str = ""


def prove_faces(
    solid: Solid,
    edges: PartEdges,
    looks: Sequence[EdgeLook],
    narrow: BoolArray,
    settings: MeasuringSettings,
) -> dict[int, FaceEdges]:
    """Return by face id what edges prove.

    A wall of a through hole is shown by the light through it: both its rims may be in place with
    a web between them. One of a blind hole is shown by its rim, once the floor is shown not to be
    half as deep. Any other narrow face is shown by its edges, in pictures in which the smallest
    defect would have moved them.

    Parameters
    ----------
    solid : the part
    edges : of it
    looks : at them
    narrow : (f,) no disc of the smallest defect on the face is far enough from its edges
    settings : what is uncertain before any picture
    """
    recess_of = {wall: recess for recess in find_recesses(solid) for wall in recess.walls}
    floors = {
        id(recess): is_floor_in_place(edges, looks, recess, settings)
        for recess in recess_of.values()
        if not recess.is_through
    }
    held = confirmed(looks, np.stack([look.state == State.IN_PLACE for look in looks]))
    out = {}
    for face in range(len(solid.faces)):
        own, side = np.nonzero(edges.faces == face)
        if len(own) == 0:
            continue
        share = _share(edges, own, held[own])
        count = sum(bool((look.state[own] == State.IN_PLACE).any()) for look in looks)
        how = ""
        recess = recess_of.get(face)
        if recess is not None and recess.is_through:
            share, how = _through(edges, looks, recess, face)
        elif recess is not None:
            share, how = _blind(edges, looks, recess, face, floors[id(recess)])
        if not how and narrow[face]:
            told = [(look.state == State.IN_PLACE) for look in looks]
            for look, one in zip(looks, told, strict=True):
                one[own] &= look.is_sensitive[own, side]
            told_share = _share(edges, own, confirmed(looks, np.stack(told))[own])
            if told_share >= GREATER_PART:
                share, how = told_share, "of its edges"
        out[face] = FaceEdges(share, count, bool(how), how)
    return out


def confirmed(looks: Sequence[EdgeLook], in_place: BoolArray) -> BoolArray:
    """Return at which points (n,) an edge is in place, and not found elsewhere more often.

    Parameters
    ----------
    looks : k pictures
    in_place : (k, n) where they show it in place
    """
    elsewhere = np.sum([look.state == State.ELSEWHERE for look in looks], axis=0)
    times = in_place.sum(axis=0)
    return np.asarray((times > 0) & (times >= elsewhere))


def _through(
    edges: PartEdges, looks: Sequence[EdgeLook], recess: Recess, face: int
) -> tuple[float, str]:
    """Return what share of a wall is shown, and by what; no words where it is too little."""
    is_wall = edges.faces == face
    ends = [
        np.flatnonzero(is_wall.any(axis=1) & np.isin(edges.edge, list(mouth)))
        for mouth in recess.mouths
    ]
    if any(len(end) == 0 for end in ends):
        return 0.0, ""
    light = np.stack([
        (look.state == State.IN_PLACE) & (look.light_through & is_wall).any(axis=1)
        for look in looks
    ])  # fmt: skip
    lit_through = confirmed(looks, light)
    share = min(
        _share(edges, end, lit_through[end] | _beneath(edges, end, other, lit_through, recess))
        for end, other in (ends, ends[::-1])
    )
    return share, "of its rims, by the light through it," if share >= GREATER_PART else ""


def _beneath(
    edges: PartEdges,
    end: IndexArray,
    other: IndexArray,
    shown: BoolArray,
    recess: Recess,
) -> BoolArray:
    """Return at which points of one mouth the other shows, above or beneath them."""
    there = other[shown[other]]
    if len(there) == 0:
        return np.zeros(len(end), dtype=np.bool_)
    flat = edges.points_mm - (edges.points_mm @ recess.axis)[:, None] * recess.axis
    near, _ = cKDTree(flat[there]).query(flat[end])
    return np.asarray(near <= BESIDE * edges.length_mm[end])


def _blind(
    edges: PartEdges,
    looks: Sequence[EdgeLook],
    recess: Recess,
    face: int,
    floor_is_in_place: bool,
) -> tuple[float, str]:
    """Return what share of a wall's mouth is shown, and by what; no words if that is too little."""
    is_wall = edges.faces == face
    mouth = np.flatnonzero(is_wall.any(axis=1) & np.isin(edges.edge, list(recess.mouths[0])))
    if len(mouth) == 0:
        return 0.0, ""
    shown = confirmed(
        looks,
        np.stack([
            (look.state == State.IN_PLACE) & (look.faces_camera & ~is_wall).any(axis=1)
            for look in looks
        ]),
    )  # fmt: skip
    share = _share(edges, mouth, shown[mouth])
    is_shown = floor_is_in_place and share >= GREATER_PART
    return share, "of its rim, its floor at its depth," if is_shown else ""


def _share(edges: PartEdges, points: IndexArray, shown: BoolArray) -> float:
    """Return the share of the length of some points (k,) at which something is shown (k,)."""
    length = edges.length_mm[points]
    return float((length * shown).sum() / length.sum())


def inner_mm(solid: Solid) -> FloatArray:
    """Return the radius (f,) of the largest disc on each face, off its edges; inf without any."""
    b = solid.boundary
    vertices = np.asarray(solid.mesh.vertices, dtype=np.float64)
    corners = np.asarray(solid.mesh.triangles, dtype=np.float64)
    areas = np.asarray(solid.mesh.area_faces)
    rng = np.random.default_rng(0)
    out = np.full(len(solid.faces), np.inf)
    sides = b.face.reshape(-1, 2)
    for face in range(len(solid.faces)):
        polylines = [
            vertices[b.chain_of(e)] for e in np.flatnonzero((sides == face).any(axis=1)).tolist()
        ]
        mine = np.flatnonzero(solid.face_of_triangle == face)
        if not polylines or len(mine) == 0:
            continue
        drawn = rng.choice(mine, PER_FACE, p=areas[mine] / areas[mine].sum())
        u, v = rng.random((2, PER_FACE, 1))
        u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
        a, p, q = np.moveaxis(corners[drawn], 1, 0)
        points = a + u * (p - a) + v * (q - a)
        out[face] = _max_distance(points, polylines)
    return out


def _max_distance(points: FloatArray, polylines: Sequence[FloatArray]) -> float:
    """Return the largest distance of points (n, 3) from the nearest of some polylines."""
    start = np.concatenate([line[:-1] for line in polylines])
    along = np.concatenate([np.diff(line, axis=0) for line in polylines])
    square = np.maximum((along**2).sum(axis=1), 1e-18)
    t = np.clip(((points[:, None] - start) * along).sum(axis=2) / square, 0.0, 1.0)
    off = points[:, None] - (start + t[..., None] * along)
    return float(np.sqrt((off**2).sum(axis=2)).min(axis=1).max())
