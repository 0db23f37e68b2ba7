"""Which part, which stable pose, where: on pictures made by exact area coverage in the test."""

from __future__ import annotations

import re
from functools import cache

import cv2
import numpy as np
import pytest
import shapely
import trimesh
from cad_solids import Body, box, prism, rod, solid_of
from lit_pictures import Renderer, Scene, placed
from numpy.typing import NDArray
from table_pictures import SIZE, coverage, overhead, picture, resting, silhouette

from controller.cad import CadError, Solid, StablePose, sample_surface, stable_poses
from controller.cad.compiled import compile_solid
from controller.imaging import Camera, PointLamp, inverse_pose, transform
from controller.recognition import Library, Sighting, make_library, pose_on_table, recognise
from controller.recognition.identification.cutout import ObjectCutout
from controller.recognition.identification.hypotheses import weigh
from controller.recognition.identification.scene import TableScene
from controller.recognition.library import Candidate
from controller.recognition.segmentation import segment

Array = NDArray[np.float64]
CAMERA = overhead()
TABLE = np.array([[-150.0, -120, 0], [150, -120, 0], [150, 120, 0], [-150, 120, 0]])

ELBOW = [(0, 0), (60, 0), (60, 18), (22, 18), (22, 42), (0, 42)]


def elbow() -> Body:
    """No symmetry at all once it lies on its large face."""
    return prism([(float(x), float(y)) for x, y in ELBOW], 8) - rod(4, 40, 48).translate((45, 9, 0))


def hand() -> Body:
    """A plate that can lie on one large face only: a post stands on the other. It has a hand."""
    plate = prism([(0, 0), (50, 0), (50, 12), (20, 20), (20, 36), (0, 36)], 6)
    return plate + box(8, 8, 40).translate((10, 18, 20))


@cache
def solids() -> dict[str, Solid]:
    bodies = {
        "elbow": elbow(),
        "plate": box(60, 40, 10) - rod(3, 40, 48).translate((18, 8, 0)),
        "nut": rod(18, 12, 6) - rod(6, 40, 48),
        "block": box(50, 30, 20),
        "hand": hand(),
        "other_hand": hand().mirror((1, 0, 0)),
    }
    return {name: solid_of(body, name) for name, body in bodies.items()}


@cache
def library() -> Library:
    return make_library([compile_solid(solid) for solid in solids().values()], CAMERA)


def poses(name: str) -> tuple[StablePose, ...]:
    return stable_poses(solids()[name])


def shape(name: str, T: Array) -> shapely.Geometry:
    return silhouette(solids()[name].mesh, T, CAMERA)


def look(image: NDArray[np.uint8], **more: object) -> tuple[Sighting, ...]:
    return recognise(image, CAMERA, library(), "backlit", **more).sightings  # type: ignore[arg-type]


def surface_gap_mm(name: str, T_found: Array, T_true: Array) -> Array:
    """How far each surface of the part lies from where the answer puts it, (faces,), mean."""
    solid = solids()[name]
    samples = sample_surface(solid)
    points = transform(inverse_pose(T_found), transform(T_true, samples.points_mm))
    gap = trimesh.proximity.closest_point(solid.mesh, points)[1]
    return np.bincount(samples.face_ids, weights=gap) / np.bincount(samples.face_ids)


def assert_right(seen: Sighting, name: str, T_true: Array, tolerance_mm: float = 0.015) -> None:
    assert seen.part == name, seen.reason
    assert seen.T_world_part is not None
    assert seen.R is not None
    assert surface_gap_mm(name, seen.T_world_part, T_true).max() < tolerance_mm
    # the answer's parts say the same as its pose (conventions.md 4)
    (pose,) = (p for p in poses(name) if p.index == seen.pose_index)
    told = pose_on_table(solids()[name], pose, seen.x_mm, seen.y_mm, seen.theta_rad)
    assert seen.T_world_part == pytest.approx(told, abs=0.03)  # but for a tilt of 0.1 degrees
    np.testing.assert_allclose(seen.R, pose.R)
    com = transform(T_true, solids()[name].centroid_mm[None])[0]
    assert (seen.x_mm, seen.y_mm) == pytest.approx(com[:2], abs=tolerance_mm)


