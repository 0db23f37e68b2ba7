"""Points for counting coverage: dense, evenly spread, denser in bores and on small faces.

Plans are fitted to points of their own (`sample_surface`), so that the gaps of a plan between them
become visible here (ADR 57).
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from controller.arrays import FloatArray, IntArray
from messages import say

from ..solid import Solid
from ._samples import SurfaceSamples, by_face, face_areas_mm2, placed_samples

# Largest number of points on faces that need no finer spacing; they are spaced wider then.
MAX_COUNT = 200_000
# Approximate number of points in all, with any number of bores and small faces.
BUDGET_COUNT = 300_000
ROUND_COUNT = 24  # points round a bore
PER_FACE = 1500  # points on a small face, for shares right to half a percent of it
PER_SPECK = 24  # points on a face of less than `SPECK_MM2`
SPECK_MM2 = 2.0
OFF_EDGE_MM = 0.004  # more would leave out a strip that a narrow face is blind in
DRAWN = 8  # candidates drawn for each square of the spacing
APART = 0.8  # least distance of two points, in spacings
TOGETHER = 8  # one candidate in so many is compared in pairs, the others with those kept
FEW_COUNT = 2000  # candidates compared in pairs all at once
WHOLE = 0.8  # share of the spacing that guarantees the spacing asked for
# Points are this share of the smallest defect apart: no spot of a defect's size is without one.
SAMPLE_SHARE = 1 / 3
ROUNDING = 1e-9
HALVINGS = 60  # halvings of the range in which a spacing is sought
# Steps of the sequence that spreads points over a square most evenly, by the plastic number.
STEPS = np.array([[0.7548776662466927], [0.5698402909980532]])


def counted_samples(
    solid: Solid, spacing_mm: float, stream: int = 1, most: int = BUDGET_COUNT
) -> SurfaceSamples:
    """Return the points that count coverage, at least one within the spacing of any place.

    Bores have at least `ROUND_COUNT` round, small faces at least `PER_FACE`. A part that would have
    too many of them has fewer, farther apart: `SurfaceSamples.reach_mm` says how far (ADR 72).
    Each point stands for the surface that is nearest to it. Seeded by the part's content: the same
    file gives the same points, and they are none of `sample_surface`.

    Parameters
    ----------
    solid : with its faces
    spacing_mm : on faces that need no finer one
    stream : stream of the draw; other streams have other points
    most : approximate number of points in all
    """
    rng = np.random.default_rng([int(solid.content_hash[:8], 16), stream])
    face_mm2 = face_areas_mm2(solid)
    spacings = _spacings_mm(solid, face_mm2, WHOLE * spacing_mm, most)
    counts = np.ceil(DRAWN * face_mm2 / spacings**2).astype(np.int64)
    number = np.arange(counts.sum())
    across = (rng.random((2, 1)) + STEPS * number) % 1.0
    drawn = placed_samples(solid, counts, np.full(len(number), 0.5), across, OFF_EDGE_MM)
    places = by_face(drawn.points_mm / spacings[drawn.face_ids, None], drawn.face_ids)
    kept = _apart(places, rng)
    _, nearest = cKDTree(places[kept]).query(places)
    return SurfaceSamples(
        points_mm=drawn.points_mm[kept],
        normals=drawn.normals[kept],
        face_ids=drawn.face_ids[kept],
        areas_mm2=np.bincount(nearest, drawn.areas_mm2, len(kept)).astype(np.float64),
        reach_mm=max(spacing_mm, float(spacings.max()) / WHOLE),
    )


def counted_defect_mm(samples: SurfaceSamples, smallest_mm: float) -> float:
    """Return the smallest size of a defect that cannot lie unnoticed between samples [mm].

    Parameters
    ----------
    samples : samples of `counted_samples`, or any whose reach is known; others are taken as near
        enough
    smallest_mm : size of the smallest defect that they were drawn for
    """
    counted_mm = (samples.reach_mm or 0.0) / SAMPLE_SHARE
    return counted_mm if counted_mm > smallest_mm * (1 + ROUNDING) else smallest_mm


def count_caution(samples: SurfaceSamples, smallest_mm: float) -> str:
    """Return a sentence on the defects that coverage samples may miss, without a full stop.

    Empty where there are none.

    Parameters
    ----------
    samples : as for `counted_defect_mm`
    smallest_mm : size of the smallest defect that is to be found
    """
    counted_mm = counted_defect_mm(samples, smallest_mm)
    if counted_mm <= smallest_mm:
        return ""
    return say(
        "Coverage is counted by {points_mm_count:,} points, no more than "
        "memory has room for: a spot of {counted_mm:.2g} mm or more cannot "
        "be missed by them, one of {smallest_mm:g} mm can",
        points_mm_count=len(samples.points_mm),
        counted_mm=counted_mm,
        smallest_mm=smallest_mm,
    )


def _apart(places: FloatArray, rng: np.random.Generator) -> IntArray:
    """Return the indices of places (n, d) kept by thinning, none nearer to another than `APART`.

    Greedy thinning in random order: a candidate is kept if no kept one is near. The first ones
    decide about most of the others, so that few pairs are compared.
    """
    order = np.argsort(rng.permutation(len(places)))
    kept: list[IntArray] = []
    while len(order):
        count = max(len(order) // TOGETHER, FEW_COUNT)
        first, order = order[:count], order[count:]
        kept.append(first[_first_apart(places[first])])
        near, _ = cKDTree(places[kept[-1]]).query(
            places[order], distance_upper_bound=np.nextafter(APART, 1.0)
        )
        order = order[near > APART]
    return np.sort(np.concatenate(kept)) if kept else order


def _first_apart(places: FloatArray) -> IntArray:
    """Return the indices of the places kept by greedy thinning in the given order.

    In rounds: of those near each other the one that comes first is kept.
    """
    pairs = cKDTree(places).query_pairs(APART, output_type="ndarray")
    pairs.sort(axis=1)  # the first of each pair goes before the second
    is_open, is_kept = np.ones((2, len(places)), dtype=bool)
    is_kept[:] = False
    while is_open.any():
        beaten = np.zeros(len(places), dtype=bool)
        beaten[pairs[:, 1]] = True
        is_kept |= is_open & ~beaten
        is_open &= beaten
        is_open[pairs[is_kept[pairs[:, 0]], 1]] = False
        pairs = pairs[is_open[pairs].all(axis=1)]
    return np.flatnonzero(is_kept)


def _spacings_mm(solid: Solid, face_mm2: FloatArray, spacing_mm: float, budget: int) -> FloatArray:
    """Return the spacing of points on each face (f,)."""
    wide = max(spacing_mm, float(np.sqrt(face_mm2.sum() / MAX_COUNT)))
    most = MAX_COUNT / max(len(face_mm2), 1)
    least = np.where(face_mm2 < SPECK_MM2, min(PER_SPECK, most), min(PER_FACE, most))
    spacings = np.minimum(wide, np.sqrt(face_mm2 / least))
    for face in solid.faces:
        if face.concave and face.kind in ("cylinder", "cone") and face.radius_mm > 0.0:
            round_mm = 2 * np.pi * face.radius_mm / ROUND_COUNT
            spacings[face.id] = min(spacings[face.id], round_mm)
    spacings = np.maximum(spacings, 1e-6)
    return np.maximum(spacings, _finest_mm(face_mm2, spacings, budget))


def _finest_mm(face_mm2: FloatArray, spacings: FloatArray, budget: int) -> float:
    """Return the finest spacing for a budget of points, 0.0 where no limit is needed.

    It widens the finest spacings first: those of bores and small faces, which are finer than a
    defect requires so that the share of each face is known well. Only once all spacings are equal
    may spots of a defect's size be without a point.
    """

    def count(finest: float) -> float:
        return float((face_mm2 / np.maximum(spacings, finest) ** 2).sum())

    if count(0.0) <= budget:
        return 0.0
    low, high = 0.0, float(np.sqrt(face_mm2.sum() / budget))
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if count(middle) > budget else (low, middle)
    return high
