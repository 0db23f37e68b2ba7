"""Predicted edges against the CAD room's line drawings, and against geometry on paper."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from cad_solids import box, rod, solid_of
from data_files import part_file
from fitting_bodies import about_z, anywhere, area_of, model, solid
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from table_pictures import overhead, resting

from controller.cad import LineView, Solid, camera_view, load_solid, outline, stable_poses
from controller.imaging import Camera, inverse_pose, transform
from controller.recognition.fitting import (
    EdgeModel,
    ModelEdgePoints,
    edge_model,
    predict_edges,
    predict_outline,
)

Array = NDArray[np.float64]
CAMERA = overhead()
NEAR_PX = 0.06  # 0.015 mm, how close beside an edge it is asked whether there is nothing
# a sample is looked at from 0.06 mm outside, and hidden by what is 0.25 mm nearer: a crease that
# goes behind a rim is drawn so much too far
BARELY_HIDDEN_PX = 0.25
MIN_HIDDEN_PX = 1.2
COVERED = 0.97
BODIES = ["block", "elbow", "plate", "pocket", "nut", "stepped", "hand", "wedge"]
PARTS = ["holder.stl", "angle_block.stl", "flange_xy.stl"]


def anyhow(body: Solid, seed: int) -> Array:
    """A pose above the table, turned in any way."""
    rng = np.random.default_rng(1000 + seed)
    return resting(body, anywhere(seed), *rng.uniform(-45, 45, 2), rng.uniform(-np.pi, np.pi))


def mm_per_px(T: Array, body: Solid) -> float:
    return CAMERA.mm_per_px(transform(T, body.centroid_mm[None])[0])


def lines_of(runs: list[Array]) -> shapely.Geometry:
    return shapely.union_all([shapely.LineString(points) for points in runs])


def closed(view: LineView) -> list[Array]:
    return [np.vstack([loop.points, loop.points[:1]]) for loop in view.loops]


def off_px(pixels: Array, lines: shapely.Geometry) -> Array:
    shapely.prepare(lines)
    return np.asarray(shapely.distance(lines, shapely.points(pixels)))


def covered_share(runs: list[Array], pixels: Array, within_px: float) -> float:
    """Share of the length of polylines that has a predicted point nearby."""
    if not runs:
        return 1.0
    samples = np.concatenate(
        [shapely.get_coordinates(shapely.segmentize(shapely.LineString(r), 0.5)) for r in runs]
    )
    return float(np.mean(cKDTree(pixels).query(samples)[0] <= within_px))


def check_outline(body: Solid, prepared: EdgeModel, T: Array) -> None:
    view = outline(body, T, CAMERA)
    edges = predict_outline(prepared, T, CAMERA)
    assert edges.on_outline.all()
    assert off_px(edges.pixels, lines_of(closed(view))).max() < NEAR_PX
    step_px = edges.step_mm / mm_per_px(T, body)
    assert covered_share(closed(view), edges.pixels, 1.5 * step_px) > COVERED
    assert_normals_point_away(edges, view)


def assert_normals_point_away(edges: ModelEdgePoints, view: LineView) -> None:
    assert np.linalg.norm(edges.normals, axis=1) == pytest.approx(1.0)
    corners = cKDTree(np.concatenate([loop.points for loop in view.loops]))
    on = edges.on_outline
    shape = area_of(view)
    shapely.prepare(shape)
    # nearer than 1 px to a corner half a pixel outwards may be beside the part all the same
    plain = corners.query(edges.pixels[on])[0] > 1.0
    pixels, normals = edges.pixels[on][plain], edges.normals[on][plain]
    outside = shapely.distance(shape, shapely.points(pixels + 0.4 * normals))
    inside = shapely.contains_xy(shape, pixels - 0.4 * normals)
    assert np.mean(outside > 0.3) > 0.995
    assert np.mean(inside) > 0.995


def check_edges(body: Solid, prepared: EdgeModel, T: Array) -> None:
    view = camera_view(body, T, CAMERA)
    edges = predict_edges(prepared, T, CAMERA)
    on = edges.on_outline
    assert off_px(edges.pixels[on], lines_of(closed(view))).max() < NEAR_PX
    # those inside lie on visible edges: none of the hidden ones is there
    drawn = lines_of([e.points for e in view.edges])
    off = off_px(edges.pixels[~on], drawn)
    assert off.max() < MIN_HIDDEN_PX
    assert np.mean(off < BARELY_HIDDEN_PX) > 0.98
    assert np.mean(off < NEAR_PX) > 0.8
    step_px = edges.step_mm / mm_per_px(T, body)
    assert covered_share(closed(view), edges.pixels, 1.5 * step_px) > COVERED
    assert_normals_point_away(edges, view)


@pytest.mark.parametrize("name", BODIES)
def test_a_lying_parts_outline_is_that_of_the_line_drawing(name: str) -> None:
    for k, pose in enumerate(stable_poses(solid(name))[:3]):
        T = resting(solid(name), pose.R, 50.0 - 40 * k, -40.0 + 35 * k, 0.7 + 1.9 * k)
        check_outline(solid(name), model(name), T)


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_parts_outline_turned_in_any_way_is_that_of_the_line_drawing(
    name: str, seed: int
) -> None:
    check_outline(solid(name), model(name), anyhow(solid(name), seed))


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("seed", [3, pytest.param(4, marks=pytest.mark.slow)])
def test_all_predicted_edges_are_visible_ones_of_the_line_drawing(name: str, seed: int) -> None:
    check_edges(solid(name), model(name), anyhow(solid(name), seed))


@pytest.mark.parametrize("name", ["block", "elbow", "pocket", "hand", "wedge"])
@pytest.mark.parametrize("seed", [5, pytest.param(6, marks=pytest.mark.slow)])
def test_no_crease_that_is_seen_goes_without_a_prediction(name: str, seed: int) -> None:
    T = anyhow(solid(name), seed)
    view = camera_view(solid(name), T, CAMERA)
    edges = predict_edges(model(name), T, CAMERA)
    creases = [e.points for e in view.edges if e.kind == "sharp" and not e.on_outline]
    step_px = edges.step_mm / mm_per_px(T, solid(name))
    # at its ends a crease may be hidden by its own neighbours on this side of 0.25 mm
    assert covered_share(creases, edges.pixels[~edges.on_outline], 1.5 * step_px + 1.5) > 0.93


@pytest.mark.parametrize("file", PARTS)
def test_a_real_parts_edges_are_those_of_its_line_drawing(file: str) -> None:
    part = load_solid(part_file(file))
    prepared = edge_model(part)
    pose = stable_poses(part)[0]
    T = resting(part, pose.R, 25.0, -20.0, 1.1)
    check_outline(part, prepared, T)
    check_edges(part, prepared, T)


# --- on paper -----------------------------------------------------------------------------------


def straight_above(height_mm: float = 600.0) -> Camera:
    K = np.array([[1800.0, 0, 320.0], [0, 1800.0, 250.0], [0, 0, 1]])
    T = np.diag([1.0, -1, -1, 1])
    T[2, 3] = height_mm
    return Camera((640, 512), K, np.zeros(5), T)


def test_a_block_beside_the_camera_shows_the_two_sides_that_face_it() -> None:
    body = solid("block")
    T = resting(body, np.eye(3), 70.0, 60.0, 0.0)
    edges = predict_edges(model("block"), T, straight_above())
    inner = transform(inverse_pose(T), edges.points_mm[~edges.on_outline])
    # the upper edges of the sides x = -25 and y = -15, and the upright between: 30, 50, and what
    # is seen of 20
    on_x = np.isclose(inner[:, 0], -25.0)
    on_y = np.isclose(inner[:, 1], -15.0)
    on_top = np.isclose(inner[:, 2], 10.0)
    kinds = np.column_stack([on_x & on_top, on_y & on_top, on_x & on_y])
    assert (kinds.sum(axis=1) == 1).all()
    found = kinds.sum(axis=0) * edges.step_mm
    assert found[:2] == pytest.approx([30, 50], abs=1.5 * edges.step_mm)
    # the upright is seen at a glance, 45 mm aside in x and y and 600 below: what is nearer than
    # half a millimetre to the outline is one edge with it
    glance = np.hypot(45, 45) / 600
    assert found[2] == pytest.approx(20 * glance - 0.45, abs=0.3)
    # the outline is the other six edges that bound these three faces, two of them upright
    seen = 2 * (30 + 50 + 20 * glance)
    assert edges.on_outline.sum() * edges.step_mm == pytest.approx(seen, abs=3.0)


def test_a_block_straight_below_shows_its_upper_face_alone() -> None:
    T = resting(solid("block"), np.eye(3), 0.0, 0.0, 0.4)
    edges = predict_edges(model("block"), T, straight_above())
    assert edges.on_outline.all()
    assert edges.points_mm[:, 2] == pytest.approx(20.0)


def test_a_step_tells_which_side_is_brighter_and_how_deep_it_is() -> None:
    # a post 40 mm high on a plate of 6 mm; the rim of the post's top away from the camera hides
    # the plate behind it: the sight line goes on by 34 mm of height
    body = solid("hand")
    T = resting(body, np.eye(3), 0.0, 0.0, 0.0)
    camera = straight_above()
    edges = predict_edges(model("hand"), T, camera)
    local = transform(inverse_pose(T), edges.points_mm)
    top = ~edges.on_outline & np.isclose(local[:, 2], 40.0)
    assert top.sum() > 10
    eye = camera.position_mm
    z = edges.points_mm[top, 2]
    ray = np.linalg.norm(edges.points_mm[top] - eye, axis=1)
    whole = 34.0 * ray / (eye[2] - z)
    jump = edges.jump_mm[top]
    is_step = jump > 10.0
    assert is_step.any()
    # samples by the post's corner may look past it on one side
    assert np.median(np.abs(jump / whole - 1)[is_step]) < 0.02
    # the rims towards the camera have the post's wall beside them, and no step but the wall's own
    assert (jump[~is_step] < 8.0).all()


def test_lift_is_the_difference_of_cosines_across_the_edge() -> None:
    body = solid("block")
    T = resting(body, np.eye(3), 70.0, 60.0, 0.0)
    camera = straight_above()
    edges = predict_edges(model("block"), T, camera)
    # at the ends of an edge a probe beside it meets the third face
    away = np.abs(edges.points_mm - [45.0, 45.0, 20.0]).max(axis=1)
    inner = ~edges.on_outline & (away > 1.0) & (away < 29.0)
    points = edges.points_mm[inner]
    top = np.isclose(points[:, 2], 20.0)
    on_x = np.isclose(points[:, 0], 45.0)
    towards = camera.position_mm - points
    towards /= np.linalg.norm(towards, axis=1)[:, None]
    # the upper face lies on the side of larger x, or y: there the normal is to point for a plus
    for side, axis in ((top & on_x, 0), (top & ~on_x, 1)):
        pixel_axis = np.array([1.0, 0.0]) if axis == 0 else np.array([0.0, -1.0])
        to_top = np.sign(edges.normals[inner][side] @ pixel_axis)
        # wall normal is -axis: its cosine is minus that component of the sight line
        expected = to_top * (towards[side, 2] + towards[side, axis])
        assert side.sum() > 50
        assert edges.lift[inner][side] == pytest.approx(expected, abs=0.01)


def test_beside_the_outline_the_table_counts_as_dark_whichever_way_an_edge_runs() -> None:
    # straight below the camera all of the upper face's rim has the face inwards, square to the eye
    T = resting(solid("elbow"), np.eye(3), 0.0, 0.0, 0.4)
    edges = predict_edges(model("elbow"), T, straight_above())
    on = edges.on_outline & np.isclose(edges.points_mm[:, 2], 8.0)
    assert on.sum() > 100
    assert edges.lift[on] == pytest.approx(-1.0, abs=0.01)


def test_more_samples_than_asked_for_are_never_taken() -> None:
    T = resting(solid("elbow"), np.eye(3), 10.0, -20.0, 0.3)
    length = outline(solid("elbow"), T, CAMERA).perimeter * mm_per_px(T, solid("elbow"))
    for most in (60, 200, 600):
        edges = predict_outline(model("elbow"), T, CAMERA, most)
        assert len(edges.pixels) <= most
        assert len(edges.pixels) * edges.step_mm == pytest.approx(length, rel=0.06)
    # nothing is sampled finer than a picture resolves
    assert predict_outline(model("elbow"), T, CAMERA, 10**5).step_mm == pytest.approx(0.25)


def test_an_outline_alone_is_the_outline_among_all_edges() -> None:
    T = anyhow(solid("pocket"), 8)
    alone = predict_outline(model("pocket"), T, CAMERA, 10**5)
    among = predict_edges(model("pocket"), T, CAMERA, 10**5)
    near = cKDTree(alone.pixels).query(among.pixels[among.on_outline])[0]
    assert np.quantile(near, 0.99) < 0.25 / mm_per_px(T, solid("pocket"))


def test_turning_part_and_camera_together_changes_nothing() -> None:
    T = anyhow(solid("plate"), 9)
    move = np.eye(4)
    move[:3, :3] = about_z(0.8) @ anywhere(77)
    move[:3, 3] = 31.0, -700.0, 12.0
    moved = Camera(CAMERA.size_px, CAMERA.K, CAMERA.distortion, move @ CAMERA.T_world_cam)
    here = predict_edges(model("plate"), T, CAMERA)
    there = predict_edges(model("plate"), move @ T, moved)
    assert there.pixels == pytest.approx(here.pixels, abs=1e-6)
    assert there.normals == pytest.approx(here.normals, abs=1e-6)
    assert there.lift == pytest.approx(here.lift, abs=1e-6)


def test_edges_that_are_hidden_take_no_samples_from_those_that_show() -> None:
    plain = box(80, 60, 10)
    holed = plain
    for x in range(-32, 33, 8):
        for y in range(-24, 25, 8):
            holed -= rod(3, 4, 48).translate((x, y, -3))  # blind, from below
    shown = []
    for body in (plain, holed):
        part = solid_of(body, "part")
        T = resting(part, np.eye(3), 20.0, 10.0, 0.3)
        shown.append(predict_edges(edge_model(part), T, CAMERA, 300))
    few, many = (len(edges.points_mm) for edges in shown)
    assert many > 0.6 * few
    assert shown[1].step_mm < 1.6 * shown[0].step_mm


def test_a_groove_narrower_than_what_is_looked_at_beside_it_shows_both_its_edges() -> None:
    part = solid_of(box(60, 40, 12) - box(80, 0.6, 2).translate((0, 0, 6)), "grooved")
    T = resting(part, np.eye(3), 0.0, 0.0, 0.0)
    edges = predict_edges(edge_model(part), T, CAMERA)
    for y in (-0.3, 0.3):
        at = np.column_stack([np.linspace(-25, 25, 20), np.full(20, y), np.full(20, 12.0)])
        found = cKDTree(edges.pixels).query(CAMERA.project(at))[0]
        assert found.max() <= 0.6 * edges.step_mm / mm_per_px(T, part)
