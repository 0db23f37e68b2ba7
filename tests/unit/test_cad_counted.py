"""Points that coverage is counted by: how near, whose area, and what share of it they find."""

from __future__ import annotations

from functools import reduce
from operator import sub

import numpy as np
import pytest
import trimesh
from cad_solids import box, rod, solid_of
from scipy.spatial import cKDTree

from controller.cad import (
    Solid,
    SurfaceSamples,
    count_caution,
    counted_defect_mm,
    counted_samples,
    face_shares,
    sample_surface,
    share_of,
    uncertainty_of,
)

SPACING_MM = 1.0


@pytest.fixture(scope="module")
def drilled() -> Solid:
    return solid_of(
        box(40, 30, 8)
        - rod(2.75, 20, 48).translate((10, 5, 0))
        - rod(0.6, 20, 24).translate((-10, 0, 0))
    )


@pytest.fixture(scope="module")
def samples(drilled: Solid) -> SurfaceSamples:
    return counted_samples(drilled, SPACING_MM)


def farthest_mm(solid: Solid, samples: SurfaceSamples, face: int) -> float:
    """Return how far random points of a face are from its nearest sample, at most."""
    (rows,) = np.nonzero(solid.face_of_triangle == face)
    piece = solid.mesh.submesh([rows], append=True, repair=False)
    points, _ = trimesh.sample.sample_surface(piece, 1500, seed=3)
    mine = samples.points_mm[samples.face_ids == face]
    return float(cKDTree(mine).query(points)[0].max())


def test_no_spot_of_a_face_is_farther_from_a_sample_than_the_spacing(
    drilled: Solid, samples: SurfaceSamples
) -> None:
    for face in drilled.faces:
        assert farthest_mm(drilled, samples, face.id) <= SPACING_MM


def test_round_a_bore_no_arc_of_more_than_a_24th_is_without_a_sample(
    drilled: Solid, samples: SurfaceSamples
) -> None:
    for radius, centre in ((2.75, (10, 5)), (0.6, (-10, 0))):
        (face,) = (f for f in drilled.faces if abs(f.radius_mm - radius) < 0.05)
        at = samples.points_mm[samples.face_ids == face.id][:, :2] - centre
        turns = np.sort(np.arctan2(at[:, 1], at[:, 0]))
        gaps = np.diff(np.concatenate([turns, [turns[0] + 2 * np.pi]]))
        assert gaps.max() <= 2 * np.pi / 24


def test_the_areas_are_those_of_the_faces_and_samples_are_none_of_those_chosen_by(
    drilled: Solid, samples: SurfaceSamples
) -> None:
    per_face = np.bincount(samples.face_ids, weights=samples.areas_mm2)
    assert per_face == pytest.approx([face.area_mm2 for face in drilled.faces], rel=1e-6)
    others = {tuple(p) for p in sample_surface(drilled).points_mm.tolist()}
    assert not others & {tuple(p) for p in samples.points_mm.tolist()}
    again = counted_samples(drilled, SPACING_MM)
    assert np.array_equal(again.points_mm, samples.points_mm)


def test_a_narrow_strip_along_an_edge_is_counted_as_wide_as_it_is() -> None:
    solid = solid_of(box(40, 2, 20))
    samples = counted_samples(solid, SPACING_MM)
    (face,) = (f for f in solid.faces if f.normal[2] > 0.99)  # 40 x 2
    mine = samples.rows(np.flatnonzero(samples.face_ids == face.id))
    for width in (0.1, 0.2, 0.5):
        found = share_of(mine, mine.points_mm[:, 1] > 1.0 - width)
        assert found == pytest.approx(width / 2.0, abs=0.01)


def test_a_share_is_known_to_its_uncertainty_nineteen_times_in_twenty(
    drilled: Solid, samples: SurfaceSamples
) -> None:
    (top,) = (f for f in drilled.faces if f.normal[2] > 0.99)
    holes = np.pi * (2.75**2 + 0.6**2)
    rng = np.random.default_rng(5)
    right = []
    # discs of the face that keep clear of its border and its bores
    for _ in range(40):
        centre = np.array([-2.0, 0.0]) + rng.uniform(-1, 1, 2)
        radius = rng.uniform(1.0, 6.0)
        chosen = np.linalg.norm(samples.points_mm[:, :2] - centre, axis=1) < radius
        chosen &= samples.face_ids == top.id
        shares, uncertain = face_shares(samples, chosen, len(drilled.faces))
        true = np.pi * radius**2 / (40 * 30 - holes)
        right.append(abs(shares[top.id] - true) <= uncertain[top.id])
        assert uncertain[top.id] < 0.03
    assert np.mean(right) >= 0.95


def test_the_whole_is_certain_but_for_spots_too_small_to_hold_a_sample(
    samples: SurfaceSamples,
) -> None:
    every = np.ones(len(samples.points_mm), dtype=bool)
    assert share_of(samples, every) == pytest.approx(1.0)
    largest = samples.areas_mm2.max() / samples.areas_mm2.sum()
    assert 0.0 < uncertainty_of(samples, every) <= 3.0 * largest
    half = samples.points_mm[:, 0] > 0.0
    assert uncertainty_of(samples, half) > uncertainty_of(samples, every)


@pytest.fixture(scope="module")
def piped() -> Solid:
    """A block with twelve bores of 2 mm along all of its 300 mm."""
    pipe = rod(1.0, 400, 24).rotate((0, 90, 0))
    return solid_of(
        reduce(sub, (pipe.translate((0, 8 * k - 44, 0)) for k in range(12)), box(300, 100, 10))
    )


@pytest.mark.parametrize("room", [60_000, 15_000])
def test_a_part_that_needs_too_many_points_has_as_many_as_there_is_room_for_and_says_what_is_lost(
    piped: Solid, room: int
) -> None:
    samples = counted_samples(piped, 2.0, most=room)
    assert 0.8 * room < len(samples.points_mm) < 1.2 * room
    assert samples.areas_mm2.sum() == pytest.approx(piped.mesh.area)
    assert samples.reach_mm is not None
    bore = next(face.id for face in piped.faces if face.radius_mm > 0.0)
    for face in (bore, int(np.argmax([face.area_mm2 for face in piped.faces]))):
        assert farthest_mm(piped, samples, face) <= samples.reach_mm
    if room == 60_000:  # bores are counted less finely, and nothing of a defect's size is lost
        assert samples.reach_mm == 2.0
        assert not count_caution(samples, 6.0)
    else:
        counted_mm = counted_defect_mm(samples, 6.0)
        assert counted_mm == pytest.approx(3 * samples.reach_mm)
        assert counted_mm > 6.0
        assert f"a spot of {counted_mm:.2g} mm" in count_caution(samples, 6.0)
        assert not count_caution(samples, 2 * counted_mm)


def test_the_uncertainty_of_a_share_grows_with_the_distance_of_the_points(
    piped: Solid,
) -> None:
    def of_half(room: int) -> float:
        samples = counted_samples(piped, 2.0, most=room)
        return uncertainty_of(samples, samples.points_mm[:, 1] + samples.points_mm[:, 0] / 9 > 0)

    assert of_half(5_000) > 2 * of_half(60_000)
