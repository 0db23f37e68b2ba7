"""List of unmeasured sizes of features, each with the reason.

A feature of the CAD model has a diameter or a width, a position and a depth, whether a picture
shows them or not. This module compares the sizes of all features with the measured
characteristics, and lists those not covered, so that a PASS can name them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from controller.arrays import FloatArray
from controller.cad import Feature, Solid
from controller.cad.graph import components
from controller.cad.surfaces import FeatureWall
from messages import key, say

from .._types import Characteristic, CharacteristicKind, EdgePairGeometry
from ..edges import RoundWall
from ..edges.rims import COAXIAL_COS
from .holes import MIN_DEPTH_MM
from .planes import SAME_LEVEL_MM
from .sheet import drawn_mm, size_text

NO_DEPTH: Final = key("no picture shows the depth of a hole")
NO_HEIGHT: Final = key("no plane across the part is measured against its end")
NO_FLOOR: Final = key("no plane of the part is measured against its floor")
NO_PLACE: Final = key("no plane of the part is measured against its walls")
NO_WALLS: Final = key("no two of its walls face each other at a distance that is measured")
NO_ENDS: Final = key("its ends have no rim in one plane")
SHALLOW: Final = say(
    "it is less than {min_depth_mm:g} mm high, as marks and letters are", min_depth_mm=MIN_DEPTH_MM
)
ROUNDED: Final = key("its rim is rounded off or ends in corners, so no edge shows it")
SHORT: Final = key("its open rims go round by no more than a half")
NOT_ROUND: Final = key("none of its rims goes all the way round")
CONE: Final = key("the rim of a cone is compared, not measured")
BEVEL: Final = key("the edges of a chamfer are compared, not measured")
NO_ARC: Final = key("no open rim of 60 degrees or more shows its radius")
OWN_DATUM: Final = key("it is the outline that places are given from")

_KIND = CharacteristicKind


@dataclass(frozen=True, eq=False, slots=True)
class Unmeasured:
    """An unmeasured size of a feature.

    Attributes
    ----------
    kind, name, size_mm : kind, name for people, and nominal value; 0 for a position
    faces : faces of the feature
    geometry : place and axis, without edges
    reason : reason why it is not measured
    """

    kind: CharacteristicKind
    name: str
    size_mm: float
    faces: tuple[int, ...]
    geometry: EdgePairGeometry
    reason: str


def unmeasured(
    solid: Solid,
    features: Sequence[Feature],
    walls: Sequence[RoundWall],
    rows: Sequence[Characteristic],
) -> list[Unmeasured]:
    """Return the sizes of features not covered by a characteristic, feature by feature.

    Parameters
    ----------
    solid, features, walls : solid, features and round walls of the part
    rows : characteristics of the part
    """
    known = _Known(solid, rows, walls)
    return [
        Unmeasured(
            kind,
            say("{name} {word}", name=name, word=word),
            size,
            faces,
            _geometry(feature),
            reason,
        )
        for feature in features
        for name, word, kind, size, faces, reason in _wanted(solid, feature, known)
    ]


def _geometry(feature: Feature) -> EdgePairGeometry:
    face = feature.faces[0]
    return EdgePairGeometry((), (), feature.axis, face, face, middle_mm=feature.position_mm)


_Wanted = tuple[str, str, CharacteristicKind, float, tuple[int, ...], str]


def _wanted(solid: Solid, feature: Feature, known: "_Known") -> Iterator[_Wanted]:
    """Yield each uncovered size of a feature: name, word, kind, size, faces, reason."""
    match feature.kind:
        case "hole" | "boss":
            yield from _round(feature, known)
        case "slot" | "keyway" | "pocket" | "opening":
            yield from _recess(solid, feature, known)
        case "chamfer":
            name = say(
                "chamfer {size_text} F{faces}",
                size_text=size_text(feature.width_mm),
                faces=feature.faces[0],
            )
            yield name, "width", _KIND.WIDTH, feature.width_mm, feature.faces, BEVEL
        case "fillet":
            if not known.has(feature.faces[0], _KIND.RADIUS, _KIND.DIAMETER):
                radius = feature.diameter_mm / 2
                word = "fillet" if feature.is_concave else "round"
                name = say(
                    "{word} R{size_text} F{faces}",
                    word=word,
                    size_text=size_text(radius),
                    faces=feature.faces[0],
                )
                yield name, "radius", _KIND.RADIUS, radius, feature.faces, NO_ARC


def _round(feature: Feature, known: "_Known") -> Iterator[_Wanted]:
    """Yield the uncovered sizes of a hole or a boss."""
    base = say("{kind} {size_text}", kind=feature.kind, size_text=size_text(feature.diameter_mm))
    widest = max((s.diameter_mm for s in feature.steps if s.kind == "cylinder"), default=0.0)
    for step in feature.steps:
        faces = (step.face,)
        own = say(" step {size_text}", size_text=size_text(step.diameter_mm))
        name = say(
            "{base} F{face}{own}",
            base=base,
            face=step.face,
            own=own if step.diameter_mm != feature.diameter_mm else "",
        )
        if step.kind == "cylinder":
            for kind, word, size in (
                (_KIND.DIAMETER, "diameter", step.diameter_mm),
                (_KIND.POSITION, "position", 0.0),
            ):
                if not known.has(step.face, kind):
                    yield name, word, kind, size, faces, known.why_no_rim(step, kind)
        elif step.kind == "cone" and step.diameter_mm > widest + SAME_LEVEL_MM:
            # The tip of a drilled hole is no wider than its wall.
            yield name, "diameter", _KIND.DIAMETER, step.diameter_mm, faces, CONE
    if feature.kind == "boss":
        if not known.is_placed(feature.ends, feature.faces):
            name = say("{base} F{face}", base=base, face=feature.steps[0].face)
            yield name, "height", _KIND.DISTANCE, feature.depth_mm, feature.faces, NO_HEIGHT
    elif not feature.is_through and not known.has_depth(feature.faces):
        name = say("{base} F{face}", base=base, face=feature.steps[0].face)
        yield name, "depth", _KIND.DISTANCE, feature.depth_mm, feature.faces, NO_DEPTH


def _recess(solid: Solid, feature: Feature, known: "_Known") -> Iterator[_Wanted]:
    """Yield the uncovered sizes of a slot, a keyway, a pocket or an opening."""
    name = recess_name(feature)
    is_ring = feature.kind in ("pocket", "opening")
    is_by_rims = not is_ring and any(solid.faces[i].kind == "cylinder" for i in feature.faces)
    if not feature.across or not known.are_joined(*feature.across[0]):
        faces = feature.across[0] if feature.across else feature.faces
        yield name, "width", _KIND.WIDTH, feature.width_mm, faces, NO_WALLS
    if is_ring:
        for pair in feature.across[1:]:
            if not known.are_joined(*pair):
                yield name, "length", _KIND.LENGTH, feature.length_mm, pair, NO_WALLS
        if len(feature.across) < 2:
            yield name, "length", _KIND.LENGTH, feature.length_mm, feature.faces, NO_WALLS
    elif is_by_rims and not known.has_length(feature.faces):
        yield name, "length", _KIND.LENGTH, feature.length_mm, feature.faces, NO_ENDS
    if is_by_rims:
        is_placed = known.has(feature.faces[0], _KIND.POSITION)
    else:
        pairs = feature.across[: 2 if is_ring else 1]
        is_placed = len(pairs) > is_ring and all(
            known.is_placed(pair, feature.faces) for pair in pairs
        )
    if not is_placed:
        why = NO_ENDS if is_by_rims else NO_PLACE
        yield name, "position", _KIND.POSITION, 0.0, feature.faces, why
    is_deep = (bool(feature.ends) or not feature.is_through) and not known.has_depth(feature.faces)
    if is_deep and not known.is_placed(feature.ends, feature.faces):
        faces = feature.ends or feature.faces
        yield name, "depth", _KIND.DISTANCE, feature.depth_mm, faces, NO_FLOOR


def recess_name(feature: Feature) -> str:
    """Return the name of a slot, a keyway, a pocket or an opening, with its sizes."""
    return say(
        "{kind} {width:g} x {length} F{face}",
        kind=feature.kind,
        width=drawn_mm(feature.width_mm),
        length=size_text(feature.length_mm),
        face=feature.faces[0],
    )


class _Known:
    """Characteristics of a part by face, and the planes that they join."""

    def __init__(
        self, solid: Solid, rows: Sequence[Characteristic], walls: Sequence[RoundWall]
    ) -> None:
        self._kinds: dict[int, set[CharacteristicKind]] = {}
        self._depths: set[int] = set()
        self._lengths: list[frozenset[int]] = []
        self._wall = {face: wall for wall in walls for face in wall.faces}
        joined = _levels(solid)
        for row in rows:
            for face in row.faces:
                self._kinds.setdefault(face, set()).add(row.kind)
            if isinstance(row.geometry, EdgePairGeometry):
                joined.append((row.geometry.one_face, row.geometry.other_face))
                if row.is_depth:
                    self._depths.update(row.faces)
            elif row.kind is _KIND.LENGTH:
                self._lengths.append(frozenset(row.faces))
            elif row.kind is _KIND.DISTANCE:
                self._depths.update(row.faces)
        ends = np.array(joined, dtype=np.intp).reshape(-1, 2)
        self._level = components(len(solid.faces), *ends.T)
        self._is_plane = np.array([face.kind == "plane" for face in solid.faces])

    def has(self, face: int, *kinds: CharacteristicKind) -> bool:
        """Return True if a face has a characteristic of any of some kinds."""
        return not self._kinds.get(face, set()).isdisjoint(kinds)

    def has_depth(self, faces: Sequence[int]) -> bool:
        """Return True if a wall among the faces has a depth."""
        return bool(self._depths & set(faces))

    def has_length(self, faces: Sequence[int]) -> bool:
        """Return True if the faces of a slot have a length, measured at its round ends."""
        return any(own <= set(faces) for own in self._lengths)

    def are_joined(self, one: int, other: int) -> bool:
        """Return True if the distance between two planes follows from characteristics."""
        return bool(self._level[one] == self._level[other])

    def is_placed(self, planes: Sequence[int], own: Sequence[int]) -> bool:
        """Return True if characteristics give the distance of planes from other planes of the part.

        Parameters
        ----------
        planes : ids of the planes, all of which must be placed
        own : faces of the same feature, which do not count as references
        """
        others = self._is_plane.copy()
        others[list(own)] = False
        return bool(planes) and all(
            bool((others & (self._level == self._level[plane])).any()) for plane in planes
        )

    def why_no_rim(self, step: FeatureWall, kind: CharacteristicKind) -> str:
        """Return the reason why a wall of a hole or boss lacks a diameter or a position."""
        wall = self._wall.get(step.face)
        if kind is _KIND.POSITION and self.has(step.face, _KIND.DIAMETER):
            return OWN_DATUM
        if wall is None or wall.height_mm < MIN_DEPTH_MM:
            return SHALLOW
        if wall.rims:
            return SHORT
        return NOT_ROUND if wall.has_edge else ROUNDED


def _levels(solid: Solid) -> list[tuple[int, int]]:
    """Return the pairs of parallel planes at one level, with no size between them."""
    planes = [face for face in solid.faces if face.kind == "plane"]
    if len(planes) < 2:
        return []
    normals: FloatArray = np.array([face.normal / np.linalg.norm(face.normal) for face in planes])
    main = np.abs(normals).argmax(axis=1)
    normals = normals * np.sign(normals[np.arange(len(normals)), main])[:, None]
    heights = (normals * np.array([face.centre_mm for face in planes])).sum(axis=1)
    lean = float(np.sqrt(2 * (1 - COAXIAL_COS)))
    places = np.column_stack([normals * SAME_LEVEL_MM / lean, heights])
    pairs = cKDTree(places).query_pairs(SAME_LEVEL_MM)
    return [(planes[i].id, planes[j].id) for i, j in sorted(pairs)]