def test_coverage_of_a_square_is_its_area() -> None:
    share = coverage(shapely.box(10.25, 20.5, 30.75, 40.5))
    assert share.sum() == pytest.approx(20.5 * 20)
    # pixel 10 spans 9.5 to 10.5
    assert share[30, 9:12] == pytest.approx([0, 0.25, 1])
    triangle = shapely.Polygon([(5, 5), (90, 20), (30, 77)])
    assert coverage(triangle).sum() == pytest.approx(triangle.area, rel=1e-4)


PLACES = [
    (name, pose, x, y, theta)
    for name, pose, x, y, theta in (
        ("elbow", 0, 0.0, 0.0, 0.0),
        ("elbow", 1, 48.2, -37.3, 2.9),
        ("elbow", 0, -51.7, 40.1, -1.1),
        ("plate", 0, 12.3, -40.4, 0.61),
        ("plate", 1, -47.0, 22.2, 3.0),
        ("nut", 0, 55.1, 31.3, 0.4),
        ("block", 0, -60.5, -31.1, 1.3),
        ("block", 2, 5.5, 9.9, -2.2),
        ("block", 4, 44.4, 44.4, 0.77),
        ("hand", 0, -20.2, 15.7, 2.0),
        ("other_hand", 0, 30.3, -25.5, -0.5),
    )
]


@pytest.mark.parametrize(("name", "pose", "x", "y", "theta"), PLACES)
def test_a_part_alone_is_named_and_placed_to_hundredths_of_a_millimetre(
    name: str, pose: int, x: float, y: float, theta: float
) -> None:
    T = resting(solids()[name], poses(name)[pose].R, x, y, theta)
    (seen,) = look(picture([shape(name, T)], seed=pose))
    assert_right(seen, name, T)
    assert seen.score > 0.99
    assert seen.residual_px < 0.1
    assert {a.part for a in seen.ambiguous_with} <= {name}


@pytest.mark.parametrize(
    ("name", "centre", "radius"), [("plate", (18.0, 8.0), 3.0), ("nut", (0.0, 0.0), 6.0)]
)
def test_a_part_without_its_hole_is_unknown_and_the_place_of_the_hole_is_named(
    name: str, centre: tuple[float, float], radius: float
) -> None:
    T = resting(solids()[name], poses(name)[0].R, 31.0, -17.0, 2.2)
    filled = shapely.Polygon(shapely.get_exterior_ring(shape(name, T)))
    (seen,) = look(picture([filled]))
    assert seen.part is None
    named = re.search(r"would be (\d+) mm about x (-?\d+), y (-?\d+) mm", seen.reason)
    assert named, seen.reason
    length, x, y = map(int, named.groups())
    # without its hole the plate looks the same after half a turn
    holes = transform(T, np.array([[*centre, 5.0], [-centre[0], -centre[1], 5.0]]))
    assert np.hypot(*(holes[:, :2] - (x, y)).T).min() < 1.5
    assert length == pytest.approx(2 * np.pi * radius, rel=0.15)


def test_a_part_of_another_size_is_unknown_and_no_edge_of_it_is_blamed() -> None:
    T = resting(solids()["plate"], poses("plate")[0].R, 31.0, -17.0, 2.2)
    drawn = shape("plate", T)
    larger = shapely.affinity.scale(drawn, 1.06, 1.06, origin="centroid")
    (seen,) = look(picture([larger]))
    assert seen.part is None
    assert "nearest is plate" in seen.reason
    assert "would be" not in seen.reason


def test_blur_and_noise_cost_little() -> None:
    T = resting(solids()["elbow"], poses("elbow")[0].R, 31.0, -17.0, 0.9)
    for blur, noise in ((0.4, 0.0), (1.5, 4.0), (2.5, 8.0)):
        (seen,) = look(picture([shape("elbow", T)], blur_px=blur, noise=noise))
        assert_right(seen, "elbow", T, tolerance_mm=0.08)


def test_contrast_may_be_weak() -> None:
    T = resting(solids()["elbow"], poses("elbow")[0].R, 31.0, -17.0, 0.9)
    (seen,) = look(picture([shape("elbow", T)], ground=95.0, dark=12.0))
    assert_right(seen, "elbow", T)


