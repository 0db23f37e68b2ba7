"""The index of views: an outline made anywhere on the table finds its own part, pose and turn."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest
from fitting_bodies import about_z, anywhere, dense, model, solid
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from table_pictures import overhead, resting

from controller.cad import (
    CadError,
    PartSymmetry,
    StablePose,
    outline,
    part_symmetries,
    stable_poses,
)
from controller.cad.compiled import CompiledPart, compile_solid
from controller.imaging import Camera
from controller.recognition.library import (
    CameraPlace,
    Candidate,
    Library,
    PartViews,
    Silhouette,
    ViewIndex,
    make_entry,
    make_library,
    place_of,
    polar_grid,
    pose_on_table,
    station_of,
    turn_of,
    turns_that_keep,
    view_part,
)

Array = NDArray[np.float64]
CAMERA = overhead()
STATION = station_of(CAMERA)
BODIES = ("block", "elbow", "plate", "nut", "stepped", "hand", "wedge", "square_bar", "disc")
REACH_MM = 3.0  # a fit begins within 5 mm
# an outline of each that no turn, no other pose and no other of these parts has
OWN = (("elbow", 0), ("elbow", 1), ("plate", 0), ("hand", 0), ("wedge", 2))


@cache
def poses(name: str) -> tuple[StablePose, ...]:
    return stable_poses(solid(name))


@cache
def compiled(name: str) -> CompiledPart:
    return compile_solid(solid(name))


@cache
def views(name: str) -> PartViews:
    lasting = tuple(p for p in poses(name) if p.is_distinct)
    return view_part(solid(name), lasting, model(name).caster, STATION)


@cache
def index() -> ViewIndex:
    return ViewIndex([views(name) for name in BODIES], CAMERA.position_mm)


def silhouette_of(name: str, T: Array) -> Silhouette:
    """A posed part's outline, through the lens and back to the table plane."""
    loops = tuple(
        CAMERA.on_plane(dense(loop.points, 0.8))[:, :2]
        for loop in outline(solid(name), T, CAMERA).loops
    )
    grid, centroid, area = polar_grid(loops)
    perimeter = sum(
        float(np.linalg.norm(np.diff(p, axis=0, append=p[:1]), axis=1).sum()) for p in loops
    )
    return Silhouette(area, perimeter, centroid, grid)


def search(name: str, pose: int, x: float, y: float, theta: float) -> list[Candidate]:
    T = resting(solid(name), poses(name)[pose].R, x, y, theta)
    return index().search(silhouette_of(name, T))


def gap(a_rad: float, b_rad: float) -> float:
    return abs((a_rad - b_rad + np.pi) % (2 * np.pi) - np.pi)


places = st.tuples(st.floats(-55, 55), st.floats(-40, 40), st.floats(-np.pi, np.pi))


@settings(max_examples=10, deadline=None, derandomize=True)
@given(which=st.sampled_from(OWN), place=places)
def test_an_outline_finds_its_own_part_pose_turn_and_place_first(
    which: tuple[str, int], place: tuple[float, float, float]
) -> None:
    name, pose = which
    x, y, theta = place
    found = search(name, pose, x, y, theta)
    best = max(c.overlap for c in found)
    # others may come as near, as the same plate turned over, but none nearer
    mine = [
        c
        for c in found
        if BODIES[c.part] == name
        and gap(c.theta_rad, theta) < np.radians(3.0)
        and c.pose in (poses(name)[pose].index, poses(name)[pose].same_as)
    ]
    assert mine
    assert mine[0].overlap > best - 0.01
    assert BODIES[found[0].part] == name
    assert (mine[0].x_mm, mine[0].y_mm) == pytest.approx((x, y), abs=REACH_MM)
    assert [c.overlap for c in found] == sorted((c.overlap for c in found), reverse=True)
    assert all(0.0 <= c.overlap <= 1.0 + 1e-6 for c in found)


@pytest.mark.parametrize("name", BODIES)
def test_every_likely_way_of_every_part_is_among_the_best_at_its_place(name: str) -> None:
    for k in (i for i, pose in enumerate(poses(name)) if pose.probability > 0.05):
        x, y = 38.0 - 17 * k, -30.0 + 11 * k
        found = search(name, k, x, y, 0.9 * k)
        # a bar's side and a nut's are rectangles alike: those that come near are all offered
        mine = [c for c in found if BODIES[c.part] == name and c.overlap > found[0].overlap - 0.06]
        off = [float(np.hypot(c.x_mm - x, c.y_mm - y)) for c in mine]
        assert min(off, default=np.inf) < REACH_MM


