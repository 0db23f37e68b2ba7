"""Directions worth showing: square ones, an even sphere, and those that hard spots ask for.

Directions are unit vectors in the part frame from its centre of mass to the camera.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controller.arrays import BoolArray, FloatArray, IntArray
from controller.cad import Solid, SurfaceSamples
from controller.imaging import RayCaster

from ...model import Directions, VisibilityTable
from ._rules import VisibilityRules
from ._visible import (
    LIFT_MM,
    chunks,
    cosines,
    eyes_of,
    first_met,
    free_sight_lines,
    visible_from,
)

SPHERE_COUNT = 90
SQUARE_SHARE = 0.02  # of all area: a planar face at least this large deserves a square view
SAME_RAD = np.radians(3.0)
# 3 degrees apart: a spot shown only within a narrower cone than this could not be relied on, as
# the hold is known to two degrees
SEARCHED_COUNT = 4096
MIN_SEARCHED_COUNT = 512
RAY_COUNT = 1_000_000
# a spot with one direction is lost if a finger or a joint limit takes that one
WANTED_COUNT = 3
FIRST_WORTH = 1e3  # of a first direction, beside a further one
MAX_ADDED = 0.5  # of the even sphere's number, for spots that have a direction already


def even_sphere(count: int) -> FloatArray:
    """Return unit vectors spread evenly over the sphere (count, 3), by the golden angle."""
    k = np.arange(count) + 0.5
    polar, azimuth = np.arccos(1 - 2 * k / count), np.pi * (1 + 5**0.5) * k
    return np.column_stack(
        [np.cos(azimuth) * np.sin(polar), np.sin(azimuth) * np.sin(polar), np.cos(polar)]
    )


def candidate_directions(solid: Solid, count: int = SPHERE_COUNT) -> Directions:
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
    rules: VisibilityRules,
    count: int = SPHERE_COUNT,
) -> VisibilityTable:
    """Return candidate directions with what they show, hard spots looked for on purpose.

    What fewer than `WANTED_COUNT` of the first directions show is looked for among
    `SEARCHED_COUNT`, and straight at its normals, so that "hidden by the part" does not
    hang on `count`.

    Parameters
    ----------
    solid : the part
    samples : of its surface
    caster : rays against its mesh
    rules : how the camera stands, and what it asks of a surface
    count : directions spread evenly, before those that are added
    """
    base = candidate_directions(solid, count)
    visible = visible_from(solid, samples, caster, base.vectors, rules)
    n = len(samples.points_mm)
    best = np.zeros(n)
    for rows in chunks(len(visible), n):
        cosine = cosines(samples, eyes_of(solid, base.vectors[rows], rules))
        best = np.maximum(best, np.where(visible[rows], cosine, 0.0).max(axis=0))
    blocker = np.full(n, -1, dtype=np.int64)
    coarse, blurred = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    short = WANTED_COUNT - visible.sum(axis=0)
    (hard,) = np.nonzero(short > 0)
    if len(hard) == 0:
        return VisibilityTable(base, visible, np.arccos(best), blocker, coarse, blurred)
    few = SurfaceSamples(
        samples.points_mm[hard],
        samples.normals[hard],
        samples.face_ids[hard],
        samples.areas_mm2[hard],
    )
    bare: BoolArray = np.asarray(~visible[:, hard].any(axis=0))
    search = _search(solid, few, caster, rules, base.vectors, bare)
    near = (search.vectors @ base.vectors.T).max(axis=1) > np.cos(np.radians(0.5))
    useful = search.shows.any(axis=1) & ~near
    table = search.shows[useful]
    added = search.vectors[useful][_chosen(table, short[hard], bare, int(MAX_ADDED * count))]
    if len(added):
        visible = np.vstack([visible, visible_from(solid, samples, caster, added, rules)])
    directions = Directions(
        np.vstack([base.vectors, added]),
        np.concatenate([base.square_to, np.full(len(added), -1, dtype=base.square_to.dtype)]),
    )
    best[hard] = np.maximum(best[hard], search.best_cosine)
    never = ~visible[:, hard].any(axis=0)
    coarse[hard], blurred[hard] = search.coarse & never, search.blurred & never
    straight = _eye_along(solid, few.points_mm[never], few.normals[never], rules)
    met = first_met(caster, few.points_mm[never] + LIFT_MM * few.normals[never], straight)
    blocker[hard[never]] = np.where(met >= 0, solid.face_of_triangle[np.maximum(met, 0)], -1)
    return VisibilityTable(
        directions, visible, np.arccos(np.clip(best, 0, 1)), blocker, coarse, blurred
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """What many directions (d, 3) show (d, n) of the hard spots, and of those nothing shows why."""

    vectors: FloatArray
    shows: BoolArray
    best_cosine: FloatArray
    coarse: BoolArray
    blurred: BoolArray


def _search(
    solid: Solid,
    samples: SurfaceSamples,
    caster: RayCaster,
    rules: VisibilityRules,
    known: FloatArray,
    bare: BoolArray,
) -> _Search:
    """Look at hard spots from everywhere; at bare ones (n,), whatever the incidence."""
    n = len(samples.points_mm)
    # where whole parts are out of focus every sample is a hard one: fewer looks will do
    even_count = int(np.clip(RAY_COUNT // n, MIN_SEARCHED_COUNT, SEARCHED_COUNT))
    vectors = np.vstack([known, even_sphere(even_count), _straight_at(solid, samples, rules)])
    shows = np.zeros((len(vectors), n), dtype=bool)
    best = np.zeros(n)
    coarse, blurred = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    from_com = samples.points_mm - solid.centroid_mm
    for rows in chunks(len(vectors), n):
        eyes = eyes_of(solid, vectors[rows], rules)
        cosine = cosines(samples, eyes)
        depth = rules.depth_bounds_mm(from_com, vectors[rows])
        good = rules.shows(cosine, depth)
        free = free_sight_lines(samples, caster, good | (bare & (cosine > 0.0)), eyes)
        shows[rows] = free & good
        best = np.maximum(best, np.where(free, cosine, 0.0).max(axis=0))
        allowed = free & rules.is_square_enough(cosine)
        coarse |= (allowed & ~rules.is_fine(cosine, depth)).any(axis=0)
        blurred |= (allowed & ~rules.is_sharp(depth)).any(axis=0)
    return _Search(vectors, shows, best, coarse, blurred)


def _chosen(shows: BoolArray, short: IntArray, bare: BoolArray, most: int) -> list[int]:
    """Return the directions that greedily help most spots to `WANTED_COUNT`.

    Parameters
    ----------
    shows : (d, n)
    short : (n,) how many more a spot wants
    bare : (n,) it has none yet
    most : directions to add for spots that have one; those that have none get theirs regardless
    """
    table = shows.astype(np.float32)
    missing = np.minimum(short, shows.sum(axis=0)).astype(np.float32)
    bare = bare & (missing > 0)
    chosen: list[int] = []
    while (missing > 0).any() and (len(chosen) < most or bare.any()):
        gain = table @ (missing > 0) + FIRST_WORTH * (table @ bare)
        gain[chosen] = -1.0
        k = int(np.argmax(gain))
        chosen.append(k)
        missing -= table[k]
        bare &= ~shows[k]
    return chosen


def _straight_at(solid: Solid, samples: SurfaceSamples, rules: VisibilityRules) -> FloatArray:
    """Return the directions from which the camera looks straight at samples, alike ones once."""
    eyes = _eye_along(solid, samples.points_mm, samples.normals, rules)
    d = (eyes - solid.centroid_mm) / rules.distance_mm
    kept: list[int] = []
    for k in range(len(d)):
        if not kept or (d[kept] @ d[k]).max() < np.cos(np.radians(1.0)):
            kept.append(k)
    return np.asarray(d[kept])


def _eye_along(
    solid: Solid, points: FloatArray, along: FloatArray, rules: VisibilityRules
) -> FloatArray:
    """Return where lines from points (n, 3) meet the sphere the camera can stand on (n, 3)."""
    offset = points - solid.centroid_mm
    half = np.einsum("ij,ij->i", offset, along)
    inner = half**2 - np.einsum("ij,ij->i", offset, offset) + rules.distance_mm**2
    return np.asarray(points + (np.sqrt(np.maximum(inner, 0.0)) - half)[:, None] * along)
