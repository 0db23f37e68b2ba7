"""Features that drawings dimension: holes, slots, pockets, bosses, fillets.

A hole is a set of walls on one axis that face it, with their ledges, countersinks and bottom; its
type follows from the types of the faces and of the edges between them (cell-facts.md 4).
"""

from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from controller.arrays import FloatArray
from messages import key, say

from ..boundary import Crease, Face
from ..solid import Solid
from ._bands import Band, chamfers, fillets
from ._recesses import recesses
from ._slots import Slot, grooves, round_ended
from ._walls import End, Wall, ends_of, find_walls, stacks

FeatureKind = Literal["hole", "slot", "keyway", "pocket", "opening", "boss", "chamfer", "fillet"]


@dataclass(frozen=True, slots=True)
class FeatureWall:
    """One wall of a hole or a boss: its largest diameter, and its extent."""

    kind: Literal["cylinder", "cone", "torus"]
    face: int
    diameter_mm: float
    depth_mm: float
    half_angle_rad: float = 0.0


@dataclass(frozen=True, eq=False, slots=True)
class Feature:
    """A feature of a part with sizes of its own.

    Attributes
    ----------
    kind : type of the feature
    faces : ids of its surfaces
    diameter_mm : diameter of a hole's narrowest cylinder, of a boss, of the round of a fillet, of a
        chamfer round an axis where it is widest; else 0
    depth_mm : depth of a hole or a slot from its mouth to its bottom, tip included, or to its other
        mouth; height of a boss; else 0; slots stand for keyways, pockets and openings, too
    width_mm : width of a slot between its nearest walls, of a chamfer across its face; else 0
    length_mm : length of a slot from end to end, of a chamfer or a fillet along its edge; else 0
    axis : (3,) into the material of a hole or a slot, out of it for a boss, along a fillet or a
        chamfer
    position_mm : (3,) middle of the mouth, of the free end of a boss, of a chamfer or a fillet
    is_through : True for holes and slots open at both ends, and for grooves that run through
    across : axis across a slot: pairs of planes that face each other, the nearest first
    ends : planes that its depth or its height leads to: floors, the free end of a boss
    is_concave : True for fillets in an inner corner
    steps : walls of a hole or a boss from the mouth or the free end on
    """

    kind: FeatureKind
    faces: tuple[int, ...]
    diameter_mm: float
    depth_mm: float
    width_mm: float
    length_mm: float
    axis: FloatArray
    position_mm: FloatArray
    is_through: bool = False
    is_concave: bool = False
    steps: tuple[FeatureWall, ...] = field(default=())
    across: tuple[tuple[int, int], ...] = ()
    ends: tuple[int, ...] = ()

    @property
    def label(self) -> str:
        """The name that people use, as in ``hole 8.0 mm through``."""
        match self.kind:
            case "hole":
                depth = (
                    "through"
                    if self.is_through
                    else say("{depth_mm:.1f} mm deep", depth_mm=self.depth_mm)
                )
                stepped = len([s for s in self.steps if s.kind == "cylinder"]) > 1
                return say(
                    "{what} {diameter_mm:.1f} mm {depth}",
                    what=key("stepped hole") if stepped else "hole",
                    diameter_mm=self.diameter_mm,
                    depth=depth,
                )
            case "slot" | "keyway" | "pocket" | "opening":
                # a groove that runs through has a floor all the same
                depth = say(
                    "{depth_mm:.1f} mm deep{what}",
                    depth_mm=self.depth_mm,
                    what=key(", through") if self.is_through else "",
                )
                return say(
                    "{kind} {width_mm:.1f} x {length_mm:.1f} mm, {depth}",
                    kind=self.kind,
                    width_mm=self.width_mm,
                    length_mm=self.length_mm,
                    depth=depth,
                )
            case "boss":
                return say(
                    "boss {diameter_mm:.1f} mm, {depth_mm:.1f} mm high",
                    diameter_mm=self.diameter_mm,
                    depth_mm=self.depth_mm,
                )
            case "chamfer":
                return say("chamfer {width_mm:.1f} mm wide", width_mm=self.width_mm)
            case "fillet":
                return say(
                    "{word} R{radius_mm:.1f} mm",
                    word="fillet" if self.is_concave else "round",
                    radius_mm=self.diameter_mm / 2,
                )


def find_features(solid: Solid) -> tuple[Feature, ...]:
    """Return the features of a part, kind by kind, each by its largest face.

    A face may be on several: a rounded rim is part of its hole and a fillet as well.
    """
    walls = find_walls(solid)
    found = [f for stack in stacks(solid, walls, concave=True) if (f := _hole(solid, stack))]
    long = round_ended(solid, walls)
    long += recesses(solid, set(walls) | _faces_of(long))
    found += [_slot(slot) for slot in long + grooves(solid, _faces_of(long))]
    found += [f for stack in stacks(solid, walls, concave=False) if (f := _boss(solid, stack))]
    found += [_band("chamfer", band) for band in chamfers(solid, walls)]
    slotted = {face for f in found if f.kind in ("slot", "keyway") for face in f.faces}
    found += [_band("fillet", b) for b in fillets(solid, walls) if b.face.id not in slotted]
    kinds = get_args(FeatureKind)
    return tuple(sorted(found, key=lambda f: (kinds.index(f.kind), min(f.faces), f.faces)))


def _faces_of(slots: list[Slot]) -> set[int]:
    return {face for slot in slots for face in slot.faces}


