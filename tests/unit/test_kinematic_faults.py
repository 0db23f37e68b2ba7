"""Faults of commissioning get their right name, and a good cell gets none."""

from __future__ import annotations

from dataclasses import replace

import kinematic_cells as cells
import numpy as np
import pytest

from controller.calibration.kinematics import (
    BoardPicture,
    KinematicsFault,
    Play,
    calibrate_and_prove,
    calibrate_cell,
    find_faults,
)

COUNT = 12  # pictures of the plate per camera


def faults(pictures: list[BoardPicture], **others: object) -> tuple[KinematicsFault, ...]:
    prior = cells.prior()
    return find_faults(prior, pictures, calibrate_cell(prior, pictures), **others)  # type: ignore[arg-type]


def scaled(seed: int, **scales: float) -> list[BoardPicture]:
    cell = cells.true_cell(seed)
    return cells.pictures(replace(cell, scales={**cell.scales, **scales}), COUNT, seed)


def test_a_good_cell_has_no_fault() -> None:
    assert faults(cells.pictures(cells.true_cell(61), COUNT, 61)) == ()


def test_a_plate_printed_too_large_is_named_with_both_its_faces() -> None:
    found = faults(scaled(62, front=0.01, back=0.01))
    assert {(f.kind, f.subject) for f in found} == {
        ("board_scaled", "front"),
        ("board_scaled", "back"),
    }
    assert all("too large" in f.message for f in found)


def test_a_board_for_the_table_printed_too_small_is_named() -> None:
    found = faults(scaled(63, flat=-0.01))
    assert [(f.kind, f.subject) for f in found] == [("board_scaled", "flat")]
    assert "too small" in found[0].message


def test_another_boards_file_is_named_as_such() -> None:
    found = faults(scaled(64, flat=0.07))
    assert ("board_file", "flat") in {(f.kind, f.subject) for f in found}


@pytest.mark.parametrize("camera", ["overhead", pytest.param("inspection", marks=pytest.mark.slow)])
def test_a_camera_moved_half_way_is_named_with_the_picture_before_which_it_was(camera: str) -> None:
    cell = cells.true_cell(65)
    moved = cells.bumped(cell.cameras[camera], 3.0, 0.3, np.random.default_rng(65))
    pictures = cells.pictures(cell, COUNT, 65, bump=(camera, moved))
    found = faults(pictures)
    assert [(f.kind, f.subject) for f in found] == [("camera_moved", camera)]
    own = [p.name for p in pictures if p.camera == camera and p.q is not None]
    near = own[COUNT // 2 - 2 : COUNT // 2 + 2]
    assert any(f"before picture {name};" in found[0].message for name in near)


@pytest.mark.slow
def test_a_plate_that_slipped_is_no_moved_camera() -> None:
    cell = cells.true_cell(66)
    slipped = cell.T_tcp_body["grasp0"] @ cells.pose(cells.turned([0, 0.03, 0]), [1.5, 0, 1.0])
    found = faults(cells.pictures(cell, COUNT, 66, slip=("overhead", slipped)))
    assert [(f.kind, f.subject) for f in found] == [("plate_slipped", "grasp0")]


def test_a_degree_of_play_is_named_and_a_quarter_is_none() -> None:
    pictures = cells.pictures(cells.true_cell(61), COUNT, 61)
    u = float(np.radians(0.02))
    play = {"yaw": Play(float(np.radians(1.0)), u), "elbow": Play(float(np.radians(0.25)), u)}
    found = faults(pictures, play=play)
    assert [(f.kind, f.subject) for f in found] == [("backlash", "yaw")]
    assert "1.00 deg" in found[0].message


def test_one_picture_that_contradicts_all_others_is_named() -> None:
    pictures = cells.pictures(cells.true_cell(67), COUNT, 67)
    q = pictures[9].q
    assert q is not None
    # the counter of zed slipped by 4 mm
    pictures[9] = replace(pictures[9], q=q + np.array([0, 0, 0, 4.0, 0, 0]))
    found = faults(pictures)
    assert [(f.kind, f.subject) for f in found] == [("picture", pictures[9].name)]


def test_one_odd_picture_is_left_out_and_the_cell_is_as_it_is_without_it() -> None:
    pictures = cells.pictures(cells.true_cell(67), COUNT, 67)
    good = calibrate_cell(cells.prior(), [*pictures[:9], *pictures[10:]])
    q = pictures[9].q
    assert q is not None
    pictures[9] = replace(pictures[9], q=q + np.array([0, 0, 0, 4.0, 0, 0]))
    found = calibrate_and_prove(cells.prior(), pictures)
    assert found.faults == ()
    assert [f.subject for f in found.left_out] == [pictures[9].name]
    assert np.abs((found.fit.x - good.x) / good.std).max() < 1e-6


@pytest.mark.slow
def test_three_odd_pictures_are_no_chance() -> None:
    pictures = cells.pictures(cells.true_cell(67), COUNT, 67)
    for at, off in ((9, 4.0), (12, -5.0), (20, 6.0)):
        q = pictures[at].q
        assert q is not None
        pictures[at] = replace(pictures[at], q=q + np.array([0, 0, 0, off, 0, 0]))
    found = calibrate_and_prove(cells.prior(), pictures)
    assert found.faults
    assert found.left_out == ()


def test_a_base_out_of_its_bounds_is_named_and_one_only_uncertain_is_not() -> None:
    cell = cells.true_cell(68)
    there = cell.T_world_arm.copy()
    there[0, 3] += 12.0  # four times what a set-up leaves
    found = faults(cells.pictures(replace(cell, T_world_arm=there), COUNT, 68))
    assert ("out_of_bounds", "base.x_mm") in {(f.kind, f.subject) for f in found}
    assert not any("lens" in f.subject for f in found)
