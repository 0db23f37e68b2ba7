"""The calibration of arm and cameras, against synthetic cells whose truth is known."""

from __future__ import annotations

from dataclasses import replace

import kinematic_cells as cells
import numpy as np
import pytest

from controller.calibration.camera import FoundBoard
from controller.calibration.kinematics import (
    BoardPicture,
    CellFit,
    ExactArm,
    KinematicsError,
    Placing,
    aim_uncertainty_mm,
    calibrate_cell,
    camera_uncertainty,
    grasps_of,
    placed_roughly,
    plate_faces,
    repeatability_mm,
    tcp_poses,
    tcp_uncertainty,
)
from controller.calibration.kinematics.layout import UnknownsLayout
from controller.calibration.target import BoardSection
from drivers.umi_scara import ArmGeometry, UmiFigures, kinematics

# over the table, at the station and at the fixed gripper, some of each
ELSEWHERE = np.array(
    [
        [0.3, -0.9, 0.2, -760.0, -1.5, 0.4],
        [-0.5, 1.1, -0.4, -700.0, -1.2, 1.0],
        [0.6, -1.3, 0.5, -465.0, 0.0, 1.5],
        [-0.7, 1.2, 0.1, -465.0, -0.2, -0.6],
        [-1.2, 0.3, -0.6, -480.0, 0.0, 0.0],
    ]
)


@pytest.fixture(scope="module")
def seen() -> tuple[cells.TrueCell, list[BoardPicture], CellFit]:
    cell = cells.true_cell(1)
    pictures = cells.pictures(cell, seed=1)
    return cell, pictures, calibrate_cell(cells.prior(), pictures)


def standardised(cell: cells.TrueCell, fit: CellFit) -> list[float]:
    """Errors of the TCP in the world, in stated standard uncertainties; 2 holds 95 %."""
    out = []
    for q, found, u in zip(
        ELSEWHERE, tcp_poses(fit, ELSEWHERE), tcp_uncertainty(fit, ELSEWHERE), strict=True
    ):
        off = found[:3, 3] - cell.T_world_tcp(q)[:3, 3]
        out.append(float(np.linalg.norm(off)) / u.u_mm)
    return out


def test_derivatives_are_those_of_the_residuals() -> None:
    cell = cells.true_cell(2)
    pictures = cells.pictures(cell, per_camera=2, seed=2)
    middle = pictures[-1].taken_s - 0.5
    layout = UnknownsLayout(cells.prior(), {"inspection": (middle, np.full(6, 0.01))})
    x = 0.5 * layout.std * np.random.default_rng(3).standard_normal(layout.size)
    found = layout.evaluate(x, pictures)
    for i in range(layout.size):
        d = np.zeros(layout.size)
        d[i] = 1e-4 * layout.std[i]
        pairs = zip(layout.evaluate(x + d, pictures), layout.evaluate(x - d, pictures), strict=True)
        for terms, (ahead, behind) in zip(found, pairs, strict=True):
            by = (ahead.residual_px - behind.residual_px) / (2 * d[i])
            column = np.flatnonzero(terms.columns == i)
            stated = terms.by_unknowns[:, :, column[0]] if len(column) else np.zeros_like(by)
            np.testing.assert_allclose(
                stated, by, atol=1e-4 * np.abs(by).max() + 1e-6 / layout.std[i], err_msg=str(i)
            )


def test_the_arms_figures_make_the_arm_of_the_tests_own_reading() -> None:
    cell = cells.true_cell(5)
    arm = replace(cell.arm, play_rad=np.zeros(5))
    values = np.array(
        [
            *(arm.upper_mm, arm.fore_mm, arm.tool_mm, *arm.tool_off_mm, *arm.zero_rad),
            *(arm.zed_zero_mm, arm.yaw_per_elbow, arm.sag_mm),
        ]
    )
    found = UmiFigures(ArmGeometry()).tcp(ELSEWHERE, values)
    # the truth has its heading and its sag by the counter's elbow, the model by the true one: the
    # difference is of second order
    expected = np.array([arm.T_arm_tcp(q) for q in ELSEWHERE])
    np.testing.assert_allclose(found[:, :3, 3], expected[:, :3, 3], atol=0.02)
    np.testing.assert_allclose(found[:, :3, :3], expected[:, :3, :3], atol=1e-4)