@pytest.mark.parametrize("place", [(0.0, 30.0), (0.0, 40.0), (0.0, 50.0)])
def test_a_plate_on_end_is_proposed_wherever_it_stands(place: tuple[float, float]) -> None:
    on_end = next(k for k, p in enumerate(poses("plate")) if p.com_height_mm > 25)
    assert any(BODIES[c.part] == "plate" for c in search("plate", on_end, *place, 0.0))


def test_a_block_is_offered_in_both_the_turns_it_fits_in() -> None:
    pose = next(i for i, p in enumerate(poses("block")) if abs(p.R[2, 2]) > 0.99)
    found = [c for c in search("block", pose, 0.0, 0.0, 0.5) if BODIES[c.part] == "block"]
    same = [c for c in found if c.pose == poses("block")[pose].index]
    turns = sorted(gap(c.theta_rad, 0.5) for c in same)
    assert len(turns) == 2
    assert turns[0] < 0.03
    assert turns[1] == pytest.approx(np.pi, abs=0.03)


def test_what_is_as_large_as_the_picture_finds_nothing() -> None:
    sheet = dense(np.array([[0.0, 0], [180, 0], [180, 120], [0, 120]]), 0.5)
    grid, centroid, area = polar_grid((sheet,))
    assert area == pytest.approx(180 * 120, rel=1e-3)
    assert index().search(Silhouette(area, 600.0, centroid, grid)) == []


def test_what_is_twice_as_large_is_not_taken_for_a_part() -> None:
    T = resting(solid("elbow"), poses("elbow")[0].R, 10.0, 5.0, 0.3)
    seen = silhouette_of("elbow", T)
    large = replace(seen, area_mm2=4 * seen.area_mm2, perimeter_mm=2 * seen.perimeter_mm)
    assert all(BODIES[c.part] != "elbow" for c in index().search(large))


def only_from(views_of: PartViews, at: int) -> PartViews:
    """One view of a part alone."""
    return PartViews(
        **{field.name: getattr(views_of, field.name)[at : at + 1] for field in fields(PartViews)}
    )


@pytest.mark.parametrize("side", [0, 90, 180, 270])
def test_a_view_of_a_tall_part_speaks_for_its_own_side_alone(side: int) -> None:
    # a square bar on end: four turns leave it as it is. One view has it lie to the right of the
    # point below the camera, leaning outwards; a bar to another side is that view turned there,
    # and by none of the other three turns
    made = views("square_bar")
    standing = next(p for p in poses("square_bar") if p.com_height_mm > 30)
    on_right = (made.pose == standing.index) & (np.abs(made.place_mm[:, 1]) < 1e-6)
    at = int(np.where(on_right, made.place_mm[:, 0], 0.0).argmax())  # on the outer ring
    assert np.isfinite(made.ring_mm[at])
    alone = ViewIndex([only_from(made, at)], CAMERA.position_mm)
    x, y = 70 * np.cos(np.radians(side)), 70 * np.sin(np.radians(side))
    eye = CAMERA.position_mm
    T = resting(solid("square_bar"), standing.R, x + eye[0], y + eye[1], 0.0)
    (found,) = alone.search(silhouette_of("square_bar", T), within=0.5)
    assert gap(found.theta_rad, np.radians(side)) < np.radians(3.0)
    # the rule is what leaves one: a view that spoke for everywhere would offer others
    heedless = replace(only_from(made, at), ring_mm=np.array([np.inf]))
    free = ViewIndex([heedless], CAMERA.position_mm)
    assert len(free.search(silhouette_of("square_bar", T), within=0.5)) > 1