@pytest.mark.parametrize("fading", [0.0, 0.15, 0.3, 0.45])
@pytest.mark.parametrize("size", [(12.0, 10.0, 10.0), (50.0, 30.0, 20.0)])
def test_a_table_that_fades_to_its_rim_hides_no_small_part(
    fading: float, size: tuple[float, float, float]
) -> None:
    small = solid_of(box(*size), "small")
    known = make_library([compile_solid(small)], CAMERA)
    T = resting(small, stable_poses(small)[0].R, 20.0, -15.0, 0.4)
    v, u = np.mgrid[0 : SIZE[1], 0 : SIZE[0]]
    light = 1 - fading * (((u - 400) / 400) ** 2 + ((v - 320) / 320) ** 2) / 2
    image = picture([silhouette(small.mesh, T, CAMERA)], noise=0.0) * light
    image += np.random.default_rng(3).normal(0, 2.0, image.shape)
    seen = recognise(np.clip(image, 0, 255).astype(np.uint8), CAMERA, known, "backlit").sightings
    assert [s.part for s in seen] == ["small"]
    assert (seen[0].x_mm, seen[0].y_mm) == pytest.approx((20.0, -15.0), abs=0.15)


@pytest.mark.parametrize("noise", [0.0, 1.5, 6.0])
@pytest.mark.parametrize("fading", [0.0, 0.3])
def test_an_empty_table_is_an_empty_answer(noise: float, fading: float) -> None:
    v, u = np.mgrid[0 : SIZE[1], 0 : SIZE[0]]
    light = 1 - fading * (((u - 400) / 400) ** 2 + ((v - 320) / 320) ** 2) / 2
    image = 210 * light + np.random.default_rng(4).normal(0, noise, light.shape)
    assert look(np.clip(image, 0, 255).astype(np.uint8)) == ()


def test_chips_and_dust_are_no_objects() -> None:
    specks = [shapely.Point(200 + 90 * i, 300).buffer(3 + 3 * i) for i in range(4)]
    assert look(picture(specks)) == ()
    # 12 px are 3.4 mm: above the smallest area it is an object, and none of ours
    (blob,) = look(picture([shapely.Point(400, 320).buffer(20)]))
    assert blob.part is None
    assert blob.area_mm2 == pytest.approx(np.pi * (20 * 0.28) ** 2, rel=0.02)


def test_two_parts_apart_are_two_answers_largest_first() -> None:
    T_plate = resting(solids()["plate"], poses("plate")[0].R, -45.0, 20.0, 0.3)
    T_nut = resting(solids()["nut"], poses("nut")[0].R, 50.0, -25.0, 1.0)
    first, second = look(picture([shape("plate", T_plate), shape("nut", T_nut)]))
    assert_right(first, "plate", T_plate)
    assert_right(second, "nut", T_nut)
    assert first.area_mm2 > second.area_mm2


def test_two_parts_that_touch_are_both_named() -> None:
    T_plate = resting(solids()["plate"], poses("plate")[0].R, -20.0, 0.0, 0.0)
    T_block = resting(solids()["block"], poses("block")[0].R, 35.0, 3.0, 0.0)
    seen = look(picture([shape("plate", T_plate), shape("block", T_block)]))
    plate, block = sorted(seen, key=lambda s: s.x_mm)
    assert_right(plate, "plate", T_plate, 0.05)
    assert_right(block, "block", T_block, 0.05)
    # 30 of the plate's 200 mm are against the block, and of the block's 160 (its hole apart)
    assert plate.free_share == pytest.approx(1 - 30 / (200 + 8 * np.pi), abs=0.05)
    assert block.free_share == pytest.approx(1 - 30 / 160, abs=0.05)
    assert [s.touching_count for s in seen] == [1, 1]
    assert not plate.is_cut
    assert not block.is_cut


