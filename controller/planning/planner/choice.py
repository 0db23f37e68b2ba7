"""Points by which views are chosen, and points that count the result (ADR 57).

Views are chosen from tables of every direction and grasp, which allow fewer points: some
millimetres apart, and closer in bores and pockets, where few directions show anything. Blind spots
of these views are found by denser points, for further views. The resulting plan is counted by
points of a third draw, `controller.cad.counted_samples`, that chose nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controller.arrays import FloatArray, IntArray
from controller.cad import Solid, SurfaceSamples, counted_samples
from controller.imaging import RayCaster

from ..model import Counted, PlanOptions, VisibilityTable
from ..views import (
    VisibilityRules,
    candidate_directions,
    directions_into_wedges,
    hidden_ones,
    nearest_on_face,
    visible_from,
    with_directions,
)

SPACING_MM = 1.5  # spacing of the points among which hard spots are found
FEW = 5  # directions; a spot with fewer is hard
MAX_ADDED_SHARE = 0.4  # hard spots added at most, of the points there are
MIN_ADDED = 150
STREAM = 2  # stream of the draw: these points are not those that count coverage


# Portion of the share that a PASS needs of a face or bore that is worth a view of its own: of what
# is shown, some is not compared, and a plan that shows no more than is needed has no reserve.
PORTION = 0.5
# Area of the usual smallest defect, 3 mm across: no view is taken for less.
SPOT_MM2 = 7.0


@dataclass(frozen=True, slots=True, eq=False)
class Dense:
    """Points close together, and how many of some directions (d, 3) show each, up to `FEW`."""

    samples: SurfaceSamples
    shown_count: IntArray
    directions: FloatArray


def dense_points(
    solid: Solid, caster: RayCaster, rules: VisibilityRules, direction_count: int
) -> Dense:
    """Return points close together on all of a part, and which of them few directions show.

    Parameters
    ----------
    solid : the part
    caster : rays against its mesh
    rules : camera distance, and the limits on a surface's incidence
    direction_count : number of directions of the even sphere
    """
    dense = counted_samples(solid, SPACING_MM, STREAM)
    vectors = candidate_directions(solid, direction_count).vectors
    left, count = np.arange(len(dense.points_mm)), np.zeros(len(dense.points_mm), dtype=np.int64)
    for vector in vectors[_scattered(len(vectors)), None]:
        count[left] += visible_from(solid, dense.rows(left), caster, vector, rules)[0]
        left = left[count[left] < FEW]
    return Dense(dense, count, vectors)


def with_hard_spots(samples: SurfaceSamples, dense: Dense) -> SurfaceSamples:
    """Return samples (n) with more of them where few directions show the surface."""
    (hard,) = np.nonzero((dense.shown_count > 0) & (dense.shown_count < FEW))
    most = max(MIN_ADDED, int(MAX_ADDED_SHARE * len(samples.points_mm)))
    points = dense.samples
    if len(hard) > most:
        by_face = hard[np.argsort(points.face_ids[hard], kind="stable")]
        hard = by_face[np.linspace(0, len(hard) - 1, most).round().astype(int)]
    at, normals, faces = (
        np.concatenate([getattr(samples, name), getattr(points, name)[hard]])
        for name in ("points_mm", "normals", "face_ids")
    )
    both = SurfaceSamples(at, normals, faces, np.zeros(len(at)))
    areas = np.bincount(nearest_on_face(both, points), points.areas_mm2, len(at))
    return SurfaceSamples(at, normals, faces, areas.astype(np.float64))


def into_wedges(
    dense: Dense,
    table: VisibilityTable,
    solid: Solid,
    samples: SurfaceSamples,
    caster: RayCaster,
    rules: VisibilityRules,
    options: PlanOptions,
) -> tuple[VisibilityTable, SurfaceSamples]:
    """Return the table with directions that only dense points need, and the points (k) it shows.

    Parameters
    ----------
    dense : of `dense_points`
    table : table of `look_out` for the samples; its first directions are those of `dense`
    solid : the part
    samples : n, that views are chosen by
    caster : rays against its mesh
    rules : camera distance, and the limits on a surface's incidence
    options : what is worth a view
    """
    points, shown = dense.samples, dense.shown_count > 0

    def look(vectors: FloatArray) -> None:
        (left,) = np.nonzero(~shown)
        shown[left] = visible_from(solid, points.rows(left), caster, vectors, rules).any(axis=0)

    look(table.directions.vectors[len(dense.directions) :])
    (left,) = np.nonzero(~shown)
    worth = worth_of(points, options)[left]
    vectors = directions_into_wedges(solid, points.rows(left), caster, rules, worth)
    look(vectors)
    more = with_directions(table, vectors, solid, samples, caster, rules)
    return more, points.rows(np.flatnonzero(shown))


def worth_of(points: SurfaceSamples, options: PlanOptions) -> FloatArray:
    """Return the worth of showing each point (n,), in views of usual length.

    A view is worth taking for `PlanOptions.least_gain` of the surface, and for a `PORTION` of the
    share of a face without which the part does not pass, however small the face.

    Parameters
    ----------
    points : n, of all of the surface
    options : with both shares
    """
    face_mm2 = np.bincount(points.face_ids, points.areas_mm2)
    enough_mm2 = max(options.least_gain * float(points.areas_mm2.sum()), SPOT_MM2)
    return np.asarray(
        points.areas_mm2
        / np.minimum(enough_mm2, PORTION * options.face_share * face_mm2)[points.face_ids]
    )


def make_counted(
    solid: Solid,
    chosen_by: SurfaceSamples,
    counted: SurfaceSamples,
    probes: SurfaceSamples,
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
    probes : points for finding blind spots
    caster : rays against its mesh
    rules : camera distance, and the limits on a surface's incidence
    visibility_table : visibility table of the n samples
    """
    # what shows most first: after a few directions little is left to be looked for
    order = np.argsort(-(visibility_table.visible @ chosen_by.areas_mm2), kind="stable")
    vectors = visibility_table.directions.vectors[order]
    return Counted(
        samples=counted,
        probes=probes,
        nearest=nearest_on_face(chosen_by, counted),
        of_chosen=nearest_on_face(counted, chosen_by),
        evidence=hidden_ones(solid, counted, caster, rules, vectors),
    )


def _scattered(count: int) -> IntArray:
    """Return the numbers below a count, those that follow each other far apart."""
    return np.argsort((np.arange(count) * 0.6180339887498949) % 1.0, kind="stable")