@pytest.mark.parametrize("name", ["square_bar", "hand", "stepped"])
@pytest.mark.parametrize("place", [(60.0, 0.0), (-45.0, 40.0), (0.0, -50.0), (3.0, 2.0)])
def test_a_tall_part_is_placed_though_its_outline_leans_outwards(
    name: str, place: tuple[float, float]
) -> None:
    tall = next(i for i, p in enumerate(poses(name)) if (views(name).pose == p.index).sum() > 1)
    T = resting(solid(name), poses(name)[tall].R, *place, 0.7)
    found = ViewIndex([views(name)], CAMERA.position_mm).search(silhouette_of(name, T))
    off = [float(np.hypot(c.x_mm - place[0], c.y_mm - place[1])) for c in found]
    assert min(off, default=np.inf) < REACH_MM


def test_views_are_shadows_cast_from_the_cameras_place() -> None:
    # a block straight below: the shadow of its upper face, grown by the camera's height over it
    made = views("block")
    eye = STATION.eye_mm
    for pose in (p for p in poses("block") if p.index in made.pose):
        upright = np.abs(pose.R @ np.diag([50.0, 30.0, 20.0])).max(axis=1)
        (at,) = np.flatnonzero((made.pose == pose.index) & (np.abs(made.place_mm).max(axis=1) == 0))
        grown = eye / (eye - upright[2])
        assert made.area_mm2[at] == pytest.approx(upright[0] * upright[1] * grown**2, rel=0.02)
        assert made.centroid_mm[at] == pytest.approx([0, 0], abs=0.3)


def test_a_views_perimeter_is_that_of_the_shadow() -> None:
    made = views("block")
    eye = STATION.eye_mm
    for pose in (p for p in poses("block") if p.index in made.pose):
        upright = np.abs(pose.R @ np.diag([50.0, 30.0, 20.0])).max(axis=1)
        (at,) = np.flatnonzero((made.pose == pose.index) & (np.abs(made.place_mm).max(axis=1) == 0))
        sides = 2 * (upright[0] + upright[1]) * eye / (eye - upright[2])
        assert made.perimeter_mm[at] == pytest.approx(sides, rel=0.03)


def test_a_round_views_perimeter_is_nearly_that_of_the_shadow() -> None:
    flat = views("disc")
    round_ones = flat.area_mm2 > 900
    wide = 2 * np.sqrt(np.pi * flat.area_mm2[round_ones])
    assert flat.perimeter_mm[round_ones] == pytest.approx(wide, rel=0.12)


def test_a_flat_part_needs_one_view_and_a_tall_one_rings_of_them() -> None:
    def count(name: str, height: float) -> int:
        pose = next(p for p in poses(name) if 2 * p.com_height_mm == pytest.approx(height))
        return int((views(name).pose == pose.index).sum())

    assert count("disc", 10.0) == 1 + 8  # 10 mm are 2.2 mm of shift in the corner, of 40: 5.5 %
    assert count("square_bar", 70.0) == 1 + 8 + 16
    low = CameraPlace(eye_mm=2000.0, reach_mm=150.0)
    assert len(view_part(solid("disc"), poses("disc")[:1], model("disc").caster, low).pose) == 1


def test_a_part_as_tall_as_the_camera_is_refused() -> None:
    with pytest.raises(ValueError, match=r"square_bar: 70 mm tall, up to the camera"):
        view_part(
            solid("square_bar"),
            tuple(p for p in poses("square_bar") if p.com_height_mm > 30),
            model("square_bar").caster,
            CameraPlace(75.0, 30.0),
        )
    with pytest.raises(CadError, match="use another camera or a smaller part"):
        make_entry(compiled("elbow"), CameraPlace(10.0, 30.0))


# --- turns --------------------------------------------------------------------------------------


@cache
def symmetry(name: str) -> PartSymmetry:
    return part_symmetries(solid(name))


def kept_turns(name: str, upwards: Array) -> Array:
    """Turns that keep a part lying so that a direction of its own points up."""
    up = np.asarray(upwards, dtype=float)
    aside = np.cross(up, [0.3, 0.5, 0.8])
    aside /= np.linalg.norm(aside)
    R = np.vstack([aside, np.cross(up, aside), up])
    return turns_that_keep(R, symmetry(name))


def degrees(turns: Array) -> list[float]:
    return sorted(round(float(np.degrees(t)) % 360, 3) % 360 for t in turns)


