"""Distances between parallel planes, as on a drawing: each plane once, no closed chain.

In each direction with parallel planes, these are joined one by one, in this order: the outermost
two (overall length), planes that face each other across a gap (widths), planes with material
between them (thicknesses), and finally each remaining plane with the datum of the direction, the
larger of the outermost two (steps). A distance between planes that are already joined would follow
from others, and is left out.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.cad import Solid, sample_surface
from controller.imaging.rays import RayCaster
from messages import key, say

from .._types import CharacteristicKind, EdgeLine, EdgePairGeometry, Rim
from ..edges import convex_lines, plane_rims
from ..edges.profile import Profile
from ..edges.rims import COAXIAL_COS

# Least area of a dimensioned plane; letters and the ledges of small screws are smaller.
MIN_AREA_MM2: Final = 10.0
SAME_LEVEL_MM: Final = 0.02
MIN_DISTANCE_MM: Final = 0.5  # smallest size in ISO 2768-1
MIN_OPPOSITE_SHARE: Final = 0.5  # least share of the smaller plane that lies opposite the other
SAMPLES_PER_MM2: Final = 1.0 / 16.0
MIN_SAMPLES: Final = 24
OFF_MM: Final = 0.02
MAX_EDGES: Final = 8  # largest number of edges used per plane; more add little


@dataclass(frozen=True, eq=False, slots=True)
class PlanePair:
    """Two parallel planes with a distance to measure.

    Attributes
    ----------
    kind, word : kind of distance, and its name for people
    distance_mm : nominal distance
    geometry : edges of both planes that one side shows
    hidden : reason why no view can show both; empty where one can
    """

    kind: CharacteristicKind
    word: str
    distance_mm: float
    geometry: EdgePairGeometry
    hidden: str


@dataclass(frozen=True, eq=False, slots=True)
class _Plane:
    face: int
    level_mm: float
    sign: int
    area_mm2: float
    centre_mm: FloatArray
    lines: tuple[EdgeLine, ...]
    rims: tuple[Rim, ...]
    shown: BoolArray


def plane_pairs(solid: Solid, left_out: frozenset[int]) -> list[PlanePair]:
    """Return the distances between planes that a drawing would give.

    Parameters
    ----------
    solid : the part
    left_out : faces of chamfers and inside holes, which have other dimensions
    """
    caster = RayCaster(solid.mesh)
    opposite = _Opposites(solid, caster)
    edges = _Edges(solid)
    found = []
    for direction, faces in _directions(solid, left_out):
        profile = Profile(solid, direction, caster)
        planes = [edges.plane(i, direction, profile) for i in faces]
        planes.sort(key=lambda plane: (plane.level_mm, plane.face))
        joined = _joined(solid, direction, planes, opposite)
        found += [_pair(direction, *each) for each in joined]
    return found


def between(solid: Solid, one: int, other: int) -> PlanePair | None:
    """Return the distance between two planes; None if they are not parallel, or at one level.

    Parameters
    ----------
    solid : the part
    one, other : ids of the planes
    """
    faces = [solid.faces[i] for i in (one, other)]
    if any(face.kind != "plane" for face in faces):
        return None
    direction = faces[0].normal / np.linalg.norm(faces[0].normal)
    if abs(float(faces[1].normal @ direction)) < COAXIAL_COS:
        return None
    direction = direction if direction[int(np.abs(direction).argmax())] > 0 else -direction
    profile, edges = Profile(solid, direction, RayCaster(solid.mesh)), _Edges(solid)
    planes = [edges.plane(i, direction, profile) for i in (one, other)]
    low, high = sorted(planes, key=lambda plane: plane.level_mm)
    if high.level_mm - low.level_mm < MIN_DISTANCE_MM:
        return None
    return _pair(direction, low, high, CharacteristicKind.DISTANCE, "distance")


class _Edges:
    """Edges of a part by the planes that contain them."""

    def __init__(self, solid: Solid) -> None:
        self._solid = solid
        self._lines, self._rims = convex_lines(solid), plane_rims(solid)

    def plane(self, i: int, direction: FloatArray, profile: Profile) -> _Plane:
        face = self._solid.faces[i]
        lines, rims = self._lines.get(i, ()), self._rims.get(i, ())
        return _Plane(
            face=i,
            level_mm=float(face.centre_mm @ direction),
            sign=1 if face.normal @ direction > 0 else -1,
            area_mm2=face.area_mm2,
            centre_mm=face.centre_mm,
            lines=lines,
            rims=rims,
            shown=profile.of_plane(lines, rims),
        )


def _directions(solid: Solid, left_out: frozenset[int]) -> Iterator[tuple[FloatArray, list[int]]]:
    """Yield each direction with two or more planes, and the planes square to it."""
    todo = [
        face
        for face in solid.faces
        if face.kind == "plane" and face.area_mm2 >= MIN_AREA_MM2 and face.id not in left_out
    ]
    while todo:
        first = todo[0].normal / np.linalg.norm(todo[0].normal)
        mine = [face for face in todo if abs(float(face.normal @ first)) > COAXIAL_COS]
        ids = {face.id for face in mine}
        todo = [face for face in todo if face.id not in ids]
        if len(mine) > 1:
            main = int(np.abs(first).argmax())
            yield first if first[main] > 0 else -first, [face.id for face in mine]


class _Opposites:
    """Pairs of planes opposite each other, across air and across material."""

    def __init__(self, solid: Solid, caster: RayCaster) -> None:
        spacing = 1.0 / np.sqrt(SAMPLES_PER_MM2)
        samples = sample_surface(solid, spacing, MIN_SAMPLES)
        totals = np.bincount(samples.face_ids, minlength=len(solid.faces))
        self._through: list[dict[tuple[int, int], float]] = []
        for sign in (1.0, -1.0):  # outwards, across a gap; inwards, through material
            directions = sign * samples.normals
            triangle, _ = caster.first_hit(samples.points_mm + OFF_MM * directions, directions)
            hit = triangle >= 0
            meets = np.asarray(solid.face_of_triangle, dtype=np.int64)[triangle[hit]]
            pairs, counts = np.unique(
                np.stack([samples.face_ids[hit], meets], axis=1), axis=0, return_counts=True
            )
            share = counts / totals[pairs[:, 0]]
            keys = map(tuple, pairs.tolist())
            self._through.append(dict(zip(keys, share.tolist(), strict=True)))

    def share(self, one: _Plane, other: _Plane, *, gap: bool) -> float:
        """Return the share of the smaller of two planes that lies opposite the other."""
        small, large = sorted((one, other), key=lambda plane: plane.area_mm2)
        return self._through[0 if gap else 1].get((small.face, large.face), 0.0)


_Joined = tuple[_Plane, _Plane, CharacteristicKind, str]


def _joined(
    solid: Solid, direction: FloatArray, planes: list[_Plane], opposite: _Opposites
) -> list[_Joined]:
    """Return the dimensioned pairs of planes of one direction, and their kinds."""
    reach = np.asarray(solid.mesh.vertices) @ direction
    ends = [
        [
            plane
            for plane in planes
            if plane.sign == sign and abs(plane.level_mm - level) < SAME_LEVEL_MM
        ]
        for sign, level in ((-1, float(reach.min())), (1, float(reach.max())))
    ]
    outer = [max(end, key=lambda plane: plane.area_mm2) for end in ends if end]
    datum = max(outer or planes, key=lambda plane: plane.area_mm2)
    wanted: list[_Joined] = []
    if len(outer) == 2:
        wanted.append((outer[0], outer[1], CharacteristicKind.LENGTH, "length"))
    for gap, kind, word in (
        (True, CharacteristicKind.WIDTH, "width"),
        (False, CharacteristicKind.DISTANCE, "thickness"),
    ):
        facing = [
            (low, high)
            for i, low in enumerate(planes)
            for high in planes[i + 1 :]
            if low.sign == (1 if gap else -1)
            and high.sign == -low.sign
            and opposite.share(low, high, gap=gap) >= MIN_OPPOSITE_SHARE
        ]
        facing.sort(key=lambda pair: round(pair[1].level_mm - pair[0].level_mm, 2))
        wanted += [(low, high, kind, word) for low, high in facing]
    for plane in planes:
        low, high = (plane, datum) if plane.level_mm < datum.level_mm else (datum, plane)
        if plane is not datum:
            wanted.append((low, high, CharacteristicKind.DISTANCE, "step"))
    root = {plane.face: plane.face for plane in planes}

    def first(i: int) -> int:
        while root[i] != i:
            i = root[i]
        return i

    taken = []
    for low, high, kind, word in wanted:
        if first(low.face) == first(high.face):
            continue
        if high.level_mm - low.level_mm < MIN_DISTANCE_MM:
            if abs(high.level_mm - low.level_mm) < SAME_LEVEL_MM:
                root[first(high.face)] = first(low.face)  # planes at one level need no dimension
            continue
        root[first(high.face)] = first(low.face)
        taken.append((low, high, kind, word))
    return taken


def _pair(
    direction: FloatArray, low: _Plane, high: _Plane, kind: CharacteristicKind, word: str
) -> PlanePair:
    bare = [plane.face for plane in (low, high) if not (plane.lines or plane.rims)]
    if bare:
        hidden: str = say("no outer edge shows the level of F{bare}", bare=bare[0])
    elif not (low.shown & high.shown).any():
        hidden = key("no view from the side shows both its planes")
    else:
        hidden = ""
    geometry = EdgePairGeometry(
        low.lines[:MAX_EDGES],
        high.lines[:MAX_EDGES],
        direction,
        low.face,
        high.face,
        low.rims,
        high.rims,
        (low.centre_mm + high.centre_mm) / 2,
    )
    return PlanePair(kind, word, high.level_mm - low.level_mm, geometry, hidden)
