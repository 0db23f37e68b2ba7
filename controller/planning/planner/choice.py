"""The points that views are chosen by, and those that count what the chosen ones show (ADR 57).

Views are chosen from tables of every direction and grasp, which fewer points have to do for: some
millimetres apart, and closer where few directions show anything, in bores and pockets. What the
plan then shows is counted by the denser points of `controller.cad.counted_samples`.
"""

from __future__ import annotations

import numpy as np

from controller.arrays import IntArray
from controller.cad import Solid, SurfaceSamples, counted_samples
from controller.imaging import RayCaster

from ..model import Counted, VisibilityTable
from ..views import (
    VisibilityRules,
    candidate_directions,
    hidden_ones,
    nearest_on_face,
    visible_from,
)

SPACING_MM = 1.5  # of the points among which hard spots are found
FEW = 5  # directions; a spot that fewer show is a hard one
MAX_ADDED_SHARE = 0.4  # hard spots added at most, of the points there are
MIN_ADDED = 150
STREAM = 2  # of the draw: these points are not the ones that coverage is counted by


def with_hard_spots(
    solid: Solid,
    samples: SurfaceSamples,
    caster: RayCaster,
    rules: VisibilityRules,
    direction_count: int,
) -> SurfaceSamples:
    """Return samples with more of them where few directions show the surface.

    Parameters
    ----------
    solid : the part
    samples : n, of its surface
    caster : rays against its mesh
    rules : how the camera stands, and what it asks of a surface
    direction_count : of the even sphere
    """
    dense = counted_samples(solid, SPACING_MM, STREAM)
    vectors = candidate_directions(solid, direction_count).vectors
    left, count = np.arange(len(dense.points_mm)), np.zeros(len(dense.points_mm), dtype=np.int64)
    for vector in vectors[_scattered(len(vectors)), None]:
        count[left] += visible_from(solid, dense.rows(left), caster, vector, rules)[0]
        left = left[count[left] < FEW]
    hard = left[count[left] > 0]
    most = max(MIN_ADDED, int(MAX_ADDED_SHARE * len(samples.points_mm)))
    if len(hard) > most:
        by_face = hard[np.argsort(dense.face_ids[hard], kind="stable")]
        hard = by_face[np.linspace(0, len(hard) - 1, most).round().astype(int)]
    points, normals, faces = (
        np.concatenate([getattr(samples, name), getattr(dense, name)[hard]])
        for name in ("points_mm", "normals", "face_ids")
    )
    both = SurfaceSamples(points, normals, faces, np.zeros(len(points)))
    areas = np.bincount(nearest_on_face(both, dense), dense.areas_mm2, len(points))
    return SurfaceSamples(points, normals, faces, areas.astype(np.float64))


def make_counted(
    solid: Solid,
    chosen_by: SurfaceSamples,
    counted: SurfaceSamples,
    caster: RayCaster,
    rules: VisibilityRules,
    visibility_table: VisibilityTable,
) -> Counted:
    """Return the points that coverage is counted by, and which of them no direction shows.

    Parameters
    ----------
    solid : the part
    chosen_by : n samples that views are chosen by
    counted : m samples
    caster : rays against its mesh
    rules : how the camera stands, and what it asks of a surface
    visibility_table : of the n samples
    """
    # what shows most first: after a few directions little is left to be looked for
    order = np.argsort(-(visibility_table.visible @ chosen_by.areas_mm2), kind="stable")
    vectors = visibility_table.directions.vectors[order]
    return Counted(
        samples=counted,
        nearest=nearest_on_face(chosen_by, counted),
        of_chosen=nearest_on_face(counted, chosen_by),
        evidence=hidden_ones(solid, counted, caster, rules, vectors),
    )


def _scattered(count: int) -> IntArray:
    """Return the numbers below a count, those that follow each other far apart."""
    return np.argsort((np.arange(count) * 0.6180339887498949) % 1.0, kind="stable")