@pytest.mark.parametrize(
    ("name", "up", "expected"),
    [
        ("square_bar", (0, 0, 1), [0, 90, 180, 270]),
        ("square_bar", (1, 0, 0), [0, 180]),
        ("nut", (0, 0, 1), [0, 60, 120, 180, 240, 300]),
        ("nut", (0, 0, -1), [0, 60, 120, 180, 240, 300]),
        ("block", (0, 0, 1), [0, 180]),
        ("elbow", (0, 0, 1), [0]),
        ("hand", (0, 0, 1), [0]),
        pytest.param("disc", (1, 0, 0), [0, 180]),
        pytest.param("disc", (0.6, 0.8, 0), [0, 180]),
        ("disc", (0, 0, 1), []),
        ("stepped", (0, 0, -1), []),
        ("stepped", (1, 0, 0), [0]),
    ],
)
def test_turns_that_keep_a_pose_are_those_of_its_symmetry(
    name: str, up: tuple[int, int, int], expected: list[int]
) -> None:
    turns = kept_turns(name, np.array(up))
    assert degrees(turns) == pytest.approx(expected, abs=0.01)
    if expected:
        assert turns[0] == pytest.approx(0.0, abs=1e-9)


@settings(max_examples=20, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10**6), angle=st.floats(-np.pi, np.pi))
def test_a_turn_about_the_vertical_is_read_back(seed: int, angle: float) -> None:
    R = anywhere(seed)
    T = np.eye(4)
    T[:3, :3] = about_z(angle) @ R
    assert gap(turn_of(R, T), angle) < 1e-9


@settings(max_examples=20, deadline=None, derandomize=True)
@given(which=st.sampled_from(("elbow", "hand", "wedge")), place=places)
def test_a_lying_part_stands_on_the_table_over_its_place(
    which: str, place: tuple[float, float, float]
) -> None:
    for pose in poses(which):
        T = pose_on_table(solid(which), pose, *place)
        assert pytest.approx(resting(solid(which), pose.R, *place), abs=0.02) == T
        assert gap(turn_of(pose.R, T), place[2]) < 1e-9


# --- the library --------------------------------------------------------------------------------


@cache
def small_library() -> Library:
    return make_library([compiled("elbow"), compiled("nut")], CAMERA)


def test_a_parts_edges_are_made_when_asked_for_and_then_kept() -> None:
    library = small_library()
    nut = library.model(1)
    elbow = library.model(0)
    assert library.model(1) is nut
    assert library.model(0) is elbow
    # a part's edges run within its own reach
    reach = np.linalg.norm(np.asarray(solid("nut").mesh.vertices), axis=1).max()
    assert np.linalg.norm(nut.start_mm, axis=1).max() == pytest.approx(reach)


def test_a_library_lists_each_way_to_lie_once() -> None:
    library = small_library()
    elbow, nut = library.entries
    # a nut on its one face or the other is the same to see; so is on any of its six sides
    assert len(nut.poses) == 2
    assert {len(nut.turns_of(p.index)) for p in nut.poses} == {6, 2}
    assert library.edgelet_views == tuple(
        (number, pose.index) for number, entry in enumerate((elbow, nut)) for pose in entry.poses
    )
    T = pose_on_table(solid("elbow"), elbow.poses[0], 12.0, -7.0, 0.4)
    assert place_of(elbow, T) == pytest.approx([12.0, -7.0])
    for pose in elbow.poses:
        assert elbow.pose(pose.index) is pose


def test_a_new_calibration_of_the_same_camera_is_the_same_station() -> None:
    moved = np.array(CAMERA.T_world_cam)
    moved[:3, 3] += [1.3, -0.8, 0.9]
    assert station_of(Camera(CAMERA.size_px, CAMERA.K, CAMERA.distortion, moved)) == STATION
    assert STATION.eye_mm == pytest.approx(700.0)
    # half the diagonal of 224 x 179 mm, the camera's tilt, rounded up
    assert 143 < STATION.reach_mm <= 180


def test_a_part_longer_than_the_picture_is_wide_is_refused() -> None:
    elbow = compiled("elbow")
    assert make_library([elbow], CAMERA).entries
    near = np.array(CAMERA.T_world_cam)
    near[2, 3] = 120.0
    close = Camera(CAMERA.size_px, CAMERA.K, CAMERA.distortion, near)
    with pytest.raises(CadError, match=r"elbow: 60 mm long.*does not fit"):
        make_library([elbow], close)