def test_what_touches_a_known_part_and_is_none_stays_unknown() -> None:
    strange = solid_of(box(30, 24, 10) - rod(4, 40, 48), "strange")
    T_plate = resting(solids()["plate"], poses("plate")[0].R, -20.0, 0.0, 0.0)
    T_strange = resting(strange, np.eye(3), 25.0, 4.0, 0.0)
    blob = [shape("plate", T_plate), silhouette(strange.mesh, T_strange, CAMERA)]
    plate, other = sorted(look(picture(blob)), key=lambda s: s.x_mm)
    assert_right(plate, "plate", T_plate, 0.05)
    assert other.part is None
    assert (other.x_mm, other.y_mm) == pytest.approx((25.0, 4.0), abs=2.0)
    assert "touches known parts" in other.reason


@pytest.mark.parametrize("length_mm", [62.0, 75.0, 95.0])
def test_a_longer_part_is_not_a_known_one_with_something_beside_it(length_mm: float) -> None:
    longer = solid_of(box(length_mm, 30, 20), "longer")
    T = resting(longer, np.eye(3), 5.0, -5.0, 0.8)
    (seen,) = look(picture([silhouette(longer.mesh, T, CAMERA)]))
    assert seen.part is None


def test_parts_that_would_have_to_be_in_one_place_are_not_both_named() -> None:
    T_plate = resting(solids()["plate"], poses("plate")[0].R, -10.0, 0.0, 0.0)
    T_block = resting(solids()["block"], poses("block")[0].R, 30.0, 3.0, 0.0)
    seen = look(picture([shape("plate", T_plate), shape("block", T_block)]))
    assert {s.part for s in seen} != {"plate", "block"}


def test_a_strange_object_is_refused_with_what_came_nearest() -> None:
    strange = solid_of(box(60, 40, 10) - box(20, 12, 20).translate((20, 14, 0)), "strange")
    T = resting(strange, stable_poses(strange)[0].R, 10.0, 10.0, 0.5)
    (seen,) = look(picture([silhouette(strange.mesh, T, CAMERA)]))
    assert seen.part is None
    assert (seen.pose_index, seen.T_world_part, seen.R) == (-1, None, None)
    assert "plate" in seen.reason
    assert (seen.x_mm, seen.y_mm) == pytest.approx((10.0, 10.0), abs=3.0)


@pytest.mark.parametrize("size", [(54.5, 30, 20), (50, 33, 20), (47, 28.5, 20)])
def test_a_block_of_another_size_is_not_our_block(size: tuple[float, float, float]) -> None:
    other = solid_of(box(*size), "other")
    T = resting(other, np.eye(3), 5.0, -5.0, 0.8)
    (seen,) = look(picture([silhouette(other.mesh, T, CAMERA)]))
    assert seen.part is None


@pytest.mark.parametrize(("x", "y"), [(103.0, 0.0), (0.0, 88.0), (103.0, 84.0)])
def test_of_a_part_mostly_outside_the_picture_no_name_is_given(x: float, y: float) -> None:
    T = resting(solids()["block"], poses("block")[0].R, x, y, 0.3)
    (seen,) = look(picture([shape("block", T)]))
    assert seen.part is None
    assert "move it inwards" in seen.reason


@pytest.mark.parametrize(("x", "y"), [(94.0, 5.0), (-95.0, 0.0), (5.0, 72.0)])
def test_a_part_of_which_the_picture_shows_most_is_named_and_flagged(x: float, y: float) -> None:
    T = resting(solids()["plate"], poses("plate")[0].R, x, y, 0.3)
    (seen,) = look(picture([shape("plate", T)]))
    assert_right(seen, "plate", T, 0.08)
    assert seen.is_cut
    assert 0.6 < seen.free_share < 1.0


def test_a_part_half_off_the_glowing_area_is_asked_to_move_inwards() -> None:
    glowing = np.zeros(SIZE[::-1], dtype=bool)
    glowing[100:540, 150:650] = True
    image = picture([])
    T = resting(solids()["block"], poses("block")[0].R, 72.0, 0.0, 0.3)
    image = picture([shape("block", T)])
    image[~glowing] = 25
    (seen,) = look(image, usable=glowing)
    assert seen.part is None
    assert "move it inwards" in seen.reason
    T = resting(solids()["block"], poses("block")[0].R, 20.0, 0.0, 0.3)
    image = picture([shape("block", T)])
    image[~glowing] = 25
    (seen,) = look(image, usable=glowing)
    assert_right(seen, "block", T)