def test_a_cell_is_found_within_its_stated_uncertainty(
    seen: tuple[cells.TrueCell, list[BoardPicture], CellFit],
) -> None:
    cell, _, fit = seen
    assert max(standardised(cell, fit)) < 2.5
    points = np.array([[300.0, -80, 0], [420, 90, 0], [360, 0, 30]])
    off_px = fit.camera("overhead").project(points) - cell.cameras["overhead"].project(points)
    off_mm = np.linalg.norm(off_px, axis=1) * 1250.0 / 3571.0
    assert (off_mm < 2.5 * camera_uncertainty(fit, "overhead", points)).all()
    assert fit.noise_px == pytest.approx(cell.noise_px, rel=0.1)
    # the tool is known to 0.5 mm along and across; all else to a fraction of that
    tool = [fit.layout.index(f"arm.{name}") for name in ("tool_mm", "tool_off_z_mm")]
    assert (fit.std[tool] < 0.5 / 3**0.5 + 1e-9).all()
    known = fit.observed(np.zeros(2), np.eye(fit.layout.size)[tool] / 0.01)
    # what a pick needs: that the TCP gets to what the camera has seen
    assert (aim_uncertainty_mm(known, "overhead", ELSEWHERE[:2]) < 0.15).all()
    np.testing.assert_allclose(known.std[tool], 0.01, rtol=0.01)


@pytest.mark.slow
def test_ninety_five_of_a_hundred_truths_are_inside_the_stated_uncertainty() -> None:
    inside = []
    for seed in range(1000, 1040):
        cell = cells.true_cell(seed)
        fit = calibrate_cell(cells.prior(), cells.pictures(cell, seed=seed))
        inside += [z < 2.0 for z in standardised(cell, fit)]
    # poses of one cell err together: 40 cells, of which 95 % +- 3.4 %
    assert np.mean(inside) > 0.88


def test_what_no_picture_shows_is_held_and_what_they_show_is_not(
    seen: tuple[cells.TrueCell, list[BoardPicture], CellFit],
) -> None:
    _, _, fit = seen
    # a plate in the jaws hides how far the TCP is along them; base and shoulder share a turn
    assert {"arm.tool_mm", "arm.tool_off_z_mm", "base.rz_rad"} <= set(fit.held)
    shown = {"upper_mm", "fore_mm", "elbow_rad", "yaw_rad", "pitch_rad", "yaw_per_elbow", "sag_mm"}
    assert {f"arm.{name}" for name in shown} <= set(fit.observable)
    assert set(fit.held) | set(fit.observable) == set(fit.layout.names)


def test_the_joints_own_noise_is_told_from_the_corners() -> None:
    still = cells.true_cell(7, joint_std=np.zeros(6))
    loose = cells.true_cell(7, joint_std=2.0 * cells.COUNT_STD)
    fits = [calibrate_cell(cells.prior(), cells.pictures(c, seed=7)) for c in (still, loose)]
    factors = [float(f.joint_std[0] / cells.COUNT_STD[0]) for f in fits]
    assert factors[0] < 0.1
    assert 1.4 <= factors[1] <= 2.9
    assert repeatability_mm(fits[1], ELSEWHERE) > 5 * repeatability_mm(fits[0], ELSEWHERE)


def test_dirt_on_corners_is_left_out_and_reported(
    seen: tuple[cells.TrueCell, list[BoardPicture], CellFit],
) -> None:
    _, pictures, clean = seen
    spoilt = list(pictures)
    pixels = pictures[9].board.pixels.copy()
    pixels[[3, 17]] += (1.5, -2.0)
    spoilt[9] = replace(
        pictures[9], board=FoundBoard(pictures[9].board.board_mm, pixels, 30.0, 0.8)
    )
    fit = calibrate_cell(cells.prior(), spoilt)
    assert [p.outlier_count for p in fit.pictures if p.outlier_count] == [2]
    assert fit.pictures[9].outlier_count == 2
    moved = tcp_poses(fit, ELSEWHERE)[:, :3, 3] - tcp_poses(clean, ELSEWHERE)[:, :3, 3]
    assert np.abs(moved).max() < 0.02


