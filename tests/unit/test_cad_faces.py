"""Surfaces recognised on triangles: planes, bores and bosses with their true sizes, samples."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from cad_solids import Body, box, polygon_area, prism, rod, solid_of
from data_files import part_file
from manifold3d import CrossSection

from controller.cad import Face, Solid, load_solid, make_solid, sample_surface


def by_kind(solid: Solid, kind: str) -> list[Face]:
    return [face for face in solid.faces if face.kind == kind]


def bore(solid: Solid, radius: float) -> Face:
    (found,) = (
        f for f in by_kind(solid, "cylinder") if f.radius_mm == pytest.approx(radius, abs=1e-3)
    )
    return found


def along(face: Face, axis: tuple[float, float, float]) -> float:
    return abs(float(face.axis @ np.array(axis)))


def assert_bookkeeping(solid: Solid) -> None:
    """Every triangle has one surface; areas add up; ids run from the largest down."""
    areas = [face.area_mm2 for face in solid.faces]
    assert [face.id for face in solid.faces] == list(range(len(areas)))
    assert areas == pytest.approx(sorted(areas, reverse=True))
    per_triangle = np.bincount(solid.face_of_triangle, weights=solid.mesh.area_faces)
    assert per_triangle == pytest.approx(areas)
    assert sum(areas) == pytest.approx(solid.mesh.area)


def test_a_box_has_six_planes_with_outward_normals() -> None:
    solid = solid_of(box(40, 30, 20))
    assert_bookkeeping(solid)
    assert {f.kind for f in solid.faces} == {"plane"}
    assert [f.area_mm2 for f in solid.faces] == pytest.approx([1200, 1200, 800, 800, 600, 600])
    for face in solid.faces:
        half = np.array([20.0, 15.0, 10.0])
        assert face.centre_mm == pytest.approx(face.normal * half, abs=1e-6)
        assert face.label == f"F{face.id} plane"


@pytest.mark.parametrize("segments", [17, 32, 64, 200])
def test_a_rod_is_a_boss_with_two_ends(segments: int) -> None:
    solid = solid_of(rod(10, 30, segments))
    assert_bookkeeping(solid)
    (wall,) = by_kind(solid, "cylinder")
    assert not wall.concave
    assert wall.radius_mm == pytest.approx(10, abs=1e-3)
    assert along(wall, (0, 0, 1)) == pytest.approx(1)
    assert wall.centre_mm == pytest.approx([0, 0, 0], abs=1e-3)
    assert wall.area_mm2 == pytest.approx(segments * 2 * 10 * np.sin(np.pi / segments) * 30)
    assert wall.label.endswith("boss 20.0 mm")
    ends = by_kind(solid, "plane")
    assert [f.area_mm2 for f in ends] == pytest.approx([polygon_area(10, segments)] * 2)


@pytest.mark.parametrize("sides", [3, 4, 6, 8, 12])
def test_a_prism_of_few_sides_stays_planes(sides: int) -> None:
    solid = solid_of(rod(10, 30, sides))
    assert_bookkeeping(solid)
    assert len(by_kind(solid, "plane")) == sides + 2


def test_bores_of_a_plate_are_found_with_radius_axis_and_place() -> None:
    plate = (
        box(80, 60, 10)
        - rod(5, 30, 48).translate((20, 10, 0))
        - rod(3, 30, 32).translate((-25, -15, 0))
    )
    solid = solid_of(plate)
    assert_bookkeeping(solid)
    assert len(solid.faces) == 8
    for radius, x, y in ((5, 20, 10), (3, -25, -15)):
        face = bore(solid, radius)
        assert face.concave
        assert along(face, (0, 0, 1)) == pytest.approx(1)
        assert face.centre_mm == pytest.approx([x, y, 0], abs=1e-3)
        assert face.label == f"F{face.id} bore {2 * radius:.1f} mm"


def test_a_bore_across_has_its_axis_across() -> None:
    solid = solid_of(box(80, 60, 20) - rod(4, 100, 48).rotate((0, 90, 0)))
    face = bore(solid, 4)
    assert face.concave
    assert along(face, (1, 0, 0)) == pytest.approx(1)


def test_a_stepped_hole_is_two_bores_and_a_ledge() -> None:
    # bore 8 mm through, bore 16 mm from the top to z = 2
    body = box(40, 40, 20) - rod(4, 30, 48) - rod(8, 10, 64).translate((0, 0, 7))
    solid = solid_of(body)
    assert_bookkeeping(solid)
    narrow, wide = bore(solid, 4), bore(solid, 8)
    assert narrow.concave
    assert wide.concave
    assert narrow.centre_mm == pytest.approx([0, 0, -4], abs=1e-3)
    assert wide.centre_mm == pytest.approx([0, 0, 6], abs=1e-3)
    (ledge,) = (f for f in by_kind(solid, "plane") if f.centre_mm[2] == pytest.approx(2, abs=1e-3))
    assert ledge.normal == pytest.approx([0, 0, 1], abs=1e-6)
    assert ledge.area_mm2 == pytest.approx(polygon_area(8, 64) - polygon_area(4, 48))


def countersunk(gap_mm: float, segments: tuple[int, int] = (37, 53)) -> Solid:
    """A plate with a bore of 5.5 mm and a cone of 90 degrees, narrowest at z = -0.5, over it."""
    cone = Body.cylinder(3.5, 2.75 + gap_mm, 6.25 + gap_mm, segments[1]).translate((0, 0, -0.5))
    return solid_of(box(40, 40, 5) - rod(2.75, 20, segments[0]) - cone)


@pytest.mark.parametrize("segments", [(37, 53), (24, 31), (53, 37), (48, 48)])
def test_a_countersink_as_wide_as_its_bore_is_one_cone(segments: tuple[int, int]) -> None:
    solid = countersunk(0.0, segments)
    assert_bookkeeping(solid)
    assert sorted(f.kind for f in solid.faces) == ["cone", "cylinder"] + 6 * ["plane"]
    (cone,) = by_kind(solid, "cone")
    assert cone.half_angle_rad == pytest.approx(np.pi / 4, abs=1e-3)
    (wall,) = by_kind(solid, "cylinder")
    assert wall.concave
    # some of its corners, the cone's, lie on its chords
    chord_mm = 2.75 * (1 - np.cos(np.pi / segments[0]))
    assert 2.75 - chord_mm < wall.radius_mm < 2.7501


def test_a_ledge_of_a_twentieth_below_a_countersink_stays_a_plane() -> None:
    assert len(by_kind(countersunk(0.05), "plane")) == 7


def test_a_boss_stands_apart_from_the_plate_it_stands_on() -> None:
    solid = solid_of(box(60, 60, 10) + rod(8, 20, 48).translate((10, 0, 10)))
    assert_bookkeeping(solid)
    boss = bore(solid, 8)
    assert not boss.concave
    assert boss.centre_mm == pytest.approx([10, 0, 12.5], abs=1e-3)


def fillet(radius: float, steps: int) -> Body:
    """A 40 x 20 block, 50 high, one upright edge rounded."""
    turns = np.linspace(np.pi / 2, 0, steps + 1)
    arc = [(40 - radius + radius * np.sin(a), 20 - radius + radius * np.cos(a)) for a in turns]
    return prism([(0, 0), (40, 0), *arc, (0, 20)], 50)


@pytest.mark.parametrize("steps", [5, 8, 12, 30])
def test_a_fillet_is_not_swallowed_by_the_planes_it_runs_into(steps: int) -> None:
    solid = solid_of(fillet(6, steps))
    assert_bookkeeping(solid)
    (round_edge,) = by_kind(solid, "cylinder")
    assert round_edge.radius_mm == pytest.approx(6, abs=1e-3)
    assert not round_edge.concave
    assert round_edge.centre_mm[:2] == pytest.approx([34, 14], abs=1e-3)
    planes = sorted(f.area_mm2 for f in by_kind(solid, "plane"))
    profile = solid.volume_mm3 / 50
    assert planes == pytest.approx(sorted([14 * 50, 34 * 50, 20 * 50, 40 * 50, profile, profile]))


def test_a_slot_is_two_half_bores_and_two_planes() -> None:
    slot = (
        CrossSection.circle(4, 64).translate((10, 0))
        + CrossSection.circle(4, 64).translate((-10, 0))
        + CrossSection.square((20, 8), True)
    )
    solid = solid_of(box(60, 40, 10) - slot.extrude(30).translate((0, 0, -15)))
    assert_bookkeeping(solid)
    ends = by_kind(solid, "cylinder")
    assert [f.radius_mm for f in ends] == pytest.approx([4, 4], abs=1e-3)
    assert all(f.concave for f in ends)
    assert sorted(f.centre_mm[0] for f in ends) == pytest.approx([-10, 10], abs=1e-3)
    assert len(by_kind(solid, "plane")) == 8


def test_a_narrow_flat_between_two_fillets_stays_a_plane() -> None:
    # quarter rounds of radius 3 at (-0.5, 0) and (0.5, 0): 1 mm of flat, narrower than four strips
    turns = np.linspace(0, np.pi / 2, 9)
    right = [(0.5 + 3 * np.cos(a), 3 * np.sin(a)) for a in turns]
    left = [(-x, y) for x, y in right[::-1]]
    solid = solid_of(prism([(-3.5, -5), (3.5, -5), *right, *left], 50))
    assert_bookkeeping(solid)
    assert sorted(f.radius_mm for f in by_kind(solid, "cylinder")) == pytest.approx(
        [3, 3], abs=1e-3
    )
    (flat,) = (f for f in by_kind(solid, "plane") if f.normal[1] > 0.9)
    assert flat.area_mm2 == pytest.approx(50)


def test_a_flat_facet_in_a_free_surface_is_no_plane_of_its_own() -> None:
    # an ellipsoid has no formula of ours; at its pole a small 12-gon, far larger than the
    # triangles in the three rings round it and not three times the mean of all
    n = 1500
    height = 1 - (2 * np.arange(n) + 1) / n
    turn = np.pi * (3 - np.sqrt(5)) * np.arange(n)
    across = np.sqrt(1 - height**2)
    ball = np.column_stack([across * np.cos(turn), across * np.sin(turn), height])
    ball = ball[(ball[:, 2] < 0) | (np.hypot(ball[:, 0], ball[:, 1]) > 0.15)]
    for radius in (0.05, 0.07, 0.095, 0.12):
        angles = 2 * np.pi * np.arange(12) / 12
        ring = radius * np.column_stack([np.cos(angles), np.sin(angles)])
        ball = np.vstack([ball, np.column_stack([ring, np.full(12, np.sqrt(1 - radius**2))])])
    hull = trimesh.convex.convex_hull(ball * [12, 9, 7])
    solid = make_solid(hull, "ellipsoid", "5eed" * 16, where="ellipsoid")
    assert_bookkeeping(solid)
    assert [f.kind for f in solid.faces] == ["freeform"]


def test_the_gear_has_one_free_wall_a_bore_and_two_ends() -> None:
    solid = load_solid(part_file("cycloidal_gear.stl"))
    assert sorted(f.kind for f in solid.faces) == ["cylinder", "freeform", "plane", "plane"]


@pytest.mark.parametrize("slope_deg", [2, 8, 15, 21, 30])
def test_a_shallow_slope_is_a_plane_of_its_own(slope_deg: float) -> None:
    rise = 20 * float(np.tan(np.radians(slope_deg)))
    solid = solid_of(prism([(0, 0), (40, 0), (40, 15), (20, 15 + rise), (0, 15 + rise)], 50))
    assert_bookkeeping(solid)
    assert len(by_kind(solid, "plane")) == len(solid.faces) == 7
    tilted = [f for f in solid.faces if 1e-3 < abs(f.normal[0]) < 0.999]
    assert [f.normal[0] for f in tilted] == pytest.approx([np.sin(np.radians(slope_deg))])


def test_a_ball_is_a_sphere_with_its_centre_and_radius() -> None:
    solid = solid_of(Body.sphere(15, 64).translate((3, 4, 5)))
    assert_bookkeeping(solid)
    (ball,) = solid.faces
    assert ball.kind == "sphere"
    assert not ball.concave
    assert ball.radius_mm == pytest.approx(15, abs=1e-3)
    assert ball.centre_mm == pytest.approx([3, 4, 5], abs=1e-3)
    assert ball.normal == pytest.approx([0, 0, 0])


def test_a_frustum_is_a_cone_that_widens_along_its_axis() -> None:
    # 20 high, radius 15 below and 8 on top
    solid = solid_of(Body.cylinder(20, 15, 8, 64))
    assert_bookkeeping(solid)
    assert sorted(f.kind for f in solid.faces) == ["cone", "plane", "plane"]
    (wall,) = by_kind(solid, "cone")
    assert wall.half_angle_rad == pytest.approx(np.arctan2(7, 20), abs=1e-5)
    assert wall.axis == pytest.approx([0, 0, -1], abs=1e-6)
    assert wall.centre_mm[:2] == pytest.approx([0, 0], abs=1e-3)
    assert wall.radius_mm == pytest.approx(15 - 7 / 20 * wall.centre_mm[2], abs=1e-3)
    assert not wall.concave


def test_a_turned_part_keeps_its_surfaces() -> None:
    body = box(80, 60, 10) - rod(5, 30, 48).translate((20, 10, 0))
    straight, turned = solid_of(body), solid_of(body.rotate((25, -40, 70)))
    assert [f.kind for f in straight.faces] == [f.kind for f in turned.faces]
    assert [f.area_mm2 for f in straight.faces] == pytest.approx(
        [f.area_mm2 for f in turned.faces], rel=1e-4
    )
    assert bore(turned, 5).concave


# --- samples ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def drilled() -> Solid:
    return solid_of(
        box(80, 60, 10)
        - rod(5, 30, 48).translate((20, 10, 0))
        - rod(1, 30, 24).translate((-20, 0, 0))
    )


def test_the_areas_of_the_samples_add_up_face_by_face(drilled: Solid) -> None:
    samples = sample_surface(drilled)
    per_face = np.bincount(samples.face_ids, weights=samples.areas_mm2)
    assert per_face == pytest.approx([face.area_mm2 for face in drilled.faces])
    assert samples.areas_mm2.sum() == pytest.approx(drilled.mesh.area)


def test_even_the_smallest_surface_has_samples(drilled: Solid) -> None:
    samples = sample_surface(drilled, spacing_mm=50.0, per_face=6)
    assert np.bincount(samples.face_ids).min() == 6


def test_samples_stand_about_as_far_apart_as_asked(drilled: Solid) -> None:
    samples = sample_surface(drilled, spacing_mm=2.0)
    top = drilled.faces[0]
    assert (samples.face_ids == top.id).sum() == pytest.approx(top.area_mm2 / 4.0, abs=1)


def test_the_same_file_gives_the_same_samples(drilled: Solid) -> None:
    a, b = sample_surface(drilled), sample_surface(drilled)
    assert np.array_equal(a.points_mm, b.points_mm)
    assert np.array_equal(a.face_ids, b.face_ids)


def test_samples_lie_on_their_surface_and_off_every_edge_of_a_triangle(drilled: Solid) -> None:
    samples = sample_surface(drilled, spacing_mm=1.0)
    triangles = np.asarray(drilled.mesh.triangles)
    normals = np.asarray(drilled.mesh.face_normals)
    for i in range(0, len(samples.points_mm), 20):
        mine = np.nonzero(drilled.face_of_triangle == samples.face_ids[i])[0]
        corners = triangles[mine]
        flat = np.abs(((samples.points_mm[i] - corners[:, 0]) * normals[mine]).sum(axis=1))
        # barycentric coordinates by areas; the triangle it was drawn from has all three >= 0.04
        a, b, c = (corners[:, k] - samples.points_mm[i] for k in range(3))
        parts = np.stack(
            [(np.cross(p, q) * normals[mine]).sum(axis=1) for p, q in ((b, c), (c, a), (a, b))]
        )
        least = (parts / parts.sum(axis=0)).min(axis=0)
        assert least[flat < 1e-6].max() >= 0.04 - 1e-6
        # a bore of 24 segments turns by 7.5 degrees from a facet's middle to its side
        facet = normals[mine][np.argmax(np.where(flat < 1e-6, least, -9))]
        assert facet @ samples.normals[i] >= np.cos(np.radians(7.51))


def test_normals_of_a_bore_point_at_its_axis_and_those_of_planes_are_theirs(drilled: Solid) -> None:
    samples = sample_surface(drilled)
    assert np.linalg.norm(samples.normals, axis=1) == pytest.approx(1)
    wide = bore(drilled, 5).id
    at = samples.points_mm[samples.face_ids == wide]
    inward = np.array([20, 10, 0]) - at * [1, 1, 0]
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    assert samples.normals[samples.face_ids == wide] == pytest.approx(inward, abs=1e-4)
    top = drilled.faces[0]
    assert (samples.normals[samples.face_ids == top.id] == top.normal).all()


def test_no_part_of_a_large_surface_is_left_bare() -> None:
    solid = solid_of(box(100, 80, 10))
    samples = sample_surface(solid, spacing_mm=4.0)
    top = samples.points_mm[samples.face_ids == 0][:, :2]
    cells = np.histogram2d(top[:, 0], top[:, 1], bins=(5, 4), range=((-50, 50), (-40, 40)))[0]
    assert cells.min() >= 8  # 25 are expected in each