@pytest.mark.parametrize("theta", [0.0, 1.0, 2.5, -1.4])
@pytest.mark.parametrize("name", ["hand", "other_hand"])
def test_a_part_is_not_taken_for_its_mirror_image(name: str, theta: float) -> None:
    plate_down = next(p for p in poses(name) if abs(p.R[2, 2]) > 0.99)
    T = resting(solids()[name], plate_down.R, 15.0, -10.0, theta)
    (seen,) = look(picture([shape(name, T)]))
    assert_right(seen, name, T)
    assert seen.ambiguous_with == ()


@pytest.mark.parametrize("index", range(6))
def test_a_plain_block_is_not_ambiguous_with_itself_turned(index: int) -> None:
    T = resting(solids()["block"], poses("block")[index].R, 12.0, 7.0, 0.5)
    (seen,) = look(picture([shape("block", T)]))
    assert_right(seen, "block", T)
    assert seen.ambiguous_with == ()


def test_a_nut_is_not_ambiguous_with_itself_turned_by_a_sixth() -> None:
    T = resting(solids()["nut"], poses("nut")[1].R, 12.0, 7.0, 0.5)
    (seen,) = look(picture([shape("nut", T)]))
    assert_right(seen, "nut", T)
    assert seen.ambiguous_with == ()


@pytest.mark.parametrize("theta", [0.2, 1.9, -2.6])
def test_one_small_hole_decides_how_a_plate_is_turned(theta: float) -> None:
    # the hole is 1.2 % of the area: turned or turned over, 2.4 % of the pixels differ
    T = resting(solids()["plate"], poses("plate")[0].R, -30.0, 18.0, theta)
    (seen,) = look(picture([shape("plate", T)]))
    assert_right(seen, "plate", T)
    assert seen.ambiguous_with == ()


def test_a_rod_that_would_roll_on_is_seen_lying_all_the_same() -> None:
    round_bar = solid_of(rod(8, 60, 64), "bar")
    lying_down = next(p for p in stable_poses(round_bar) if p.rolling)
    known = make_library([compile_solid(round_bar)], CAMERA)
    T = resting(round_bar, lying_down.R, 10.0, 20.0, 0.6)
    image = picture([silhouette(round_bar.mesh, T, CAMERA)])
    (seen,) = recognise(image, CAMERA, known, "backlit").sightings
    assert seen.part == "bar"
    assert seen.T_world_part is not None
    axis = seen.T_world_part[:3, 2]
    assert abs(axis @ T[:3, 2]) == pytest.approx(1.0, abs=1e-5)
    assert (seen.x_mm, seen.y_mm) == pytest.approx((10.0, 20.0), abs=0.1)


# --- where silhouettes cannot decide ------------------------------------------------------------


LAMPS = (
    PointLamp.ring("ring", np.array([0.0, 0, 690]), np.array([0.0, 0, -1]), 60.0, count=2),
    PointLamp("side", np.array([[400.0, 350, 450]])),
)


@cache
def pocketed() -> tuple[Solid, Library]:
    solid = solid_of(box(60, 40, 12) - box(16, 10, 8).translate((15, 8, 6)), "pocket")
    return solid, make_library([compile_solid(solid)], CAMERA)


def test_lamps_tell_where_a_pocket_is_that_the_outline_does_not_show() -> None:
    theta = 2.6
    solid, known = pocketed()
    up = next(p for p in stable_poses(solid) if p.R[2, 2] > 0.99)
    T = resting(solid, up.R, 12.0, -8.0, theta)
    shots = Renderer(Scene(placed(solid.mesh, T), None, TABLE), CAMERA, seed=2)
    backlit, lit = shots.backlit(), [shots.lit(lamp) for lamp in LAMPS]

    (dark,) = recognise(backlit, CAMERA, known, "backlit").sightings
    # four readings put other surfaces in the same outline: two sides up, two turns
    assert dark.part == "pocket"
    assert len(dark.ambiguous_with) == 3

    (seen,) = recognise(backlit, CAMERA, known, "backlit", lit=lit).sightings
    assert seen.pose_index == up.index
    assert seen.T_world_part == pytest.approx(T, abs=0.05)
    assert seen.ambiguous_with == ()