def test_starts_come_from_pictures(
    seen: tuple[cells.TrueCell, list[BoardPicture], CellFit],
) -> None:
    cell, pictures, _ = seen
    rough = placed_roughly(cells.nominal_cameras()["overhead"], pictures[2].board, 5.0)
    x, y, angle = cells.PLACED[2]
    assert np.hypot(rough.x_mm - x, rough.y_mm - y) < 2 * rough.mm
    assert abs(rough.angle_rad - angle) < 2 * rough.rad
    held = next(p for p in pictures if p.q is not None)
    grasp = grasps_of(cells.prior(), {"grasp0": held})["grasp0"]
    off = grasp.T_tcp_body[:3, 3] - cell.T_tcp_body["grasp0"][:3, 3]
    assert (np.abs(off) < 3 * grasp.std[3:] + 0.1).all()


def test_the_faces_of_a_plate_follow_from_its_file() -> None:
    paddle = BoardSection(
        squares=(7, 7),
        square_mm=12,
        marker_mm=9,
        dictionary="DICT_4X4_250",
        first_marker=100,
        back_first_marker=124,
        thickness_mm=10,
        margin_mm=3,
        bare_mm=30,
    )
    front, back = plate_faces(paddle)
    # the plate is 90 x 120 mm, its first inner corner 15 mm from the side and 45 mm from the end
    # it is held by, whose middle is 15 mm from there
    np.testing.assert_allclose(front.T_body_board[:3, 3], [30, 5, -30])
    np.testing.assert_allclose(back.T_body_board[:3, 3], [30, -5, 30])
    for face, normal in ((front, 1.0), (back, -1.0)):
        R = face.T_body_board[:3, :3]
        np.testing.assert_allclose(R @ R.T, np.eye(3))
        assert np.linalg.det(R) == pytest.approx(1.0)
        np.testing.assert_allclose(R[:, 2], [0, normal, 0])
        np.testing.assert_allclose(R[:, 1], [1, 0, 0])  # the bare side is down


@pytest.mark.parametrize(
    ("drop", "message"),
    [
        (lambda p: p.held_as == "flat0", "nothing fixes the world"),
        (lambda p: p.camera == "inspection", "no picture of the camera inspection"),
    ],
)
def test_pictures_that_cannot_do_are_refused(
    seen: tuple[cells.TrueCell, list[BoardPicture], CellFit], drop: object, message: str
) -> None:
    _, pictures, _ = seen
    kept = [p for p in pictures if not drop(p)]  # type: ignore[operator]
    with pytest.raises(KinematicsError, match=message):
        calibrate_cell(cells.prior(), kept)


def test_a_picture_of_too_few_corners_is_refused(
    seen: tuple[cells.TrueCell, list[BoardPicture], CellFit],
) -> None:
    _, pictures, _ = seen
    one = pictures[-1]
    board = FoundBoard(one.board.board_mm[:4], one.board.pixels[:4], 30.0, 0.8)
    with pytest.raises(KinematicsError, match="shows 4 corners"):
        calibrate_cell(cells.prior(), [*pictures[:-1], replace(one, board=board)])


def test_a_placing_wholly_known_fixes_the_world() -> None:
    cell = cells.true_cell(9)
    pictures = cells.pictures(cell, per_camera=8, seed=9)
    prior = cells.prior()
    shifted = dict(prior.placings)
    x, y, angle = cells.PLACED[0]
    shifted["flat0"] = Placing(x + 10.0, y, angle, 5.0)
    here = calibrate_cell(prior, pictures)
    there = calibrate_cell(replace(prior, placings=shifted), pictures)
    moved = there.camera("overhead").position_mm - here.camera("overhead").position_mm
    assert moved[0] > 5.0  # the priors pull a little


def test_of_an_arm_that_names_no_figures_base_and_cameras_are_found() -> None:
    cell = cells.true_cell(3, arm=cells.TrueArm())
    prior = replace(cells.prior(), arm=ExactArm(kinematics.forward))
    fit = calibrate_cell(prior, cells.pictures(cell, seed=3))
    assert fit.arm == {}
    assert not any(name.startswith("arm.") for name in fit.layout.names)
    assert max(standardised(cell, fit)) < 2.5
    off = np.linalg.inv(cell.T_world_arm) @ fit.T_world_arm
    assert np.linalg.norm(off[:3, 3]) < 0.5  # drawn within 3 mm and 0.5 degrees
    assert np.abs(off[:3, :3] - np.eye(3)).max() < np.radians(0.05)
