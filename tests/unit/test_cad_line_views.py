"""Line drawings against geometry on paper, an independent union, pixel maps and invariances."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import shapely
from cad_solids import Body, box, polygon_area, prism, rod, solid_of
from data_files import part_file
from manifold3d import CrossSection
from numpy.typing import NDArray

from controller.cad import (
    DrawnEdge,
    LineView,
    Loop,
    Solid,
    camera_view,
    line_view,
    load_solid,
    make_solid,
    outline,
    prepare_views,
)
from controller.imaging import Camera, RayCaster, render_maps, transform, view_roi

Array = NDArray[np.float64]
SEGMENTS = 256
NONE = (0.0, 0.0, 0.0, 0.0, 0.0)
BENT = (-0.08, 0.11, 1e-4, -1e-4, 0.0)


def about(axis: str, angle_rad: float) -> Array:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    R = np.eye(3)
    R[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
    return R


def anywhere(seed: int) -> Array:
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


@cache
def camera(distortion: tuple[float, ...] = NONE) -> Camera:
    """Straight down from 600 mm; world x is picture right, world y picture up."""
    K = np.array([[1800.0, 0, 320.0], [0, 1790.0, 250.0], [0, 0, 1]])
    T = np.diag([1.0, -1, -1, 1])
    T[2, 3] = 600.0
    return Camera((640, 512), K, np.array(distortion), T)


def posed(R: Array, x: float, y: float, z: float) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, (x, y, z)
    return T


def length(edges: list[DrawnEdge] | tuple[DrawnEdge, ...]) -> float:
    return sum(float(np.linalg.norm(np.diff(e.points, axis=0), axis=1).sum()) for e in edges)


def signed_area(loop: Loop) -> float:
    p, q = loop.points, np.roll(loop.points, -1, axis=0)
    return 0.5 * float((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum())


def polygon_of(view: LineView) -> shapely.Geometry:
    outer = [shapely.Polygon(loop.points) for loop in view.loops if not loop.is_hole]
    holes = [shapely.Polygon(loop.points) for loop in view.loops if loop.is_hole]
    return shapely.difference(shapely.union_all(outer), shapely.union_all(holes))


@cache
def random_solid(seed: int) -> Solid:
    """Blocks and rods thrown together and cut out of each other, of one piece."""
    rng = np.random.default_rng(seed)
    body = box(*rng.uniform(15, 40, 3))
    for k in range(6):
        tool = box(*rng.uniform(5, 25, 3)) if k % 2 else rod(*rng.uniform((3, 15), (8, 45)), 24)
        tool = tool.rotate(rng.uniform(0, 360, 3)).translate(rng.uniform(-12, 12, 3))
        body = body - tool if k % 3 == 2 else body + tool
    return solid_of(max(body.decompose(), key=lambda piece: piece.volume()))


def test_a_box_from_above_is_a_rectangle_of_its_upper_edges() -> None:
    view = line_view(solid_of(box(40, 20, 10)), np.eye(3))
    (loop,) = view.loops
    assert sorted(map(tuple, loop.points.round(9))) == [(-20, -10), (-20, 10), (20, -10), (20, 10)]
    assert signed_area(loop) == pytest.approx(800)
    assert not loop.is_hole
    assert not loop.is_phantom.any()
    assert [s.sweep_rad for s in loop.strokes] == [0.0] * 4
    # the lower edges are superimposed, the upright ones are points
    assert len(view.edges) == 4
    assert all(e.kind == "sharp" and e.on_outline for e in view.edges)
    assert all(e.points_mm[:, 2] == pytest.approx(5) for e in view.edges)
    assert not any(e.starts_phantom or e.ends_phantom for e in view.edges)
    assert {e.edge for e in view.edges} == set(loop.edges.tolist())
    assert (view.area, view.perimeter) == pytest.approx((800, 120))
    assert view.centroid == pytest.approx([0, 0], abs=1e-9)
    assert view.second_moments == pytest.approx(np.diag([40**2 / 12, 20**2 / 12]))


def test_a_box_on_its_edge_shows_two_faces_and_the_edge_between() -> None:
    view = line_view(solid_of(box(40, 20, 10)), about("x", np.pi / 4))
    across = (20 + 10) / np.sqrt(2)
    assert view.area == pytest.approx(40 * across)
    inner = [e for e in view.edges if not e.on_outline]
    assert length(inner) == pytest.approx(40)
    assert length(view.edges) == pytest.approx(3 * 40 + 2 * across)


def test_an_l_block_seen_along_its_bend_is_its_own_section() -> None:
    section = [(0.0, 0.0), (30.0, 0.0), (30.0, 8.0), (8.0, 8.0), (8.0, 20.0), (0.0, 20.0)]
    view = line_view(solid_of(prism(section, 15.0)), np.eye(3))
    (loop,) = view.loops
    area = 30 * 8 + 8 * 12
    centre = (np.array([15, 4]) * 240 + np.array([4, 14]) * 96) / area
    start = int(np.argmin(np.linalg.norm(loop.points + centre, axis=1)))
    assert np.roll(loop.points, -start, axis=0) + centre == pytest.approx(
        np.array(section), abs=1e-7
    )
    assert view.area == pytest.approx(area)
    assert view.centroid == pytest.approx([0, 0], abs=1e-7)
    # its inner bend hides nothing: six edges, all of the outline
    assert len(view.edges) == 6


def test_an_edge_behind_a_post_ends_in_phantoms_on_both_sides_of_it() -> None:
    plate = Body.cube((60, 40, 10)).translate((-30, -20, -5))
    post = Body.cube((20, 10, 40)).translate((-10, -5, 5))
    solid = solid_of(plate + post)
    tilt = np.radians(60)  # the post leans over the plate's near upper edge
    view = line_view(solid, about("x", tilt))
    lift = float((about("x", tilt) @ solid.centroid_mm)[1])
    edge_y = -20 * np.cos(tilt) - 5 * np.sin(tilt) - lift
    top_y = -5 * np.cos(tilt) - 45 * np.sin(tilt) - lift
    area = 60 * (40 * np.cos(tilt) + 10 * np.sin(tilt)) + 20 * (edge_y - top_y)
    assert view.area == pytest.approx(area)
    (loop,) = view.loops
    phantoms = loop.points[loop.is_phantom]
    assert sorted(map(tuple, phantoms)) == [
        pytest.approx((-10, edge_y)),
        pytest.approx((10, edge_y)),
    ]
    near = [e for e in view.edges if (np.abs(e.points[:, 1] - edge_y) < 1e-6).all()]
    assert len(near) == 2
    for e in near:
        inner = int(np.argmin(np.abs(e.points[:, 0])))
        assert abs(e.points[inner, 0]) == pytest.approx(10)
        assert np.abs(e.points[:, 0]).max() == pytest.approx(30)
        assert (e.starts_phantom, e.ends_phantom) == (inner == 0, inner != 0)
    # the post's own foot: its far edge and two sides are hidden, its near one shows
    foot = [e for e in view.edges if (np.abs(e.points_mm[:, 2] - 5) < 1e-6).all()]
    foot = [e for e in foot if np.abs(e.points_mm[:, 0]).max() < 11]
    assert len(foot) == 1
    assert foot[0].points_mm[:, 1] == pytest.approx(5)
    assert length(foot) == pytest.approx(20)


def test_a_bore_seen_square_is_one_circle_run_through_clockwise() -> None:
    plate = box(60, 40, 6) - rod(7, 20, SEGMENTS).translate((12, -4, 0))
    view = line_view(solid_of(plate), np.eye(3))
    outer, hole = view.loops
    assert (outer.is_hole, hole.is_hole) == (False, True)
    assert signed_area(hole) == pytest.approx(-polygon_area(7, SEGMENTS))
    (arc,) = hole.strokes
    assert arc.sweep_rad == pytest.approx(-2 * np.pi)
    assert arc.centre is not None
    assert arc.axes is not None
    shift = 7**2 * np.pi * 6 * np.array([12, -4]) / (60 * 40 * 6 - 7**2 * np.pi * 6)
    assert arc.centre == pytest.approx(np.array([12, -4]) + shift, abs=2e-3)
    assert np.linalg.norm(arc.axes, axis=1) == pytest.approx([7, 7], abs=1e-3)
    assert arc.edge == hole.edges[0]
    assert len(view.edges) == 5  # four sides and one rim


def test_a_slanting_bore_lets_through_what_both_rims_leave_free() -> None:
    radius, thick, tilt = 10.0, 6.0, np.radians(35)
    solid = solid_of(box(60, 60, thick) - rod(radius, 20, SEGMENTS))
    view = line_view(solid, about("x", tilt))
    (hole,) = (loop for loop in view.loops if loop.is_hole)
    d = thick * np.tan(tilt)  # both rims are flattened alike, and so is their common lens
    lens = 2 * radius**2 * np.arccos(d / (2 * radius)) - d / 2 * np.sqrt(4 * radius**2 - d**2)
    assert -signed_area(hole) == pytest.approx(lens * np.cos(tilt), rel=1e-3)
    assert hole.is_phantom.sum() == 2
    assert len(hole.strokes) == 2
    for arc in hole.strokes:
        assert arc.axes is not None
        half = np.linalg.norm(arc.axes, axis=1)
        assert half == pytest.approx([radius, radius * np.cos(tilt)], abs=2e-3)
    rims = [e for e in view.edges if np.hypot(*e.points_mm[0, :2]) < radius + 0.1]
    upper = [e for e in rims if e.points_mm[0, 2] > 0]
    lower = [e for e in rims if e.points_mm[0, 2] < 0]
    # the near rim shows all round, the far one along its arc of the lens
    total = sum(np.linalg.norm(np.diff(e.points_mm, axis=0), axis=1).sum() for e in upper)
    assert total == pytest.approx(2 * np.pi * radius, rel=1e-3)
    total = sum(np.linalg.norm(np.diff(e.points_mm, axis=0), axis=1).sum() for e in lower)
    assert total == pytest.approx(2 * radius * np.arccos(d / (2 * radius)), rel=1e-2)


def test_rims_tessellated_differently_are_one_circle_seen_along_their_bore() -> None:
    # the same bore with its lower rim turned by half a facet
    count, radius = 32, 8.0
    angle = np.arange(count) * 2 * np.pi / count
    upper = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    angle = angle + np.pi / count
    lower = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    points = np.vstack([np.c_[upper, np.full(count, 5.0)], np.c_[lower, np.full(count, -5.0)]])
    boss = Body.hull_points(points)
    view = line_view(solid_of(boss + box(40, 40, 4).translate((0, 0, -7))), np.eye(3))
    rims = [e for e in view.edges if not e.on_outline]
    assert len(rims) == 1
    assert not rims[0].starts_phantom
    assert rims[0].points_mm[:, 2] == pytest.approx(5)


def test_a_lying_cylinder_is_a_rectangle_with_two_sides_of_its_wall() -> None:
    solid = solid_of(rod(9, 50, SEGMENTS))
    view = line_view(solid, about("y", np.pi / 2))
    assert view.area == pytest.approx(2 * 9 * 50, rel=1e-4)
    (loop,) = view.loops
    (wall,) = (f.id for f in solid.faces if f.kind == "cylinder")
    assert sorted(set(loop.faces.tolist())) == [-1, wall]
    rim = [e for e in view.edges if e.kind == "silhouette"]
    assert [e.face for e in rim] == [wall, wall]
    assert length(rim) == pytest.approx(100)
    assert all(e.on_outline and e.edge == -1 for e in rim)
    assert len(loop.strokes) == 4


def test_a_ball_is_a_circle_with_no_edge_of_its_own() -> None:
    radius = 20.0
    solid = solid_of(Body.sphere(radius, 128))
    view = line_view(solid, anywhere(1))
    (loop,) = view.loops
    # its facets lie up to r (1 - cos(pi / 128)) inside
    assert view.area == pytest.approx(np.pi * radius**2, rel=2e-3)
    assert (loop.edges == -1).all()
    (arc,) = loop.strokes
    assert arc.axes is not None
    assert np.linalg.norm(arc.axes, axis=1) == pytest.approx([radius, radius], rel=1e-3)
    assert abs(arc.sweep_rad) == pytest.approx(2 * np.pi)
    assert all(e.kind == "silhouette" and e.on_outline for e in view.edges)
    assert length(view.edges) == pytest.approx(2 * np.pi * radius, rel=5e-3)


def test_a_cone_from_its_side_is_a_triangle_and_from_its_tip_a_disc() -> None:
    solid = solid_of(Body.cylinder(30, 12, 0, SEGMENTS, True))
    side = line_view(solid, about("x", np.pi / 2))
    assert side.area == pytest.approx(12 * 30, rel=1e-3)
    assert len(side.loops[0].strokes) == 3
    above = line_view(solid, np.eye(3))
    assert above.area == pytest.approx(polygon_area(12, SEGMENTS))
    assert len(above.edges) == 1


def test_a_ring_has_a_hole_square_on_and_none_from_its_side() -> None:
    profile = [(20 + 6 * np.cos(a), 6 * np.sin(a)) for a in np.arange(48) * 2 * np.pi / 48]
    ring = solid_of(CrossSection([np.array(profile)]).revolve(128))
    above = line_view(ring, np.eye(3))
    assert [loop.is_hole for loop in above.loops] == [False, True]
    assert above.area == pytest.approx(np.pi * (26**2 - 14**2), rel=2e-3)
    side = line_view(ring, about("x", np.pi / 2))
    # a rectangle between two half discs
    assert side.area == pytest.approx(40 * 12 + np.pi * 36, rel=4e-3)
    assert [loop.is_hole for loop in side.loops] == [False]


def test_through_a_window_only_what_lies_under_it_is_seen() -> None:
    hollow = box(40, 40, 40) - box(30, 30, 30) - box(10, 10, 60).translate((0, 0, 30))
    seen = box(4, 4, 2).translate((0, 0, -14))
    unseen = box(4, 4, 2).translate((10, 0, -14))
    half = box(4, 4, 2).translate((0, 5, -14))
    view = line_view(solid_of(hollow + seen + unseen + half), np.eye(3))
    assert view.area == pytest.approx(1600)
    inside = [e for e in view.edges if e.points_mm[:, 2].max() < -10]
    # a whole square, and the three sides of another as far as the window's edge
    assert length(inside) == pytest.approx(16 + 4 + 2 * 2)
    phantoms = [
        p[1]
        for e in inside
        for p, is_phantom in ((e.points[0], e.starts_phantom), (e.points[-1], e.ends_phantom))
        if is_phantom
    ]
    offset = solid_of(hollow + seen + unseen + half).centroid_mm[1]
    assert phantoms == pytest.approx([5 - offset] * 2)


def test_a_step_down_shows_one_line_though_two_edges_lie_there() -> None:
    stair = prism(
        [(0.0, 0.0), (30.0, 0.0), (30.0, 5.0), (12.0, 5.0), (12.0, 15.0), (0.0, 15.0)], 20
    )
    view = line_view(solid_of(stair), about("x", np.pi / 2))
    inner = [e for e in view.edges if not e.on_outline]
    assert len(inner) == 1
    assert inner[0].points_mm[:, 1] == pytest.approx(15)  # the upper one
    assert length(view.edges) == pytest.approx(2 * 30 + 3 * 20)


@pytest.mark.parametrize("seed", range(6))
def test_the_outline_is_the_union_of_all_triangles(seed: int) -> None:
    solid = random_solid(seed)
    R = anywhere(seed + 100)
    view = line_view(solid, R)
    upright = (solid.mesh.vertices - solid.centroid_mm) @ R.T
    union = shapely.union_all(shapely.polygons(upright[solid.mesh.faces][:, :, :2]))
    assert view.area == pytest.approx(union.area, rel=1e-6)
    assert shapely.area(shapely.symmetric_difference(polygon_of(view), union)) < 1e-3
    assert view.centroid == pytest.approx(np.array(union.centroid.coords[0]), abs=1e-5)
    for loop in view.loops:
        assert (signed_area(loop) < 0) == loop.is_hole
        for stroke, following in pairwise((*loop.strokes, loop.strokes[0])):
            assert stroke.end == pytest.approx(following.start)


@pytest.mark.parametrize("seed", range(4))
def test_each_visible_edge_is_seen_and_each_hidden_one_is_not(seed: int) -> None:
    """Against rays from far above through points beside the edges, edge by edge."""
    solid = random_solid(seed)
    R = anywhere(seed + 200)
    view = line_view(solid, R)
    drawn = shapely.union_all([shapely.LineString(e.points) for e in view.edges])
    upright = (solid.mesh.vertices - solid.centroid_mm) @ R.T
    caster = RayCaster(solid.mesh)
    boundary, wrong, total = solid.boundary, 0, 0
    for edge in range(boundary.edge_count):
        for one, other in pairwise(boundary.chain_of(edge)):
            a, b = upright[one], upright[other]
            if np.linalg.norm((b - a)[:2]) < 0.5:
                continue
            part = (np.arange(8) + 0.5)[:, None] / 8
            points = a + part * (b - a)
            aside = np.array([-(b - a)[1], (b - a)[0], 0]) / np.linalg.norm((b - a)[:2])
            seen = np.zeros(8, dtype=np.int64)
            for sign in (-1, 1):
                beside = points + sign * 0.004 * aside
                start = np.c_[beside[:, :2], np.full(8, 200.0)] @ R + solid.centroid_mm
                _, distance = caster.first_hit(start, np.broadcast_to(-R[2], start.shape))
                # a face through the edge passes beside it at its height, within its slope
                seen += 200.0 - distance > points[:, 2] - 0.3
                seen -= 200.0 - distance > points[:, 2] + 0.3
            away = shapely.distance(shapely.points(points[:, :2]), drawn)
            wrong += int(((away < 1e-3) & (seen == 0)).sum() + ((away > 0.05) & (seen > 0)).sum())
            total += len(points)
    # a face that falls away by more than 0.3 mm within 0.004 mm is not told from one behind it
    assert total > 200
    assert wrong <= 0.01 * total


@pytest.mark.parametrize("seed", range(3))
def test_turning_the_part_turns_the_drawing(seed: int) -> None:
    solid, R = random_solid(seed), anywhere(seed)
    prepared = prepare_views(solid)
    turn = about("z", 0.7)
    still, turned = (line_view(solid, Q, prepared=prepared) for Q in (R, turn @ R))
    assert turned.area == pytest.approx(still.area)
    assert turned.perimeter == pytest.approx(still.perimeter, rel=1e-4)
    assert turned.centroid == pytest.approx(turn[:2, :2] @ still.centroid, abs=1e-6)
    expected = turn[:2, :2] @ still.second_moments @ turn[:2, :2].T
    assert turned.second_moments == pytest.approx(expected)
    for kind in ("sharp", "smooth", "silhouette"):
        lengths = [length([e for e in v.edges if e.kind == kind]) for v in (still, turned)]
        assert lengths[1] == pytest.approx(lengths[0], rel=1e-3, abs=0.02)


@pytest.mark.parametrize("seed", range(2))
def test_a_mirrored_and_a_larger_part_have_drawings_to_match(seed: int) -> None:
    solid, R = random_solid(seed), anywhere(seed)
    view = line_view(solid, R)
    mesh = solid.mesh.copy()
    mesh.apply_transform(np.diag([-1.0, 1, 1, 1]))  # trimesh turns the faces over too
    mirrored = line_view(
        make_solid(mesh, "mirror", "", "mirror"), np.diag([-1.0, 1, 1]) @ R @ np.diag([-1.0, 1, 1])
    )
    assert mirrored.area == pytest.approx(view.area)
    assert length(mirrored.edges) == pytest.approx(length(view.edges), rel=2e-3)
    assert mirrored.centroid == pytest.approx(view.centroid * [-1, 1], abs=1e-6)
    mesh = solid.mesh.copy()
    mesh.apply_scale(2.0)
    larger = line_view(make_solid(mesh, "double", "", "double"), R)
    assert larger.area == pytest.approx(4 * view.area)
    # a free wall's silhouette is left out within 0.05 mm of its rim, whatever the scale
    sharp, larger_sharp = ([e for e in v.edges if e.kind == "sharp"] for v in (view, larger))
    assert length(larger_sharp) == pytest.approx(2 * length(sharp), rel=1e-4)
    assert larger.second_moments == pytest.approx(4 * view.second_moments)


def test_a_camera_sees_a_box_at_its_pixels_anticlockwise_to_the_eye() -> None:
    T = posed(np.eye(3), 10, -5, 15)
    view = camera_view(solid_of(box(40, 20, 30)), T, camera())
    (loop,) = view.loops
    # straight under the camera the walls fall away inwards: the outline is the upper face's
    depth = 600.0 - 30.0
    u = [320 + 1800 * x / depth for x in (-10, 30)]
    v = [250 - 1790 * y / depth for y in (-15, 5)]
    corners = sorted((a, b) for a in u for b in v)
    found = sorted(map(tuple, loop.points))
    assert np.array(found) == pytest.approx(np.array(corners))
    assert signed_area(loop) == pytest.approx(-40 * 20 * 1800 * 1790 / depth**2)
    assert view.area == pytest.approx(-signed_area(loop))
    assert view.centroid == pytest.approx([np.mean(u), np.mean(v)])


@pytest.mark.parametrize("distortion", [NONE, BENT])
def test_what_a_camera_draws_is_where_it_projects_the_part(distortion: tuple[float, ...]) -> None:
    cam = camera(distortion)
    body = box(60, 40, 20) - rod(8, 40, 64) + rod(5, 30, 64).translate((20, 10, 15))
    T = posed(anywhere(3), -40, 30, 60)
    view = camera_view(solid_of(body), T, cam)
    assert len(view.edges) > 10
    for e in view.edges:
        assert cam.project(transform(T, e.points_mm)) == pytest.approx(e.points, abs=1e-6)
    # the outline is where the drawn edges on it are
    rim = shapely.union_all([shapely.LineString(e.points) for e in view.edges if e.on_outline])
    for loop in view.loops:
        assert shapely.distance(shapely.points(loop.points), rim).max() < 0.02


@pytest.mark.parametrize(("distortion", "tolerance"), [(NONE, 1e-6), (BENT, 0.02)])
def test_circles_stay_arcs_through_a_camera(
    distortion: tuple[float, ...], tolerance: float
) -> None:
    cam, radius = camera(distortion), 15.0
    solid = solid_of(rod(radius, 6, SEGMENTS))
    T = posed(about("x", 0.4) @ about("y", -0.3), 50, 40, 30)
    view = camera_view(solid, T, cam)
    (upper,) = {e.edge for e in view.edges if e.kind == "sharp" and e.points_mm[:, 2].min() > 2.9}
    arcs = [s for loop in view.loops for s in loop.strokes if s.edge == upper]
    assert arcs
    angle = np.linspace(0, 2 * np.pi, 100)
    rim = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(100, 3.0)])
    pixels = cam.project(transform(T, rim))
    for arc in arcs:
        assert arc.centre is not None
        assert arc.axes is not None
        unit = (pixels - arc.centre) @ arc.axes.T / (arc.axes**2).sum(axis=1)
        off = np.abs(np.linalg.norm(unit, axis=1) - 1) * np.linalg.norm(arc.axes, axis=1).max()
        # the fitted circle is that of the corners, to 1e-6 of the radius
        assert off.max() < tolerance + 1e-4


def test_a_part_beside_the_camera_is_no_view() -> None:
    with pytest.raises(ValueError, match="in front of it"):
        camera_view(solid_of(box(40, 20, 30)), posed(np.eye(3), 0, 0, 590), camera())


def test_the_outline_alone_is_the_drawings_outline() -> None:
    solid = random_solid(3)
    T = posed(anywhere(5), 20, 10, 60)
    for whole, alone in (
        (line_view(solid, anywhere(4)), outline(solid, anywhere(4))),
        (camera_view(solid, T, camera(BENT)), outline(solid, T, camera(BENT))),
    ):
        assert alone.edges == ()
        assert len(alone.loops) == len(whole.loops)
        for one, other in zip(alone.loops, whole.loops, strict=True):
            assert np.array_equal(one.points, other.points)
            assert np.array_equal(one.edges, other.edges)


@pytest.mark.parametrize("name", ["angle_block", "holder", "idler_riser", "flange_xy"])
def test_filled_outlines_are_the_pixel_maps_masks(name: str) -> None:
    solid = load_solid(part_file(f"{name}.stl"))
    R = anywhere(11)
    T = posed(R, *(np.array([30.0, -20.0, 80.0]) - R @ solid.centroid_mm))
    cam = camera(BENT)
    view = outline(solid, T, cam)
    roi = view_roi(solid.mesh.vertices, T, cam)
    assert roi is not None
    mask = render_maps(RayCaster(solid.mesh), T, cam, roi).mask
    v, u = np.mgrid[roi[1] : roi[3], roi[0] : roi[2]]
    polygon = polygon_of(view)
    shapely.prepare(polygon)
    inside = shapely.contains_xy(polygon, u.ravel(), v.ravel()).reshape(mask.shape)
    # where they differ, the pixel's centre lies on the outline
    y, x = np.nonzero(inside != mask)
    points = shapely.points(x + roi[0], y + roi[1])
    assert len(points) < 0.002 * mask.sum()
    if len(points):
        assert shapely.distance(points, shapely.boundary(polygon)).max() < 0.02
