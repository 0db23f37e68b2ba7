"""Directions worth showing: square ones, an even sphere, and those that hard spots ask for.

Directions are unit vectors in the part frame from its centre of mass to the camera.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controller.cad import RayCaster, Solid, SurfaceSamples

from ..boxes import BoolArray
from ..layout import FloatArray, IntArray
from ._rules import SightRules
from ._visible import cosines, eyes_of, first_met, free_sight, visible_from

SPHERE_N = 90
SQUARE_SHARE = 0.02  # of all area: a planar face at least this large deserves a square view
SAME_RAD = np.radians(3.0)
# 3 degrees apart: a spot shown only within a narrower cone than this could not be relied on, as
# the hold is known to two degrees
SEARCHED_N = 4096
# a spot with one direction is lost if a finger or a joint limit takes that one
WANTED_N = 3
MOST_ADDED = 0.5  # of the even sphere's number, for spots that have a direction already


@dataclass(frozen=True, slots=True, eq=False)
class Directions:
    """Candidate directions (v, 3) and, for square views, the face each is square to (else -1)."""

    vectors: FloatArray
    square_to: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Lookout:
    """Directions and what each shows of the bare part, with the evidence for what none shows.

    Attributes
    ----------
    directions : square ones first, then the even sphere, then those added for hard spots
    visible : (v, n) bool
    best_incidence_rad : (n,) the squarest at which any camera place sees a sample past the part,
        resolution and sharpness aside; pi/2 where none does
    blocker : (n,) the face that stands before the squarest look at a sample, -1 if none does
    too_coarse, blurred : (n,) bool, not visible though the sight line is free at an incidence
        allowed: pixels too few for the millimetre, or out of the depth of field
    """

    directions: Directions
    visible: BoolArray
    best_incidence_rad: FloatArray
    blocker: IntArray
    too_coarse: BoolArray
    blurred: BoolArray


def even_sphere(count: int) -> FloatArray:
    """Return unit vectors spread evenly over the sphere (count, 3), by the golden angle."""
    k = np.arange(count) + 0.5
    polar, azimuth = np.arccos(1 - 2 * k / count), np.pi * (1 + 5**0.5) * k
    return np.column_stack(
        [np.cos(azimuth) * np.sin(polar), np.sin(azimuth) * np.sin(polar), np.cos(polar)]
    )


def candidate_directions(solid: Solid, count: int = SPHERE_N) -> Directions:
    """Return square directions first (large planes, axes of bores), then an even sphere."""
    total = sum(f.area_mm2 for f in solid.faces)
    vectors: list[FloatArray] = []
    square: list[int] = []

    def add(d: FloatArray, face_id: int) -> None:
        if not vectors or (np.stack(vectors) @ d).max() < np.cos(SAME_RAD):
            vectors.append(d)
            square.append(face_id)

    for face in solid.faces:
        if face.kind == "plane" and face.area_mm2 >= SQUARE_SHARE * total:
            add(face.normal, face.id)
    for face in solid.faces:
        if face.kind == "cylinder" and face.concave:
            add(face.axis, face.id)
            add(-face.axis, face.id)
    for d in even_sphere(count):
        add(d, -1)
    return Directions(np.stack(vectors), np.array(square))


def look_out(
    solid: Solid,
    samples: SurfaceSamples,
    caster: RayCaster,
    rules: SightRules,
    count: int = SPHERE_N,
) -> Lookout:
    """Return candidate directions with what they show, hard spots looked for on purpose.

    What fewer than `WANTED_N` of the first directions show is looked for among `SEARCHED_N`, and
    straight at its normals, so that "hidden by the part" does not hang on `count`.
    """
    base = candidate_directions(solid, count)
    visible = visible_from(solid, samples, caster, base.vectors, rules)
    added = _added(solid, samples, caster, rules, base.vectors, visible, int(MOST_ADDED * count))
    if len(added):
        more = visible_from(solid, samples, caster, added, rules)
        visible = np.vstack([visible, more])
    directions = Directions(
        np.vstack([base.vectors, added]),
        np.concatenate([base.square_to, np.full(len(added), -1, dtype=base.square_to.dtype)]),
    )
    best, blocker, coarse, blurred = _evidence(solid, samples, caster, rules, directions, visible)
    return Lookout(directions, visible, best, blocker, coarse, blurred)


def _added(
    solid: Solid,
    samples: SurfaceSamples,
    caster: RayCaster,
    rules: SightRules,
    known: FloatArray,
    visible: BoolArray,
    most: int,
) -> FloatArray:
    """Return further directions (k, 3): greedily those that help most samples to `WANTED_N`."""
    short = WANTED_N - visible.sum(axis=0)
    (hard,) = np.nonzero(short > 0)
    if len(hard) == 0:
        return np.zeros((0, 3))
    few = SurfaceSamples(
        samples.points_mm[hard],
        samples.normals[hard],
        samples.face_ids[hard],
        samples.areas_mm2[hard],
    )
    tried = np.vstack([even_sphere(SEARCHED_N), _straight_at(solid, few, rules)])
    tried = tried[(tried @ known.T).max(axis=1) < np.cos(np.radians(0.5))]
    shows = visible_from(solid, few, caster, tried, rules)
    useful = shows.any(axis=1)
    tried, table = tried[useful], shows[useful].astype(np.float32)
    missing = np.minimum(short[hard], table.sum(axis=0))
    bare = ~visible[:, hard].any(axis=0)
    chosen: list[int] = []
    while len(table) and (missing > 0).any():
        # what nothing shows comes first, and is sought however many it takes
        never = bare & (missing > 0)
        if len(chosen) >= most and not never.any():
            break
        gain = table @ (missing > 0).astype(np.float32) + 1e3 * (table @ never.astype(np.float32))
        gain[chosen] = -1.0
        k = int(np.argmax(gain))
        if gain[k] <= 0:
            break
        chosen.append(k)
        missing = missing - table[k]
        bare &= table[k] == 0
    return tried[chosen]


def _straight_at(solid: Solid, samples: SurfaceSamples, rules: SightRules) -> FloatArray:
    """Return the directions from which the camera looks straight at samples, alike ones once."""
    eyes = _eye_along(solid, samples.points_mm, samples.normals, rules)
    d = (eyes - solid.centroid_mm) / rules.distance_mm
    kept: list[int] = []
    for k in range(len(d)):
        if not kept or (d[kept] @ d[k]).max() < np.cos(np.radians(1.0)):
            kept.append(k)
    return np.asarray(d[kept])


def _eye_along(
    solid: Solid, points: FloatArray, along: FloatArray, rules: SightRules
) -> FloatArray:
    """Return where lines from points (n, 3) meet the sphere the camera can stand on (n, 3)."""
    offset = points - solid.centroid_mm
    half = np.einsum("ij,ij->i", offset, along)
    inner = half**2 - np.einsum("ij,ij->i", offset, offset) + rules.distance_mm**2
    return np.asarray(points + (np.sqrt(np.maximum(inner, 0.0)) - half)[:, None] * along)


def _evidence(
    solid: Solid,
    samples: SurfaceSamples,
    caster: RayCaster,
    rules: SightRules,
    directions: Directions,
    visible: BoolArray,
) -> tuple[FloatArray, IntArray, BoolArray, BoolArray]:
    """Return best incidence, blocking face, too coarse, blurred of each sample (n,)."""
    n = len(samples.points_mm)
    eyes = eyes_of(solid, directions.vectors, rules)
    best = np.full(n, -1.0)
    for k, eye in enumerate(eyes):
        cosine = cosines(samples, eye)
        best = np.where(visible[k], np.maximum(best, cosine), best)
    blocker = np.full(n, -1, dtype=np.int64)
    coarse, blurred = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    (never,) = np.nonzero(~visible.any(axis=0))
    if len(never) == 0:
        return np.arccos(np.clip(best, 0.0, 1.0)), blocker, coarse, blurred
    straight = _eye_along(solid, samples.points_mm[never], samples.normals[never], rules)
    start = samples.points_mm[never] + 0.02 * samples.normals[never]
    met = first_met(caster, start, straight)
    blocker[never] = np.where(met >= 0, solid.face_of_triangle[np.maximum(met, 0)], -1)
    fan = eyes_of(solid, np.vstack([directions.vectors, even_sphere(SEARCHED_N)]), rules)
    limit = np.cos(rules.max_incidence_rad)
    from_com = samples.points_mm - solid.centroid_mm
    few = SurfaceSamples(
        samples.points_mm[never],
        samples.normals[never],
        samples.face_ids[never],
        samples.areas_mm2[never],
    )
    top = np.full(len(never), -1.0)
    for eye in fan:
        cosine = cosines(few, eye)
        # only what would be news needs a ray
        (ask,) = np.nonzero((cosine > np.maximum(top, 0.0)) | (cosine >= limit))
        if len(ask) == 0:
            continue
        ask = ask[free_sight(few, caster, ask, eye)]
        top[ask] = np.maximum(top[ask], cosine[ask])
        allowed = ask[cosine[ask] >= limit]
        if len(allowed):
            direction = (eye - solid.centroid_mm) / rules.distance_mm
            depth = rules.depth_bounds_mm(from_com[never[allowed]], direction)
            coarse[never[allowed]] |= ~rules.is_fine(cosine[allowed], depth)
            blurred[never[allowed]] |= ~rules.is_sharp(depth)
    best[never] = top
    return np.arccos(np.clip(best, 0.0, 1.0)), blocker, coarse, blurred