def test_a_small_blind_hole_makes_two_readings_of_one_outline() -> None:
    # of all the surface 2 %, and no outline shows it; but it decides where a finger may go
    dimple = solid_of(box(60, 40, 12) - rod(2.5, 8, 24).translate((18, 8, 6)), "dimple")
    known = make_library([compile_solid(dimple)], CAMERA)
    up = next(p for p in stable_poses(dimple) if p.R[2, 2] > 0.99)
    T = resting(dimple, up.R, 5.0, 5.0, 0.4)
    image = picture([silhouette(dimple.mesh, T, CAMERA)])
    (seen,) = recognise(image, CAMERA, known, "backlit").sightings
    assert len(seen.ambiguous_with) == 3


@cache
def two_hubs() -> tuple[Solid, Library]:
    # one hub is wider, the other one higher; their outlines from above differ by nothing
    disc = rod(50, 15, 96) - rod(15, 40, 64)
    for angle in np.arange(4) * np.pi / 2:
        bolt = np.array([40.0 * np.cos(angle), 40.0 * np.sin(angle), 0.0])
        disc -= rod(7, 40, 48).translate(bolt)
    wide = (rod(28, 1.5, 96) - rod(15, 40, 64)).translate((0, 0, 8.25))
    high = (rod(25, 3.25, 96) - rod(15, 40, 64)).translate((0, 0, -9.125))
    solid = solid_of(disc + wide + high, "two hubs")
    return solid, make_library([compile_solid(solid)], CAMERA)


@pytest.mark.parametrize("off_mm", [-0.1, 0.1])
@pytest.mark.parametrize("is_wide_up", [True, False])
def test_the_size_of_a_part_does_not_decide_on_which_side_it_lies(
    off_mm: float, is_wide_up: bool
) -> None:
    solid, known = two_hubs()
    up = next(p for p in stable_poses(solid) if p.R[2, 2] * (1 if is_wide_up else -1) > 0.99)
    T = resting(solid, up.R, 12.0, -8.0, 0.7)
    larger = solid.mesh.copy()
    larger.apply_scale(1.0 + off_mm / 100.0)
    shots = Renderer(Scene(placed(larger, T), None, TABLE), CAMERA, seed=4)
    rng = np.random.default_rng(3)
    lit = [soiled(shots.lit(lamp), rng) for lamp in LAMPS]
    (seen,) = recognise(shots.backlit(), CAMERA, known, "backlit", lit=lit).sightings
    assert seen.pose_index == up.index
    assert seen.ambiguous_with == ()