def _axis(stack: list[Wall]) -> FloatArray:
    return max((wall.face for wall in stack), key=lambda face: face.area_mm2).axis


def _hole(solid: Solid, stack: list[Wall]) -> Feature | None:
    axis = _axis(stack)
    ends = ends_of(solid, stack, axis)
    if ends is None or not (ends[0].is_open or ends[1].is_open):
        return None
    low, high = ends
    from_high = high.is_open and (not low.is_open or round(high.radius_mm - low.radius_mm, 3) >= 0)
    mouth, bottom = (high, low) if from_high else (low, high)
    inward = -axis if from_high else axis
    steps = _steps(stack, mouth, inward)
    faces = [wall.face.id for wall in stack]
    faces += _ledges(solid, stack)
    if not bottom.is_open and bottom.beyond is not None:
        faces.append(bottom.beyond)
    return Feature(
        kind="hole",
        faces=tuple(sorted(set(faces))),
        diameter_mm=_diameter(steps),
        depth_mm=float(np.abs((bottom.point_mm - mouth.point_mm) @ axis)),
        width_mm=0.0,
        length_mm=0.0,
        axis=inward,
        position_mm=mouth.point_mm,
        is_through=low.is_open and high.is_open,
        steps=steps,
        ends=() if bottom.is_open else _planes(solid, bottom),
    )


def _boss(solid: Solid, stack: list[Wall]) -> Feature | None:
    if all(wall.face.kind == "torus" for wall in stack):
        return None
    axis = _axis(stack)
    ends = ends_of(solid, stack, axis)
    if ends is None:
        return None
    low, high = ends
    low_free, high_free = (_is_free(solid, stack, end) for end in ends)
    if low_free == high_free:
        return None
    free, base = (high, low) if high_free else (low, high)
    outward = axis if high_free else -axis
    steps = _steps(stack, free, -outward)
    if not any(step.kind == "cylinder" for step in steps):
        return None
    faces = [wall.face.id for wall in stack]
    if free.beyond is not None:
        faces.append(free.beyond)
    return Feature(
        kind="boss",
        faces=tuple(sorted(set(faces))),
        diameter_mm=max(step.diameter_mm for step in steps if step.kind == "cylinder"),
        depth_mm=float(np.abs((free.point_mm - base.point_mm) @ axis)),
        width_mm=0.0,
        length_mm=0.0,
        axis=outward,
        position_mm=free.point_mm,
        steps=steps,
        ends=_planes(solid, free),
    )


def _planes(solid: Solid, end: End) -> tuple[int, ...]:
    beyond = end.beyond
    return () if beyond is None or solid.faces[beyond].kind != "plane" else (beyond,)


def _is_free(solid: Solid, stack: list[Wall], end: End) -> bool:
    """Return True if a boss ends here; a hollow round at its foot is a fillet, not an end."""
    if not end.is_open:
        return False
    for wall in stack:
        for rim in wall.rims:
            if rim.beyond == end.beyond and wall.face.kind == "torus" and wall.face.concave:
                return rim.crease == Crease.CONVEX
    return True


def _ledges(solid: Solid, stack: list[Wall]) -> list[int]:
    inside = {wall.face.id for wall in stack}
    beyond = [rim.beyond for wall in stack for rim in wall.rims if rim.beyond not in inside]
    return [i for i in set(beyond) if beyond.count(i) > 1 and solid.faces[i].kind == "plane"]


def _steps(stack: list[Wall], mouth: End, inward: FloatArray) -> tuple[FeatureWall, ...]:
    steps = []
    for wall in stack:
        levels = [float((rim.point_mm - mouth.point_mm) @ inward) for rim in wall.rims]
        radius = max(rim.radius_mm for rim in wall.rims)
        face: Face = wall.face
        if face.kind == "cylinder":
            radius = face.radius_mm
        elif face.kind == "cone" and len(wall.rims) == 1:
            apex = face.centre_mm - face.axis * face.radius_mm / np.tan(face.half_angle_rad)
            levels.append(float((apex - mouth.point_mm) @ inward))
        depth = max(levels) - min(levels)
        step = FeatureWall(face.kind, face.id, 2 * radius, depth, face.half_angle_rad)  # type: ignore[arg-type]  # walls are round
        steps.append((min(levels), step))
    return tuple(step for _, step in sorted(steps, key=lambda pair: pair[0]))


def _diameter(steps: tuple[FeatureWall, ...]) -> float:
    straight = [step.diameter_mm for step in steps if step.kind == "cylinder"]
    return min(straight) if straight else max(step.diameter_mm for step in steps)


def _slot(slot: Slot) -> Feature:
    return Feature(
        kind=slot.kind,
        faces=slot.faces,
        diameter_mm=0.0,
        depth_mm=slot.depth_mm,
        width_mm=slot.width_mm,
        length_mm=slot.length_mm,
        axis=slot.inward,
        position_mm=slot.position_mm,
        is_through=slot.is_through,
        across=slot.across,
        ends=slot.ends,
    )


def _band(kind: Literal["chamfer", "fillet"], band: Band) -> Feature:
    return Feature(
        kind=kind,
        faces=(band.face.id,),
        diameter_mm=band.diameter_mm,
        depth_mm=0.0,
        width_mm=band.width_mm,
        length_mm=band.length_mm,
        axis=band.along,
        position_mm=band.face.centre_mm,
        is_concave=band.face.concave,
    )
