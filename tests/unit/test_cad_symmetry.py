"""Symmetries of parts, the poses they make the same, and poses that look the same from above."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import trimesh
from cad_solids import Body, box, mesh_of, prism, rod, solid_of
from data_files import part_file

from controller.cad import (
    Solid,
    find_resting,
    load_solid,
    look_alikes,
    name_duplicates,
    part_symmetries,
    stable_poses,
)


def turned(body: Body) -> Solid:
    """A body somewhere in space, so that no axis is a coordinate axis."""
    return solid_of(body.rotate([20.0, 33.0, 51.0]).translate([7.0, -3.0, 11.0]))


def marked(body: Body, x: float, y: float, z: float) -> Body:
    return body - box(3, 4, 5).translate((x, y, z))


# orders of the groups of proper turns, from any book on point groups
@pytest.mark.parametrize(
    ("make", "order"),
    [
        (lambda: box(40, 30, 20), 4),
        (lambda: box(40, 40, 20), 8),
        (lambda: box(30, 30, 30), 24),
        (lambda: rod(12, 40, 6), 12),
        (lambda: Body.tetrahedron().scale((12, 12, 12)), 12),
        (lambda: prism([(0, 0), (30, 0), (10, 20)], 12), 1),
        (lambda: prism([(0, 0), (30, 0), (15, 20)], 12), 2),
        (lambda: prism([(0, 0), (40, 0), (30, 15), (-10, 15)], 12), 2),
        (lambda: box(40, 30, 20) - rod(3, 50, 48), 4),
        (lambda: rod(30, 10, 96) - rod(3, 40, 32).translate((20, 0, 0)), 2),
        (
            lambda: (
                rod(30, 10, 96)
                - rod(3, 40, 32).translate((20, 0, 0))
                - rod(3, 40, 32).translate((-10, 17.3205, 0))
                - rod(3, 40, 32).translate((-10, -17.3205, 0))
            ),
            6,
        ),
    ],
)
def test_the_turns_that_keep_a_part_form_the_group_of_its_shape(
    make: Callable[[], Body], order: int
) -> None:
    symmetry = part_symmetries(turned(make()))
    assert len(symmetry.rotations) == order
    assert symmetry.axis is None
    assert not symmetry.is_ball
    assert symmetry.rotations[0] == pytest.approx(np.eye(3))
    for R in symmetry.rotations:
        assert np.linalg.det(R) == pytest.approx(1.0)
        products = symmetry.rotations @ R
        gaps = np.linalg.norm(products[:, None] - symmetry.rotations[None], axis=(2, 3))
        assert gaps.min(axis=1).max() < 0.03  # with two turns their product


def test_a_rod_is_of_revolution_and_may_be_turned_over() -> None:
    symmetry = part_symmetries(turned(rod(10, 30, 64)))
    assert symmetry.axis is not None
    assert len(symmetry.rotations) == 2
    assert symmetry.mirror is not None


def test_a_cone_is_of_revolution_and_may_not_be_turned_over() -> None:
    symmetry = part_symmetries(turned(Body.cylinder(40, 20, 5, 96)))
    assert symmetry.axis is not None
    assert len(symmetry.rotations) == 1


def test_a_ball_may_be_turned_any_way() -> None:
    assert part_symmetries(solid_of(Body.sphere(20, 64))).is_ball


def test_a_small_notch_breaks_the_symmetry() -> None:
    assert len(part_symmetries(turned(marked(box(40, 40, 20), 20, 20, 10))).rotations) == 1
    rod_with_one = part_symmetries(turned(marked(rod(10, 30, 64), 10, 0, 0)))
    assert rod_with_one.axis is None
    assert len(rod_with_one.rotations) == 2  # half a turn about the line through the notch


def test_a_part_of_two_densities_keeps_only_what_keeps_its_centre() -> None:
    solid = solid_of(box(40, 30, 20))
    heavy_end = part_symmetries(solid, centre_of_mass_mm=np.array([5.0, 0.0, 0.0]))
    assert len(heavy_end.rotations) == 2  # half turns about x alone


@pytest.mark.parametrize(
    ("make", "is_chiral"),
    [
        (lambda: box(40, 30, 20), False),
        (lambda: Body.tetrahedron().scale((12, 12, 12)), False),
        (lambda: prism([(0, 0), (30, 0), (10, 20)], 12), False),
        (lambda: prism([(0, 0), (40, 0), (30, 15), (-10, 15)], 12), False),
        # one notch half-way along an edge leaves a mirror plane, one more across it leaves none
        (lambda: marked(box(40, 30, 20), 20, 0, 10), False),
        (lambda: marked(marked(box(40, 30, 20), 20, 0, 10), 0, 15, 10), True),
    ],
)
def test_a_part_is_chiral_if_no_mirror_gives_it_back(
    make: Callable[[], Body], *, is_chiral: bool
) -> None:
    symmetry = part_symmetries(turned(make()))
    assert (symmetry.mirror is None) is is_chiral
    if symmetry.mirror is not None:
        assert np.linalg.det(symmetry.mirror) == pytest.approx(-1.0)


@pytest.mark.parametrize("size", [(40, 30, 20), (40, 40, 20), (30, 30, 30)])
def test_poses_a_turn_relates_are_named_as_the_first_of_them(size: tuple[int, int, int]) -> None:
    solid = turned(box(*size))
    poses = name_duplicates(stable_poses(solid), part_symmetries(solid))
    firsts = {p.same_as for p in poses}
    assert len(firsts) == len(set(size))  # one way to lie per length that stands up
    for pose in poses:
        assert poses[pose.same_as].com_height_mm == pytest.approx(pose.com_height_mm, abs=1e-6)
        assert pose.same_as <= pose.index


@pytest.mark.slow
def test_a_turn_of_the_frame_changes_no_symmetry() -> None:
    body = rod(12, 40, 6)
    turn = trimesh.transformations.random_rotation_matrix(np.array([0.2, 0.7, 0.4]))
    mesh = mesh_of(body)
    mesh.apply_transform(turn)
    here = part_symmetries(solid_of(body)).rotations
    solid = Solid("t", mesh, "", 1.0, np.asarray(mesh.center_mass), (), np.zeros(0, np.int32))
    there = part_symmetries(solid).rotations
    R = turn[:3, :3]
    for kept in here:
        gaps = np.linalg.norm(there - R @ kept @ R.T, axis=(1, 2))
        assert gaps.min() < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "order", "is_chiral"),
    [
        ("featuretype", 1, True),
        ("angle_block", 1, False),
        ("disc_cam_a", 2, False),
        ("cycloidal_gear", 6, True),
        ("cycloidal_gear_mirror", 6, True),
    ],
)
def test_parts_of_others_have_the_symmetry_they_are_drawn_with(
    name: str, order: int, *, is_chiral: bool
) -> None:
    symmetry = part_symmetries(load_solid(part_file(f"{name}.stl")))
    assert len(symmetry.rotations) == order
    assert (symmetry.mirror is None) is is_chiral


def pairs(solid: Solid) -> dict[tuple[int, int], str]:
    poses = stable_poses(solid)
    return {(a.pose, a.other): a.evidence for a in look_alikes(solid, poses)}


# three bores about an axis, one on it; the latter d off it, a third of a turn moves it d * sqrt 3
@pytest.mark.parametrize(("off_mm", "order"), [(0.06, 6), (0.3, 2)])
def test_a_bore_a_little_off_the_axis_leaves_the_turns_about_it(off_mm: float, order: int) -> None:
    body = rod(30, 10, 96) - rod(4, 40, 64).translate((off_mm, 0, 0))
    for turn in (0, 120, 240):
        body -= rod(3, 40, 32).translate((20, 0, 0)).rotate((0, 0, turn))
    assert len(part_symmetries(turned(body)).rotations) == order


@pytest.mark.slow
def test_a_gear_lies_alike_on_its_teeth_from_triangles_and_from_step() -> None:
    pytest.importorskip("OCP")
    told = []
    for ending in ("stl", "step"):
        solid = load_solid(part_file(f"cycloidal_gear.{ending}"))
        poses = name_duplicates(stable_poses(solid), part_symmetries(solid))
        assert sorted(pose.same_as for pose in poses) == [0] * 6 + [6] * 2  # teeth, then ends
        told.append(sorted(poses, key=lambda pose: tuple(np.round(pose.R[2], 1) + 0.0)))
    for a, b in zip(*told, strict=True):
        assert a.R[2] @ b.R[2] > np.cos(np.radians(2.0))
        assert a.probability == pytest.approx(b.probability, rel=0.01)
        assert a.com_height_mm == pytest.approx(b.com_height_mm, abs=0.02)
        assert a.rocking == b.rocking


def test_a_block_looks_the_same_upside_down() -> None:
    assert pairs(solid_of(box(40, 30, 20))) == {(0, 1): "edges", (2, 3): "edges", (4, 5): "edges"}


def test_a_blind_hole_is_seen_from_one_side_only() -> None:
    solid = solid_of(box(40, 30, 20) - rod(3, 10, 48).translate((0, 0, 10)))
    poses = stable_poses(solid)
    flat = {p.index for p in poses if abs(p.R[2, 2]) > 0.9}
    found = {(a.pose, a.other): a.evidence for a in look_alikes(solid, poses)}
    assert found[tuple(sorted(flat))] == "outline"  # type: ignore[index]  # of two


def test_a_plate_whose_outline_has_a_hand_does_not_look_the_same_upside_down() -> None:
    # a scalene triangle: its mirror image is no turn of it
    solid = solid_of(prism([(0, 0), (40, 0), (12, 25)], 6))
    flat = {p.index for p in stable_poses(solid) if abs(p.R[2, 2]) > 0.9}
    assert tuple(sorted(flat)) not in pairs(solid)


def test_the_turn_told_carries_one_view_to_the_other() -> None:
    solid = solid_of(prism([(0, 0), (40, 0), (20, 25)], 6))  # isosceles: a mirror is a turn
    poses = stable_poses(solid)
    (alike,) = (
        a
        for a in look_alikes(solid, poses)
        if all(abs(poses[i].R[2, 2]) > 0.9 for i in (a.pose, a.other))
    )
    views = []
    for i in (alike.pose, alike.other):
        flat = ((solid.mesh.vertices - solid.centroid_mm) @ poses[i].R.T)[:, :2]
        views.append(flat)
    c, s = np.cos(alike.turn_rad), np.sin(alike.turn_rad)
    moved = views[0] @ np.array([[c, -s], [s, c]]).T
    far = np.linalg.norm(moved[:, None] - views[1][None], axis=2).min(axis=1)
    assert far.max() < 0.02


@pytest.mark.slow
def test_a_cam_plate_looks_the_same_upside_down_and_an_angle_block_never() -> None:
    cam = load_solid(part_file("disc_cam_a.stl"))
    assert pairs(cam)[(0, 1)] == "edges"
    block = load_solid(part_file("angle_block.stl"))
    assert not pairs(block)


@pytest.mark.slow
def test_poses_named_as_the_same_look_the_same() -> None:
    solid = turned(rod(12, 40, 6))
    poses = name_duplicates(find_resting(solid).poses, part_symmetries(solid))
    alike = {(a.pose, a.other) for a in look_alikes(solid, poses)}
    same = {
        (a.index, b.index)
        for a in poses
        for b in poses
        if a.index < b.index and a.same_as == b.same_as
    }
    assert same <= alike