def soiled(picture: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return a picture of a part that has spots of oil, dust and the marks of a tool on it."""
    v, u = np.mgrid[: picture.shape[0], : picture.shape[1]]
    film = np.ones(picture.shape)
    for _ in range(40):
        at, size_px = rng.uniform(0, picture.shape[::-1]), rng.uniform(8, 30)
        film[np.hypot(u - at[0], v - at[1]) < size_px] *= rng.uniform(0.85, 1.15)
    marks = 1.0 + 0.04 * np.sin(0.9 * u + 0.4 * v) + rng.normal(0.0, 0.01, picture.shape)
    return np.clip(picture * film * marks, 0, 255).astype(np.uint8)


def test_a_pocket_that_lies_face_down_leaves_two_turns_that_no_lamp_can_tell() -> None:
    solid, known = pocketed()
    down = next(p for p in stable_poses(solid) if p.R[2, 2] < -0.99)
    T = resting(solid, down.R, 12.0, -8.0, 0.7)
    shots = Renderer(Scene(placed(solid.mesh, T), None, TABLE), CAMERA, seed=3)
    lit = [shots.lit(lamp) for lamp in LAMPS]
    (seen,) = recognise(shots.backlit(), CAMERA, known, "backlit", lit=lit).sightings
    assert seen.pose_index == down.index
    (other,) = seen.ambiguous_with
    assert other.pose_index == down.index
    turn = (other.theta_rad - seen.theta_rad) % (2 * np.pi)
    assert turn == pytest.approx(np.pi, abs=0.01)


def test_a_part_too_large_for_the_picture_is_refused_by_name() -> None:
    # the picture shows 224 x 179 mm of the table
    with pytest.raises(CadError, match=r"rail: 240 mm long.*does not fit"):
        make_library([compile_solid(solid_of(box(240, 30, 10), "rail"))], CAMERA)
    assert make_library([compile_solid(solid_of(box(150, 100, 10), "sheet"))], CAMERA).entries


def tower() -> Body:
    """A block on end, with a step on one side: its top hides its foot, and leans outwards."""
    return box(30, 26, 110).translate((0, 0, 55)) + box(14, 12, 96).translate((0, 16, 48))


def wide() -> Camera:
    """The same camera with a lens that sees 560 x 450 mm of the table."""
    K = CAMERA.K.copy()
    K[[0, 1], [0, 1]] /= 2.5
    return Camera(CAMERA.size_px, K, CAMERA.distortion, CAMERA.T_world_cam)


@cache
def tower_library() -> tuple[Solid, Library]:
    solid = solid_of(tower(), "tower")
    return solid, make_library([compile_solid(solid)], wide())


@pytest.mark.parametrize("away_mm", [0.0, 35.0, 70.0, 105.0])
@pytest.mark.parametrize("side_deg", [0, 50, 160, 265])
def test_a_tall_part_is_known_between_the_places_its_views_were_made_for(
    away_mm: float, side_deg: int
) -> None:
    solid, known = tower_library()
    side = np.radians(side_deg)
    foot = wide().position_mm[:2] + away_mm * np.array([np.cos(side), np.sin(side)])
    T = resting(solid, np.eye(3), float(foot[0]), float(foot[1]), 1.3 * side + 0.4)
    seen = recognise(picture([silhouette(solid.mesh, T, wide())]), wide(), known, "backlit")
    (sighting,) = seen.sightings
    assert sighting.part == "tower", sighting.reason
    assert sighting.T_world_part is not None
    off = transform(sighting.T_world_part, solid.mesh.vertices) - transform(T, solid.mesh.vertices)
    assert np.abs(off).max() < 0.2


def lit_tower(T: Array) -> NDArray[np.uint8]:
    """A tower under lamps: its tops bright, its walls dim, the table dark."""
    tops = [
        [(15, -13, 110), (15, 13, 110), (-15, 13, 110), (-15, -13, 110)],
        [(7, 10, 96), (7, 22, 96), (-7, 22, 96), (-7, 10, 96)],
    ]
    whole = coverage(silhouette(tower_library()[0].mesh, T, wide()), SIZE)
    low, high = (
        coverage(shapely.Polygon(wide().project(transform(T, np.array(top, float)))), SIZE)
        for top in reversed(tops)
    )
    grey = 40.0 + 45.0 * whole
    grey += (150.0 - grey) * low
    grey += (170.0 - grey) * high
    grey = cv2.GaussianBlur(grey, (0, 0), 0.7)
    grey += np.random.default_rng(1).normal(0.0, 0.5, grey.shape)
    return np.asarray(np.clip(np.round(grey), 0, 255), dtype=np.uint8)


@pytest.mark.parametrize("source", ["outline", "edges"])
def test_under_lamps_an_outline_leads_to_edges_that_are_farther_off_than_each_other(
    source: str,
) -> None:
    solid, known = tower_library()
    at = wide().position_mm[:2] + np.array([60.0, -40.0])
    T = resting(solid, np.eye(3), float(at[0]), float(at[1]), 0.9)
    grey = lit_tower(T)
    (region,) = segment(grey, "front").regions
    scene = TableScene((grey,), wide(), known, is_backlit=False)
    cutout = ObjectCutout(region, scene)
    (upright,) = [p.index for p in known.entries[0].poses if np.allclose(p.R, np.eye(3))]
    off_mm = []
    for side in np.radians(range(0, 360, 60)):
        x, y = at + 6.5 * np.array([np.cos(side), np.sin(side)])
        candidate = Candidate(0, upright, 0.9, float(x), float(y), 0.97, 0.1, 3.0, source=source)
        found = weigh([candidate], cutout, scene.search)
        off_mm.append(float(np.linalg.norm(found[0].place_mm - at)) if found else np.inf)
    # edges say where they are; what a silhouette says is off by as much as the part leans
    assert (max(off_mm) < 0.3) == (source == "outline")
