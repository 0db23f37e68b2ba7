"""Held parts with known truth: what is changed is what truth says, and nothing else."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from trace_held import DEFECTS, kind_of, scaled
from trace_held_defects import (
    AS_BUILT_MM,
    AS_BUILT_SHARE,
    NoPlaceError,
    as_built,
    mesh_of,
    tolerance_mm,
    with_defect,
)
from trace_held_hold import disturbed, find_grasps
from trace_held_light import smooth_normals, stained
from trace_held_parts import FAMILIES, HeldPart, drawn, is_plain, rod, triangles_of
from trace_held_sensor import TRAPS, develop, shifted

Array = NDArray[np.float64]
HAND = {
    "finger_mm": [6.0, 10.0, 36.0],
    "tip_mm": 6.0,
    "palm_side_mm": 15.0,
    "palm_half_mm": [16.0, 14.0],
    "min_contact_mm2": 14.0,
}


@pytest.fixture(scope="module")
def plate() -> HeldPart:
    return drawn("plate", 3)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_drawn_part_is_one_closed_solid_whose_holes_are_where_they_are_said(family: str) -> None:
    part = drawn(family, 5)
    body = part.build()
    assert len(body.decompose()) == 1
    for hole in part.holes:
        if family == "hub" and hole.id == "bore":
            continue  # a keyway is cut into its wall
        without = part.build({hole.id: None})
        lost = np.pi / 4 * hole.diameter_mm**2 * hole.depth_mm
        assert (without - body).volume() == pytest.approx(lost, rel=1e-3)
        assert is_plain(body, hole)


def test_a_round_wall_in_facets_has_the_area_of_the_circle() -> None:
    low, high = np.zeros(3), np.array([0.0, 0, 10])
    assert rod(low, high, 8.0, 0.001).volume() == pytest.approx(np.pi * 16 * 10, rel=1e-9)


def test_a_cad_file_has_its_corners_on_the_circle() -> None:
    triangles = triangles_of(rod(np.zeros(3), np.array([0.0, 0, 10]), 8.0, 0.004))
    assert np.hypot(*triangles.reshape(-1, 3)[:, :2].T).max() == pytest.approx(4.0, abs=1e-9)


def test_parts_as_built_stay_within_their_share_of_the_tolerance(plate: HeldPart) -> None:
    nominal = {hole.id: hole for hole in plate.holes}
    size = np.ptp(np.array(plate.build().bounding_box()).reshape(2, 3), axis=0)
    for seed in range(5):
        built = as_built(plate, np.random.default_rng(seed))
        assert (np.abs(np.ptp(scaled(mesh_of(built.body), built).bounds, axis=0) - size)).max() < (
            AS_BUILT_MM + 1e-6
        )
        for name, hole in built.holes.items():
            assert hole is not None
            limit = AS_BUILT_SHARE * tolerance_mm(nominal[name].diameter_mm)
            assert abs(hole.diameter_mm - nominal[name].diameter_mm) <= limit
            assert np.linalg.norm(hole.mouth_mm - nominal[name].mouth_mm) <= 0.06


@pytest.mark.parametrize(("mm", "expected"), [(3.0, 0.1), (6.0, 0.1), (6.5, 0.2), (31.0, 0.3)])
def test_the_tolerances_are_those_of_the_standard(mm: float, expected: float) -> None:
    # ISO 2768-1, table 1, class m
    assert tolerance_mm(mm) == expected


LOCAL = ("hole_missing", "hole_position", "hole_small", "chip", "burr", "dent", "pit", "scratch")


@pytest.mark.parametrize("kind", LOCAL)
def test_a_defect_changes_the_solid_at_its_place_and_nowhere_else(
    kind: str, plate: HeldPart
) -> None:
    built = with_defect(plate, kind, np.random.default_rng(8))
    changed = (built.body - built.sound) + (built.sound - built.body)
    points = triangles_of(changed).reshape(-1, 3)
    reach = max(built.truth["size_mm"], 12.0 if kind == "burr" else 0.0) + 1.0
    if kind.startswith("hole"):
        reach += max(hole.depth_mm + hole.diameter_mm for hole in plate.holes)
    away = np.linalg.norm(points - np.array(built.truth["place_mm"]), axis=1)
    assert away.max() < reach
    widest = max(hole.diameter_mm for hole in plate.holes) if kind.startswith("hole") else 0.0
    assert away.min() < 1.5 + built.truth["size_mm"] + widest / 2


def test_metal_is_added_or_lost_as_the_defect_says(plate: HeldPart) -> None:
    for seed in range(3):
        for kind, sign in (("chip", -1), ("dent", -1), ("pit", -1), ("scratch", -1), ("burr", 1)):
            built = with_defect(plate, kind, np.random.default_rng(seed))
            gain = built.body.volume() - built.sound.volume()
            assert np.sign(gain) == sign, kind


def test_a_wrong_diameter_is_beyond_the_tolerance_and_is_what_is_cut(plate: HeldPart) -> None:
    for kind in ("hole_small", "hole_large"):
        built = with_defect(plate, kind, np.random.default_rng(2))
        (name,) = built.truth["faces"]
        hole = next(h for h in plate.holes if h.id == name)
        now = built.holes[name]
        assert now is not None
        assert abs(now.diameter_mm - hole.diameter_mm) > tolerance_mm(hole.diameter_mm)
        assert now.diameter_mm == pytest.approx(built.truth["dims"]["true_d"])
        filled = replace(now, diameter_mm=now.diameter_mm + 0.02)
        cut = plate.build({**built.holes, name: None}) - plate.build({**built.holes, name: filled})
        assert cut.volume() == pytest.approx(
            np.pi / 4 * filled.diameter_mm**2 * hole.depth_mm, rel=1e-3
        )


def test_a_part_that_is_its_own_mirror_image_cannot_be_mirrored() -> None:
    disk = replace(drawn("hub", 1), holes=(), steps=drawn("hub", 1).steps[:1])
    with pytest.raises(NoPlaceError, match="mirror"):
        with_defect(disk, "mirrored", np.random.default_rng(1))


def test_grasps_touch_the_part_from_both_sides_and_do_not_run_into_it(plate: HeldPart) -> None:
    body = mesh_of(plate.build())
    for grasp in find_grasps(body, HAND, np.random.default_rng(4)):
        assert grasp.contact_mm2 >= HAND["min_contact_mm2"]
        assert abs(grasp.closing @ grasp.approach) < 1e-9
        for box in grasp.boxes:
            local = np.abs((body.vertices - box.T[:3, 3]) @ box.T[:3, :3])
            assert not (local < box.half_mm - 0.06).all(axis=1).any()
        one, other = grasp.boxes[:2]
        gap = abs((one.T[:3, 3] - other.T[:3, 3]) @ grasp.closing) - one.half_mm[0] * 2
        assert gap == pytest.approx(grasp.width_mm)


def test_a_pose_is_disturbed_by_no_more_than_is_said() -> None:
    rng = np.random.default_rng(3)
    pivot = np.array([10.0, 20.0, 30.0])
    for _ in range(50):
        T = disturbed(np.eye(4), pivot, 1.2, 1.3, rng)
        turned = np.degrees(np.arccos(np.clip((np.trace(T[:3, :3]) - 1) / 2, -1, 1)))
        moved = np.linalg.norm(T[:3, :3] @ pivot + T[:3, 3] - pivot)
        assert turned <= 1.3 + 1e-9
        assert moved <= 1.2 + 1e-9
        assert T[:3, :3] @ T[:3, :3].T == pytest.approx(np.eye(3), abs=1e-12)


def test_a_round_wall_is_shaded_as_round_and_its_rim_stays_sharp() -> None:
    triangles = triangles_of(rod(np.zeros(3), np.array([0.0, 0, 10]), 8.0, 0.02))
    normals = smooth_normals(triangles).reshape(-1, 3)
    points = triangles.reshape(-1, 3)
    is_wall = np.abs(normals[:, 2]) < 0.5
    radial = points[is_wall, :2] / np.linalg.norm(points[is_wall, :2], axis=1, keepdims=True)
    assert (normals[is_wall, :2] * radial).sum(axis=1).min() > 0.99999
    assert np.abs(normals[~is_wall, 2]).min() == pytest.approx(1.0)


def test_a_stain_dims_what_lies_in_it_only(plate: HeldPart) -> None:
    stain = with_defect(plate, "stain", np.random.default_rng(5)).stain
    assert stain is not None
    points = np.array([[stain.centres_mm[0], stain.centres_mm[0] + 50.0]])
    factor = stained(stain, points)
    assert factor[0, 0] == pytest.approx(stain.factor)
    assert factor[0, 1] == 1.0


def test_of_twelve_specimens_four_are_good_and_every_kind_comes() -> None:
    kinds = [kind_of(n) for n in range(12 * len(DEFECTS))]
    assert [sum(k[0] == c for k in kinds[:12]) for c in ("good", "defect", "trap")] == [4, 6, 2]
    assert {k for c, k in kinds if c == "defect"} == set(DEFECTS)
    assert {k for c, k in kinds if c == "trap"} > set(TRAPS)


def test_pictures_have_the_noise_that_truth_tells() -> None:
    sensor = {"blur_px": 0.7, "vignette": 0.0, "read": 1.0, "shot": 0.01, "veil": 0.0, "drift": 0.0}
    light = np.full((200, 300), 0.5, np.float32)
    grey = develop(light, 1.0, sensor, np.random.default_rng(1)).astype(float)
    # variance of the sensor, and of rounding to whole greys
    assert grey.var() == pytest.approx(1.0 + 0.01 * 127.5 + 1 / 12, rel=0.05)
    assert grey.mean() == pytest.approx(127.5, abs=0.05)


def test_shifted_pictures_leave_the_backlit_one_alone() -> None:
    rng = np.random.default_rng(1)
    view = {
        lamp: rng.integers(0, 255, (60, 80)).astype(np.uint8)
        for lamp in ("backlight", "ring", "side")
    }
    before = {lamp: picture.copy() for lamp, picture in view.items()}
    shifted([view], rng)
    assert (view["backlight"] == before["backlight"]).all()
    assert (view["ring"] != before["ring"]).any()
