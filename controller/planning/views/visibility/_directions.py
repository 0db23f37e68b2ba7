"""Candidate directions: square ones, an even sphere, and those that hard spots need.

Directions are unit vectors in the part frame from its centre of mass to the camera.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from controller.arrays import BoolArray, FloatArray, IntArray
from controller.cad import Solid, SurfaceSamples
from controller.imaging import RayCaster

from ...model import Directions, HiddenEvidence, VisibilityTable
from ._fan import closest_free, eyes_along
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
SQUARE_SHARE = 0.02  # share of all area from which a planar face deserves a square view
SAME_RAD = np.radians(3.0)
# Directions 3 degrees apart: a spot shown only within a narrower cone than this could not be relied
# on, as the hold is known to two degrees.
ALIKE_RAD = np.radians(1.0)
WEDGE_RAD = np.radians(0.2)  # the same for two lines through narrow wedges
SEARCHED_COUNT = 4096  # directions of the whole sphere: 3 degrees apart
MIN_SEARCHED_COUNT = 512
RAY_COUNT = 1_000_000
# Directions wanted for a spot; a single one may be lost to a finger or a joint limit.
WANTED_COUNT = 3
FIRST_WORTH = 1e3  # worth of a first direction, relative to a further one
MAX_WEDGE_COUNT = 24  # number of directions for points that no other direction shows
# share of the even sphere's directions that is added for spots with a direction already
MAX_ADDED = 0.5


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


def with_directions(
    table: VisibilityTable,
    vectors: FloatArray,
    solid: Solid,
    samples: SurfaceSamples,
    caster: RayCaster,
    rules: VisibilityRules,
) -> VisibilityTable:
    """Return a table with more directions.

    Parameters
    ----------
    table : table of the samples
    vectors : (k, 3) vectors to add
    solid, samples, caster, rules : as in `look_out`
    """
    if len(vectors) == 0:
        return table
    square_to = table.directions.square_to
    return replace(
        table,
        directions=Directions(
            np.vstack([table.directions.vectors, vectors]),
            np.concatenate([square_to, np.full(len(vectors), -1, dtype=square_to.dtype)]),
        ),
        visible=np.vstack([table.visible, visible_from(solid, samples, caster, vectors, rules)]),
    )


def look_out(
    solid: Solid,
    samples: SurfaceSamples,
    caster: RayCaster,
    rules: VisibilityRules,
    count: int = SPHERE_COUNT,
) -> VisibilityTable:
    """Return candidate directions and what they show, with a search for views of hard spots.

    Surface that fewer than `WANTED_COUNT` of the first directions show is searched among
    `SEARCHED_COUNT` directions, and straight at its normals, so that "hidden by the part" does not
    depend on `count`.

    Parameters
    ----------
    solid : the part
    samples : samples of its surface
    caster : rays against its mesh
    rules : camera distance, and the limits on a surface's incidence
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
    incidence = np.arccos(np.minimum(best, 1.0))
    table = VisibilityTable(base, visible, incidence, blocker, coarse, blurred)
    if len(hard) == 0:
        return table
    few = samples.rows(hard)
    bare: BoolArray = np.asarray(~visible[:, hard].any(axis=0))
    search = _search(solid, few, caster, rules, base.vectors, bare)
    near = (search.vectors @ base.vectors.T).max(axis=1) > np.cos(np.radians(0.5))
    useful = search.shows.any(axis=1) & ~near
    added = helping_most(search.shows[useful], short[hard], bare, int(MAX_ADDED * count))
    vectors = search.vectors[useful][added]
    table = with_directions(table, vectors, solid, samples, caster, rules)
    best[hard] = np.maximum(best[hard], search.best_cosine)
    never = ~table.visible[:, hard].any(axis=0)
    coarse[hard], blurred[hard] = search.coarse & never, search.blurred & never
    blocker[hard[never]] = _standing_before(solid, few.rows(np.flatnonzero(never)), caster, rules)
    return replace(
        table,
        best_incidence_rad=np.arccos(np.clip(best, 0, 1)),
        blocker=blocker,
        too_coarse=coarse,
        blurred=blurred,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """Hard spots shown by many directions (d, 3), as (d, n), and evidence on the others."""

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
    """Look at hard spots from all directions; at bare ones (n,), at any incidence."""
    n = len(samples.points_mm)
    # where whole parts are out of focus every sample is a hard one: fewer looks will do
    even_count = int(np.clip(RAY_COUNT // n, MIN_SEARCHED_COUNT, SEARCHED_COUNT))
    vectors = np.vstack([known, even_sphere(even_count), _straight_at(solid, samples, rules)])
    search = _looked(solid, samples, caster, rules, vectors, bare)
    flat = np.arccos(np.clip(search.best_cosine, 0.0, 1.0)) > rules.max_incidence_rad
    (left,) = np.nonzero(bare & flat)
    closer, found = closest_free(solid, samples, caster, rules, left)
    if not found.any():
        return search
    added = _looked(solid, samples, caster, rules, _unlike(closer[found], WEDGE_RAD), bare)
    return _Search(
        np.vstack([search.vectors, added.vectors]),
        np.vstack([search.shows, added.shows]),
        np.maximum(search.best_cosine, added.best_cosine),
        search.coarse | added.coarse,
        search.blurred | added.blurred,
    )


def _looked(
    solid: Solid,
    samples: SurfaceSamples,
    caster: RayCaster,
    rules: VisibilityRules,
    vectors: FloatArray,
    bare: BoolArray,
) -> _Search:
    """Look at samples from some directions (d, 3); at bare ones (n,), at any incidence."""
    n = len(samples.points_mm)
    shows = np.zeros((len(vectors), n), dtype=bool)
    best = np.zeros(n)
    coarse, blurred = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    from_com = samples.points_mm - solid.centroid_mm
    for rows in chunks(len(vectors), n):
        eyes = eyes_of(solid, vectors[rows], rules)
        cosine = cosines(samples, eyes)
        depth = rules.depth_bounds_mm(from_com, vectors[rows])
        good = rules.shows(cosine, depth, samples.face_ids)
        free = free_sight_lines(samples, caster, good | (bare & (cosine > 0.0)), eyes)
        shows[rows] = free & good
        best = np.maximum(best, np.where(free, cosine, 0.0).max(axis=0))
        allowed = free & rules.is_square_enough(cosine)
        coarse |= (allowed & ~rules.is_fine(cosine, depth, samples.face_ids)).any(axis=0)
        blurred |= (allowed & ~rules.is_sharp(depth)).any(axis=0)
    return _Search(vectors, shows, best, coarse, blurred)


def hidden_ones(
    solid: Solid,
    samples: SurfaceSamples,
    caster: RayCaster,
    rules: VisibilityRules,
    directions: FloatArray,
) -> HiddenEvidence:
    """Return the evidence on samples that no direction shows, searched for as by `look_out`.

    Parameters
    ----------
    solid : the part
    samples : n, of its surface
    caster : rays against its mesh
    rules : camera distance, and the limits on a surface's incidence
    directions : (v, 3) directions for plans to choose from
    """
    n = len(samples.points_mm)
    left = np.arange(n)
    from_com = samples.points_mm - solid.centroid_mm
    for vector in directions[:, None]:
        eyes = eyes_of(solid, vector, rules)
        some = samples.rows(left)
        depth = rules.depth_bounds_mm(from_com[left], vector)
        good = rules.shows(cosines(some, eyes), depth, some.face_ids)
        left = left[~free_sight_lines(some, caster, good, eyes)[0]]
        if len(left) == 0:
            break
    evidence = HiddenEvidence(
        is_hidden=np.zeros(n, dtype=bool),
        best_incidence_rad=np.zeros(n),
        blocker=np.full(n, -1, dtype=np.int64),
        too_coarse=np.zeros(n, dtype=bool),
        blurred=np.zeros(n, dtype=bool),
    )
    if len(left) == 0:
        return evidence
    some = samples.rows(left)
    search = _search(solid, some, caster, rules, directions[:0], np.ones(len(left), dtype=bool))
    never = ~search.shows.any(axis=0)
    left, some = left[never], some.rows(np.flatnonzero(never))
    evidence.is_hidden[left] = True
    evidence.best_incidence_rad[left] = np.arccos(np.clip(search.best_cosine[never], 0.0, 1.0))
    evidence.too_coarse[left], evidence.blurred[left] = search.coarse[never], search.blurred[never]
    evidence.blocker[left] = _standing_before(solid, some, caster, rules)
    return evidence


def directions_into_wedges(
    solid: Solid,
    samples: SurfaceSamples,
    caster: RayCaster,
    rules: VisibilityRules,
    worth: FloatArray,
) -> FloatArray:
    """Return directions (k, 3) for samples that no even direction shows, most samples first.

    Parameters
    ----------
    solid : the part
    samples : n, of its surface, that no direction known so far shows
    caster : rays against its mesh
    rules : camera distance, and the limits on a surface's incidence
    worth : (n,) worth of each sample; directions worth less than 1 in all are dropped
    """
    n = len(samples.points_mm)
    if n == 0:
        return np.zeros((0, 3))
    none = np.zeros((0, 3))
    search = _search(solid, samples, caster, rules, none, np.ones(n, dtype=bool))
    chosen = most_worth(search.shows, worth)[:MAX_WEDGE_COUNT]
    return search.vectors[chosen]


def most_worth(shows: BoolArray, worth: FloatArray) -> list[int]:
    """Return rows (r, n) in the order of their added worth (n,), while it is 1 or more.

    Parameters
    ----------
    shows : (r, n) mask of what each row shows
    worth : (n,) worth of the samples shown
    """
    table, left = shows.astype(np.float64), worth.copy()
    chosen: list[int] = []
    while len(table):
        gain = table @ left
        k = int(np.argmax(gain))
        if gain[k] < 1.0:
            break
        chosen.append(k)
        left *= ~shows[k]
    return chosen


def _standing_before(
    solid: Solid, samples: SurfaceSamples, caster: RayCaster, rules: VisibilityRules
) -> IntArray:
    """Return the face that blocks a straight look at each sample (n,), -1 for none."""
    straight = eyes_along(solid, samples.points_mm, samples.normals, rules)
    met = first_met(caster, samples.points_mm + LIFT_MM * samples.normals, straight)
    return np.where(met >= 0, solid.face_of_triangle[np.maximum(met, 0)], -1)


def helping_most(
    shows: BoolArray, short: IntArray, bare: BoolArray, most: int | None = None
) -> list[int]:
    """Return the directions that greedily help most spots to as many views as are wanted.

    Parameters
    ----------
    shows : (d, n)
    short : (n,) number of further views that a spot needs
    bare : (n,) it has none yet, and those that have are less urgent
    most : directions to add for spots that have one; those that have none get theirs regardless;
        None for no limit
    """
    most = len(shows) if most is None else most
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
    """Return the directions in which the camera faces samples squarely, without repeats."""
    eyes = eyes_along(solid, samples.points_mm, samples.normals, rules)
    return _unlike((eyes - solid.centroid_mm) / rules.distance_mm, ALIKE_RAD)


def _unlike(d: FloatArray, angle_rad: float) -> FloatArray:
    """Return the first of unit vectors (n, 3) within an angle of each other, (k, 3)."""
    kept: list[int] = []
    for k in range(len(d)):
        if not kept or (d[kept] @ d[k]).max() < np.cos(angle_rad):
            kept.append(k)
    return np.asarray(d[kept])
