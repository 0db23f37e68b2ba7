"""Stable poses: probabilities, heights and tip energies against geometry done on paper."""

from __future__ import annotations

from typing import Any

import manifold3d
import numpy as np
import pytest
import trimesh
from cad_solids import Body, box, mesh_of, prism, rod, solid_of
from data_files import listed_parts, part_file

from controller.cad import (
    Solid,
    StablePose,
    find_resting,
    load_solid,
    make_solid,
    stable_poses,
)

G = 9.81


def solid_angle_share(a: float, b: float, d: float) -> float:
    """Share of the full sphere that a rectangle a x b takes, seen from d above its middle."""
    p, q = a / 2, b / 2
    return 4 * float(np.arctan2(p * q, d * np.sqrt(p * p + q * q + d * d))) / (4 * np.pi)


def lift_mm(height: float, to_edge: float) -> float:
    return float(np.hypot(height, to_edge) - height)


def down(pose: StablePose) -> np.ndarray:
    """The direction in the CAD frame that points to the table."""
    return -pose.R[2]


def assert_sound(poses: tuple[StablePose, ...]) -> None:
    assert [p.index for p in poses] == list(range(len(poses)))
    odds = [p.probability for p in poses]
    assert odds == sorted(odds, reverse=True)
    for pose in poses:
        np.testing.assert_allclose(pose.R @ pose.R.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(pose.R) == pytest.approx(1.0)


def test_a_box_lies_on_each_of_six_faces_with_its_solid_angle_as_odds() -> None:
    size = np.array([40.0, 30.0, 20.0])
    poses = stable_poses(solid_of(box(*size)))
    assert_sound(poses)
    assert len(poses) == 6
    assert sum(p.probability for p in poses) == pytest.approx(1.0, abs=1e-6)
    for pose in poses:
        axis = int(np.argmax(np.abs(down(pose))))
        a, b = np.delete(size, axis)
        assert abs(down(pose)[axis]) == pytest.approx(1.0)
        assert pose.com_height_mm == pytest.approx(size[axis] / 2, abs=1e-6)
        assert pose.probability == pytest.approx(solid_angle_share(a, b, size[axis] / 2), abs=1e-6)
        expected = G * lift_mm(size[axis] / 2, min(a, b) / 2)
        assert pose.tip_energy_mj_per_kg == pytest.approx(expected, rel=1e-3)
        assert not pose.rolling


def test_a_tetrahedron_lies_on_any_side_alike() -> None:
    poses = stable_poses(solid_of(Body.tetrahedron().scale((10, 10, 10))))
    assert_sound(poses)
    assert [p.probability for p in poses] == pytest.approx([0.25] * 4, abs=1e-6)
    # corners at (+-10, +-10, +-10): edge a = 20 sqrt 2, in-radius a / sqrt 24, a side's a / sqrt 12
    edge = 20 * np.sqrt(2)
    height, to_edge = edge / np.sqrt(24), edge / np.sqrt(12)
    for pose in poses:
        assert pose.com_height_mm == pytest.approx(height, rel=1e-6)
        assert pose.tip_energy_mj_per_kg == pytest.approx(G * lift_mm(height, to_edge), rel=1e-3)


def test_a_side_the_centre_of_mass_does_not_stand_over_is_no_way_to_lie() -> None:
    # triangle (0,0) (10,0) (60,20): its centroid x = 23.3 stands beside the 10 mm side
    solid = solid_of(prism([(0, 0), (10, 0), (60, 20)], 30))
    poses = stable_poses(solid)
    assert_sound(poses)
    assert sum(p.probability for p in poses) == pytest.approx(1.0, abs=1e-6)
    assert all(down(pose) @ np.array([0.0, -1.0, 0.0]) < 0.99 for pose in poses)
    for pose in poses:
        upright = (solid.mesh.vertices - solid.centroid_mm) @ pose.R.T
        feet = upright[upright[:, 2] < upright[:, 2].min() + 1e-6]
        assert (feet[:, :2].min(axis=0) <= 1e-6).all()
        assert (feet[:, :2].max(axis=0) >= -1e-6).all()


def test_a_rod_stands_on_its_ends_and_rolls_on_its_wall() -> None:
    radius, length, segments = 10.0, 30.0, 64
    poses = stable_poses(solid_of(rod(radius, length, segments)))
    assert_sound(poses)
    standing = [p for p in poses if abs(down(p)[2]) > 0.99]
    assert len(standing) == 2
    # solid angle of a disc: 2 pi (1 - cos alpha)
    share = 0.5 * (1 - (length / 2) / np.hypot(length / 2, radius))
    assert [p.probability for p in standing] == pytest.approx([share] * 2, abs=1e-3)
    assert not any(p.rolling for p in standing)
    (lying,) = (p for p in poses if abs(down(p)[2]) < 0.01)
    assert lying.rolling
    assert lying.probability == pytest.approx(1 - 2 * share, abs=1e-3)
    assert lying.com_height_mm == pytest.approx(radius * np.cos(np.pi / segments), abs=1e-4)
    # to leave the wall it must stand on its rim's end
    assert lying.tip_energy_mj_per_kg == pytest.approx(
        G * (np.hypot(radius * np.cos(np.pi / segments), length / 2) - lying.com_height_mm),
        rel=1e-6,
    )


def test_ways_to_lie_rarer_than_asked_are_left_out() -> None:
    solid = solid_of(box(40, 30, 2))
    edgeways = solid_angle_share(30, 2, 20)
    assert edgeways < 0.02
    assert len(stable_poses(solid)) == 6
    assert len(stable_poses(solid, min_probability=0.02)) == 2


def test_a_hollow_does_not_let_a_part_lie_deeper() -> None:
    # a cup: the table carries it on the rim's hull, not on the bottom of the hollow
    solid = solid_of(box(40, 40, 30) - box(30, 30, 30).translate((0, 0, 10)))
    poses = stable_poses(solid)
    rim_down = next(p for p in poses if down(p)[2] > 0.99)
    assert rim_down.com_height_mm == pytest.approx(15 - solid.centroid_mm[2], abs=1e-4)
    bottom_down = next(p for p in poses if down(p)[2] < -0.99)
    # centre of mass on paper: 48000 mm3 at z = 0 less 18000 mm3 (z -5 to 15) at z = 5
    z = -18000 * 5 / (48000 - 18000)
    assert bottom_down.com_height_mm == pytest.approx(15 + z, abs=1e-4)


def test_the_odds_do_not_depend_on_where_the_cad_frame_stands() -> None:
    mesh = mesh_of(box(40, 30, 20))
    mesh.apply_translation((500, -300, 70))
    moved = stable_poses(make_solid(mesh, "moved", "0" * 64, "moved"))
    here = stable_poses(solid_of(box(40, 30, 20)))
    assert [p.probability for p in moved] == pytest.approx([p.probability for p in here], abs=1e-6)


def test_the_same_file_gives_the_same_poses() -> None:
    solid = solid_of(box(40, 30, 20) - rod(5, 40, 32))
    for a, b in zip(stable_poses(solid), stable_poses(solid), strict=True):
        assert np.array_equal(a.R, b.R)
        assert a.probability == b.probability


@pytest.mark.parametrize("entry", listed_parts(), ids=lambda e: str(e["name"]))
def test_parts_of_others_lie_as_their_manifest_says(entry: dict[str, Any]) -> None:
    poses = stable_poses(load_solid(part_file(entry["stl"])))
    assert_sound(poses)
    # a gear's tooth rests on a run of slivers: the manifest names the likeliest of them, and the
    # tooth itself rocks to where its centre is lowest
    gear = entry["name"].startswith("cycloidal")
    for expected in entry["stable_poses"]:
        toward = -np.array(expected["R"])[2]
        within_deg = 1.5 if gear else 0.2
        same = [p for p in poses if down(p) @ toward > np.cos(np.radians(within_deg))]
        alone = sum(p.probability for p in same)
        # the manifest pools what cannot be told apart: both sides of a disc, every tooth of a gear
        height = same[0].com_height_mm
        pooled = sum(p.probability for p in poses if abs(p.com_height_mm - height) < 0.05)
        assert min(abs(o - expected["probability"]) for o in (alone, pooled)) < 0.003
        assert height == pytest.approx(expected["centroid_height_mm"], abs=0.05 if gear else 0.001)


def trimesh_facets(solid: Any, above: float) -> list[tuple[np.ndarray, float]]:
    transforms, odds = trimesh.poses.compute_stable_poses(
        solid.mesh, center_mass=solid.centroid_mm, n_samples=1
    )
    return [(-T[2, :3], float(p)) for T, p in zip(transforms, odds, strict=True) if p > above]


def random_body(seed: int) -> Body:
    """A lump of blocks, rods and balls, some added and some taken away."""
    rng = np.random.default_rng(seed)
    body = box(*rng.uniform(20, 50, 3))
    for _ in range(4):
        piece = [
            box(*rng.uniform(8, 30, 3)),
            rod(rng.uniform(3, 12), rng.uniform(10, 60), 40),
            Body.sphere(rng.uniform(6, 14), 32),
        ][rng.integers(3)]
        turn = rng.uniform(-180, 180, 3)
        piece = piece.rotate([float(a) for a in turn]).translate(
            [float(x) for x in rng.uniform(-12, 12, 3)]
        )
        body = body + piece if rng.random() < 0.6 else body - piece
    return max(body.decompose(), key=lambda part: part.volume())


@pytest.mark.parametrize("seed", range(12))
def test_the_facets_that_hold_a_part_are_trimeshs_own(seed: int) -> None:
    solid = bare(mesh_of(random_body(seed)))
    resting = find_resting(solid)
    theirs = trimesh_facets(solid, 0.005)
    for toward, odds in theirs:
        same = resting.facet_downs @ toward > np.cos(np.radians(0.1))
        assert resting.facet_probabilities[same].sum() == pytest.approx(odds, abs=2e-4)
    assert (resting.facet_probabilities > 0.0052).sum() <= len(theirs)
    assert resting.facet_probabilities.sum() == pytest.approx(1.0)


def bare(mesh: trimesh.Trimesh) -> Solid:
    """Wrap a mesh known to be sound, so that only resting takes time."""
    triangles = np.zeros(len(mesh.faces), dtype=np.int32)
    centre = np.asarray(mesh.center_mass)
    return Solid("bare", mesh, "0" * 64, float(mesh.volume), centre, (), triangles)


def moved(body: Body, matrix: np.ndarray) -> Solid:
    mesh = mesh_of(body)
    mesh.apply_transform(np.block([[matrix, np.zeros((3, 1))], [np.zeros((1, 3)), 1.0]]))
    return bare(mesh)


@pytest.mark.parametrize("seed", range(10))
def test_turning_or_mirroring_a_part_does_the_same_to_its_poses(seed: int) -> None:
    body = random_body(seed)
    here = find_resting(bare(mesh_of(body)), min_probability=0.005).poses
    turn = trimesh.transformations.random_rotation_matrix(
        np.random.default_rng(seed).uniform(size=3)
    )[:3, :3]
    for matrix in (turn, np.diag([1.0, 1.0, -1.0])):
        there = find_resting(moved(body, matrix), min_probability=0.004).poses
        for pose in here:
            twin = max(there, key=lambda p: float(down(p) @ matrix @ down(pose)))
            if not pose.rolling:  # any of its strips may stand for a family
                assert down(twin) @ matrix @ down(pose) > np.cos(np.radians(0.1))
            assert twin.rolling == pose.rolling
            assert twin.probability == pytest.approx(pose.probability, abs=1e-3)
            assert twin.com_height_mm == pytest.approx(pose.com_height_mm, abs=1e-3)
            energy = pytest.approx(pose.tip_energy_mj_per_kg, abs=0.02)
            assert twin.tip_energy_mj_per_kg == energy


@pytest.mark.parametrize("seed", range(4))
def test_a_larger_part_of_the_same_shape_has_the_same_odds(seed: int) -> None:
    body = random_body(seed)
    here = find_resting(bare(mesh_of(body)))
    there = find_resting(moved(body, 2.5 * np.eye(3)))
    np.testing.assert_allclose(there.facet_probabilities, here.facet_probabilities, atol=1e-6)


def test_a_rod_is_one_family_about_its_axis() -> None:
    solid = solid_of(rod(10.0, 30.0, 64).rotate([30.0, 40.0, 0.0]).translate([5.0, -7.0, 2.0]))
    (family,) = find_resting(solid).families
    axis = solid.mesh.principal_inertia_vectors
    moments = solid.mesh.principal_inertia_components
    lone = int(np.argmax(np.abs(moments - np.median(moments))))
    assert family.kind == "cylinder"
    assert abs(family.axis @ axis[lone]) == pytest.approx(1.0, abs=1e-6)
    off = family.centre_mm - solid.centroid_mm
    assert np.linalg.norm(off - (off @ family.axis) * family.axis) < 1e-3
    assert family.radius_mm == pytest.approx([10.0, 10.0], abs=1e-3)
    assert family.arc_rad == pytest.approx(2 * np.pi)
    assert len(family.probabilities) == 64
    assert family.probabilities.sum() == pytest.approx(family.probability, abs=1e-9)


@pytest.mark.parametrize("scale", [1.0, 25.4, 1000.0])
def test_a_wheel_rolls_whatever_its_size(scale: float) -> None:
    poses = stable_poses(solid_of(rod(38.0, 12.7, 54).scale((scale, scale, scale))))
    assert [p.rolling for p in poses] == [False, False, True]


def test_a_cone_rolls_in_a_circle_and_stands_on_its_end() -> None:
    bottom, top, length = 20.0, 5.0, 40.0
    resting = find_resting(solid_of(Body.cylinder(length, bottom, top, 96)))
    (family,) = resting.families
    assert family.kind == "cone"
    assert abs(family.axis[2]) == pytest.approx(1.0, abs=1e-6)
    # the wall leans inwards by atan(15 / 40), so down leaves the level plane by as much
    lean = np.arctan2(bottom - top, length)
    assert abs(family.downs[:, 2]) == pytest.approx(np.full(96, np.sin(lean)), abs=2e-3)
    assert sum(p.rolling for p in resting.poses) == 1


def test_a_ball_is_one_way_to_lie() -> None:
    resting = find_resting(solid_of(Body.sphere(20, 48)))
    (pose,) = resting.poses
    (family,) = resting.families
    assert pose.rolling
    assert not pose.marginal
    assert family.kind == "ball"
    assert family.centre_mm == pytest.approx([0, 0, 0], abs=1e-2)


@pytest.mark.parametrize("phase_deg", [0.0, 2.0, 2.8125])
def test_a_rod_with_a_flat_rocks_to_where_its_centre_is_lowest(phase_deg: float) -> None:
    # whatever way the 64 corners lie: opposite to the flat
    body = rod(10, 40, 64).rotate([0.0, 0.0, phase_deg]) - box(30, 10, 50).translate((0, 10, 0))
    poses = stable_poses(solid_of(body))
    (round_side,) = (p for p in poses if p.rocking)
    assert not any(p.rolling for p in poses)
    assert down(round_side) @ np.array([0.0, -1.0, 0.0]) > np.cos(np.radians(0.15))
    flat = next(p for p in poses if down(p)[1] > 0.999)
    assert not flat.rocking


def test_a_half_ball_rocks_upright() -> None:
    poses = stable_poses(solid_of(Body.sphere(20, 64) - box(50, 50, 50).translate((0, 0, 25))))
    assert len(poses) == 2
    (dome,) = (p for p in poses if p.rocking)
    assert down(dome)[2] < -np.cos(np.radians(0.2))
    # the centre of a half ball is 3/8 R from its flat
    assert dome.com_height_mm == pytest.approx(20 - 3 / 8 * 20, abs=0.05)


@pytest.mark.parametrize("segments", [48, 60, 64])
def test_a_rounded_corner_holds_no_part_in_balance(segments: int) -> None:
    # with 60 segments a strip lies at 45 degrees, straight under the centre of a square bar
    corner = manifold3d.JoinType.Round
    outline = manifold3d.CrossSection.square((40, 40), True).offset(-6, manifold3d.JoinType.Miter)
    bar = outline.offset(6, corner, circular_segments=segments).extrude(60)
    poses = stable_poses(solid_of(bar))
    assert len(poses) == 6
    assert all(np.abs(down(p)).max() == pytest.approx(1.0, abs=1e-6) for p in poses)
    lying = [p.probability for p in poses if abs(down(p)[2]) < 0.1]
    assert lying == pytest.approx([np.mean(lying)] * 4, abs=1e-6)


def test_a_pose_that_a_breath_tips_is_marked() -> None:
    # a block on its 2 mm side: sqrt(20^2 + 1^2) - 20 = 0.025 mm
    poses = stable_poses(solid_of(box(40, 30, 2)))
    for pose in poses:
        assert pose.marginal == (abs(down(pose)[2]) < 0.5)


def test_the_ranks_follow_the_energy_to_tip() -> None:
    poses = stable_poses(solid_of(random_body(3)))
    by_rank = sorted(poses, key=lambda p: p.stability_rank)
    energies = [p.tip_energy_mj_per_kg for p in by_rank]
    assert energies == sorted(energies, reverse=True)
    assert by_rank[0].stability_rank == 1


def test_a_block_tips_most_easily_over_its_long_side() -> None:
    for pose in stable_poses(solid_of(box(40, 30, 20))):
        level = np.delete(np.arange(3), int(np.argmax(np.abs(down(pose)))))
        shorter = level[np.argmin(np.array([40, 30, 20])[level])]
        assert abs(pose.topple_direction[shorter]) == pytest.approx(1.0)


def test_the_odds_of_a_drop_are_solid_angle_times_tip_energy() -> None:
    poses = stable_poses(solid_of(box(40, 30, 20)))
    weight = np.array([p.probability * p.tip_energy_mj_per_kg for p in poses])
    assert [p.drop_probability for p in poses] == pytest.approx(weight / weight.sum(), abs=1e-9)


def test_a_heavy_end_brings_the_centre_given() -> None:
    solid = solid_of(box(40, 30, 20))
    poses = stable_poses(solid, centre_of_mass_mm=np.array([18.0, 0.0, 0.0]))
    on_end = next(p for p in poses if down(p)[0] > 0.99)
    assert on_end.com_height_mm == pytest.approx(2.0)
    assert on_end.tip_energy_mj_per_kg == pytest.approx(G * lift_mm(2.0, 10.0), rel=1e-6)


def test_a_centre_on_the_hull_is_answered_and_one_outside_refused() -> None:
    solid = solid_of(box(40, 30, 20))
    poses = stable_poses(solid, centre_of_mass_mm=np.array([0.0, 0.0, -10.0]))
    assert poses[0].com_height_mm == pytest.approx(0.0, abs=1e-9)
    assert down(poses[0])[2] == pytest.approx(-1.0)
    assert poses[0].probability > 0.5  # half the sphere, and what topples off the sides
    for corner in ([20.0, 15.0, 10.0], [20.0, 15.0, 0.0]):
        assert sum(
            p.probability for p in stable_poses(solid, centre_of_mass_mm=np.array(corner))
        ) == pytest.approx(1.0, abs=0.01)
    with pytest.raises(ValueError, match=r"2 mm outside"):
        stable_poses(solid, centre_of_mass_mm=np.array([0.0, 0.0, -12.0]))


def test_single_precision_noise_makes_no_new_poses() -> None:
    body = box(40, 30, 20) - rod(6, 50, 64)
    turn = trimesh.transformations.random_rotation_matrix(np.array([0.3, 0.6, 0.1]))
    mesh = mesh_of(body).subdivide().subdivide()
    mesh.apply_transform(turn)
    mesh.vertices = np.asarray(mesh.vertices, dtype=np.float32).astype(float)
    poses = stable_poses(make_solid(mesh, "noisy", "0" * 64, "noisy"))
    clean = stable_poses(solid_of(body))
    assert [p.probability for p in poses] == pytest.approx([p.probability for p in clean], abs=1e-4)
