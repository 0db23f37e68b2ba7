"""The camera from boards: exact without noise, within its uncertainty with noise, else refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from board_pictures import Scene, camera_over_table, corners_of, noisy_views, pose, true_pixels
from scipy.spatial.transform import Rotation

from controller.calibration.camera import (
    PARAMETERS,
    CalibratedCamera,
    CalibrationError,
    CalibrationLimits,
    Chessboard,
    FoundBoard,
    PlacedBoard,
    View,
    WorldFrame,
    calibrate,
)
from controller.calibration.camera.refusals import check_uncertainty
from controller.calibration.camera.solve import CalibrationSolution, solve
from controller.calibration.camera.uncertainty import spread
from controller.imaging import Camera, inverse_pose

BOARD = Chessboard((8, 5), 12.0)
WORLD = WorldFrame("flat 0", (-40.0, -25.0, 0.0), float(np.radians(8.0)))
LENS = (-0.25, 0.35, 0.002, -0.0015, 0.0)
# pixels 5 : 4
CAMERA = camera_over_table((640, 512), (900.0, 1125.0), LENS, height_mm=330.0)
FLAT = (
    ("flat 0", PlacedBoard.FLAT, pose(-40, -25, 0, 8)),
    ("flat 1", PlacedBoard.FLAT, pose(-95, -60, 0, 3)),
    ("flat 2", PlacedBoard.FLAT, pose(30, 65, 0, -80)),
    ("flat 3", PlacedBoard.FLAT, pose(95, -60, 0, 80)),
)
TILTED = (
    ("tilted 0", PlacedBoard.TILTED, pose(-50, -30, 30, 5, (20, 0))),
    ("tilted 1", PlacedBoard.TILTED, pose(-80, 10, 30, -10, (-20, 5))),
    ("tilted 2", PlacedBoard.TILTED, pose(0, -60, 30, 10, (3, 22))),
    ("tilted 3", PlacedBoard.TILTED, pose(-30, -30, 30, 0, (0, -22))),
    ("tilted 4", PlacedBoard.TILTED, pose(60, -40, 20, 90, (18, 15))),
)
SCENE = Scene(CAMERA, FLAT + TILTED, WORLD)
CORNER_COUNT = 9 * 40


def _views(scene: Scene = SCENE, noise_px: float = 0.05, seed: int = 1) -> list[View]:
    return noisy_views(scene, BOARD, noise_px, np.random.default_rng(seed))


def _table_error_mm(found: Camera, truth: Camera, z: float = 0.0) -> np.ndarray:
    width, height = truth.size_px
    u, v = np.meshgrid(np.linspace(0, width - 1, 9), np.linspace(0, height - 1, 7))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    return np.linalg.norm(found.on_plane(pixels, z) - truth.on_plane(pixels, z), axis=1)


@pytest.fixture(scope="module")
def usual() -> CalibratedCamera:
    return calibrate(_views(), CAMERA.size_px, WORLD)


def test_without_noise_the_camera_is_the_true_one() -> None:
    found = calibrate(_views(noise_px=1e-4), CAMERA.size_px, WORLD).camera
    np.testing.assert_allclose(found.K, CAMERA.K, atol=0.01)
    np.testing.assert_allclose(found.T_world_cam[:3, 3], CAMERA.position_mm, atol=0.005)
    np.testing.assert_allclose(found.distortion, CAMERA.distortion, atol=2e-3)
    assert _table_error_mm(found, CAMERA).max() < 2e-3


def test_what_is_said_of_a_noisy_calibration_is_so(usual: CalibratedCamera) -> None:
    # 80 unknowns less of 720 residuals: 5 % of chance either way, twice that allowed
    assert usual.noise_px == pytest.approx(0.05, rel=0.12)
    assert usual.rms_px == pytest.approx(0.05 * np.sqrt(2), rel=0.12)
    assert [view.corner_count for view in usual.views] == [40] * 9
    for view, (_, _, T) in zip(usual.views, SCENE.boards, strict=True):
        tilt = np.degrees(np.arccos(min(T[2, 2], 1.0)))
        assert np.degrees(view.tilt_rad) == pytest.approx(tilt, abs=0.3)
    lean = np.degrees(np.arccos(-CAMERA.T_world_cam[2, 2]))
    within = 4 * np.degrees(usual.tilt_std_rad)
    assert np.degrees(usual.tilt_rad) == pytest.approx(lean, abs=within)
    for plane in usual.table:
        assert plane.median_mm < plane.covered_worst_mm <= plane.worst_mm
        assert _table_error_mm(usual.camera, CAMERA, plane.height_mm).max() < 4 * plane.worst_mm


def test_the_order_of_the_pictures_does_not_matter(usual: CalibratedCamera) -> None:
    turned = calibrate(_views()[::-1], CAMERA.size_px, WORLD)
    np.testing.assert_allclose(turned.camera.K, usual.camera.K, atol=1e-3)
    np.testing.assert_allclose(turned.camera.T_world_cam, usual.camera.T_world_cam, atol=1e-3)


def test_the_camera_goes_where_the_target_file_moves_the_world(usual: CalibratedCamera) -> None:
    # the same pictures, the world turned by 30 deg and moved: every pose moves along
    T_new_world = pose(100, 50, 7, 30)
    origin = T_new_world[:3, :3] @ np.array(WORLD.origin_mm) + T_new_world[:3, 3]
    moved = WorldFrame("flat 0", tuple(origin), WORLD.x_axis_angle_rad + np.radians(30))
    found = calibrate(_views(), CAMERA.size_px, moved)
    np.testing.assert_allclose(
        found.camera.T_world_cam, T_new_world @ usual.camera.T_world_cam, atol=2e-3
    )


def test_another_flat_board_may_fix_the_world(usual: CalibratedCamera) -> None:
    T = FLAT[2][2]
    angle = float(np.arctan2(T[1, 0], T[0, 0]))
    found = calibrate(_views(), CAMERA.size_px, WorldFrame("flat 2", tuple(T[:3, 3]), angle))
    # the same camera up to what the noise of two boards makes of their places
    assert _table_error_mm(found.camera, usual.camera).max() < 0.05


def test_terms_the_lens_does_not_have_are_held_and_named() -> None:
    straight = camera_over_table((640, 512), (900.0, 1125.0), (0, 0, 0, 0, 0), height_mm=330.0)
    found = calibrate(_views(replace(SCENE, camera=straight)), straight.size_px, WORLD)
    assert not {"k2", "k3"} & set(found.free)
    assert set(found.held_std) == set(PARAMETERS) - set(found.free)
    assert set(found.std) == set(found.free)
    # what is held may be otherwise, and that makes the stated covariance larger
    grown = np.diag(found.parameters_cov) - np.diag(found.noise_cov)
    assert (grown >= -1e-12).all()
    assert grown[0] > 0
    assert _table_error_mm(found.camera, straight).max() < 4 * found.table[0].worst_mm


def test_a_few_wrong_corners_are_left_out_and_counted(usual: CalibratedCamera) -> None:
    views = _views()
    board = views[5].board
    pixels = board.pixels.copy()
    pixels[[3, 17]] += 3.0
    views[5] = replace(views[5], board=replace(board, pixels=pixels))
    found = calibrate(views, CAMERA.size_px, WORLD)
    assert [view.outlier_count for view in found.views] == [0, 0, 0, 0, 0, 2, 0, 0, 0]
    assert _table_error_mm(found.camera, usual.camera).max() < 0.05


def test_a_board_seen_in_part_counts_with_what_is_seen() -> None:
    views = _views()
    for i in (1, 6):
        b = views[i].board
        views[i] = replace(
            views[i], board=replace(b, board_mm=b.board_mm[:17], pixels=b.pixels[:17])
        )
    found = calibrate(views, CAMERA.size_px, WORLD)
    assert [view.corner_count for view in found.views] == [40, 17, 40, 40, 40, 40, 17, 40, 40]
    assert _table_error_mm(found.camera, CAMERA).max() < 4 * found.table[0].worst_mm


# -- Monte Carlo ----------------------------------------------------------------------------------


def _error(K: np.ndarray, distortion: np.ndarray, T_cam_world: np.ndarray) -> np.ndarray:
    """PARAMETERS, rotation and translation, found less true."""
    truth = inverse_pose(CAMERA.T_world_cam)
    turn = Rotation.from_matrix(T_cam_world[:3, :3] @ truth[:3, :3].T).as_rotvec()
    lens = [K[0, 0], K[1, 1], K[0, 2], K[1, 2], *distortion]
    true_lens = [CAMERA.K[0, 0], CAMERA.K[1, 1], CAMERA.K[0, 2], CAMERA.K[1, 2], *LENS]
    return np.concatenate([np.subtract(lens, true_lens), turn, (T_cam_world - truth)[:3, 3]])


def _unlikeliness(error: np.ndarray, cov: np.ndarray, free: tuple[str, ...]) -> float:
    """The squared Mahalanobis length of an error, by the count of its dimensions: 1 on average."""
    kept = [i for i, name in enumerate(PARAMETERS) if name in free] + list(range(9, 15))
    e = error[kept]
    return float(e @ np.linalg.solve(cov[np.ix_(kept, kept)], e)) / len(kept)


def test_errors_of_many_noisy_calibrations_spread_as_the_covariance_says() -> None:
    placed = [np.asarray(T) for _, _, T in SCENE.boards]
    T_cam_world = inverse_pose(CAMERA.T_world_cam)
    first = CalibrationSolution(
        np.array([CAMERA.K[0, 0], CAMERA.K[1, 1], CAMERA.K[0, 2], CAMERA.K[1, 2], *LENS]),
        T_cam_world,
        tuple(
            T if kind is PlacedBoard.FLAT else T_cam_world @ T
            for T, (_, kind, _) in zip(placed, SCENE.boards, strict=True)
        ),
    )
    rng = np.random.default_rng(7)
    lengths = []
    for _ in range(10):
        views = noisy_views(SCENE, BOARD, 0.1, rng)
        weights = [np.full(len(view.board.pixels), 1 / 0.1) for view in views]
        fit = solve(views, first, PARAMETERS, WORLD, weights)
        x = fit.solution.intrinsics
        K = np.array([[x[0], 0, x[2]], [0, x[1], x[3]], [0, 0, 1]])
        error = _error(K, x[4:], fit.solution.T_cam_world)
        lengths.append(_unlikeliness(error, spread(fit, {}).noise_cov, PARAMETERS))
    # chi squared of 10 x 15 dimensions by its count: 1 +- 0.115; three times that either way
    assert np.mean(lengths) == pytest.approx(1.0, abs=0.35)


@pytest.mark.slow
def test_whole_calibrations_are_as_wrong_as_they_say() -> None:
    rng = np.random.default_rng(11)
    lengths, table = [], []
    for _ in range(60):
        found = calibrate(noisy_views(SCENE, BOARD, 0.05, rng), CAMERA.size_px, WORLD)
        error = _error(
            found.camera.K, found.camera.distortion, inverse_pose(found.camera.T_world_cam)
        )
        lengths.append(_unlikeliness(error, found.noise_cov, found.free))
        plane = found.table[0]
        at = np.array([plane.worst_at_px])
        off = (found.camera.on_plane(at) - CAMERA.on_plane(at))[0, :2]
        table.append(np.linalg.norm(off) / plane.worst_mm)
    assert np.mean(lengths) == pytest.approx(1.0, abs=0.15)
    # the stated figure is the deviation in the worst direction, and counts held terms as well:
    # it may be too large for a lens that has none, but not too small
    assert 0.2 < np.sqrt(np.mean(np.square(table))) < 1.3


# -- refusals -------------------------------------------------------------------------------------


def _refused(views: list[View], world: WorldFrame = WORLD) -> str:
    with pytest.raises(CalibrationError) as told:
        calibrate(views, CAMERA.size_px, world)
    return str(told.value)


def test_three_boards_are_too_few() -> None:
    assert "boards found in 3 pictures, 4 are needed" in _refused(_views()[:1] + _views()[4:6])


def test_flat_boards_alone_cannot_tell_a_long_lens_from_a_high_camera() -> None:
    told = _refused(_views()[:4])
    assert "0 of the boards found are tilted" in told
    assert "tilted by 15 to 30 deg" in told


def test_boards_called_tilted_that_lie_flat_are_seen_through() -> None:
    views = _views()[:4]
    flat = [
        replace(v, placed=PlacedBoard.TILTED, name=f"tilted {v.name}") for v in _views(seed=2)[:4]
    ]
    told = _refused(views + flat)
    assert "stand at most" in told or "cannot be told apart" in told


def test_a_board_called_flat_that_leans_is_named() -> None:
    views = _views()
    views[5] = replace(views[5], placed=PlacedBoard.FLAT)
    told = _refused(views)
    assert told.startswith("tilted 1 is listed as flat, but is tilted ")
    tilt = np.degrees(np.arccos(TILTED[1][2][2, 2]))
    assert float(told.split("is tilted ")[1].split(" deg")[0]) == pytest.approx(tilt, abs=2.0)


def test_boards_in_one_corner_do_not_show_the_lens_elsewhere() -> None:
    near = [pose(-120, -85, 5 * i, 3 * i) for i in range(3)]
    lean = [pose(-120, -85, 25, 5 * i, (18 * (-1) ** i, 9 * i)) for i in range(4)]
    boards = tuple((f"flat {i}", PlacedBoard.FLAT, T) for i, T in enumerate(near)) + tuple(
        (f"tilted {i}", PlacedBoard.TILTED, T) for i, T in enumerate(lean)
    )
    world = WorldFrame("flat 0", (-120.0, -85.0, 0.0), 0.0)
    told = _refused(_views(Scene(CAMERA, boards, world)), world)
    assert "% of the picture, at the lower left" in told


def test_pictures_out_of_focus_are_refused() -> None:
    assert "px off what any camera would show" in _refused(_views(noise_px=0.8))


def test_a_moved_board_is_named() -> None:
    views = _views()
    b = views[6].board
    # it was bent: a quarter of a millimetre in the middle of 100
    bow = 0.02 * (b.board_mm[:, 0] - 42.0) ** 2 / 42.0
    views[6] = replace(views[6], board=replace(b, pixels=b.pixels + np.outer(bow, [2.0, 1.5])))
    told = _refused(views)
    assert "tilted 2 disagrees with the other pictures" in told


def test_oblong_squares_are_refused() -> None:
    # 12 x 11.7 mm: boards turned by a quarter contradict the others
    board = corners_of(BOARD) * (1.0, 11.7 / 12.0)
    rng = np.random.default_rng(3)
    views = []
    for name, placed, T in SCENE.boards:
        pixels = true_pixels(CAMERA, T, board) + rng.normal(0, 0.05, (len(board), 2))
        views.append(View(name, placed, FoundBoard(corners_of(BOARD), pixels, 25.0, 0.5)))
    assert "squares" in _refused(views)


def test_too_uncertain_a_table_is_refused_with_the_place(usual: CalibratedCamera) -> None:
    check_uncertainty(usual, CalibrationLimits())
    with pytest.raises(
        CalibrationError, match=r"uncertain by .* mm at the .* limits are .* Add pictures"
    ):
        check_uncertainty(
            usual, replace(CalibrationLimits(), table_std_max_mm=0.01, table_std_max_px=0.01)
        )


def test_a_corner_nobody_measured_is_told_and_not_refused(usual: CalibratedCamera) -> None:
    plane = replace(usual.table[0], worst_mm=1.0)  # the limit between the boards is 0.25 mm
    check_uncertainty(replace(usual, table=(plane, usual.table[1])), CalibrationLimits())
    plane = replace(usual.table[0], worst_mm=50.0)
    with pytest.raises(CalibrationError, match=r"by 50\.00 mm at the"):
        check_uncertainty(replace(usual, table=(plane, usual.table[1])), CalibrationLimits())


def test_too_uncertain_a_focal_length_is_refused(usual: CalibratedCamera) -> None:
    with pytest.raises(CalibrationError, match="focal length and height"):
        check_uncertainty(usual, replace(CalibrationLimits(), focal_std_max=1e-5))


def test_a_few_corners_of_one_board_are_too_few() -> None:
    views = _views()
    b = views[4].board
    views[4] = replace(views[4], board=replace(b, board_mm=b.board_mm[:5], pixels=b.pixels[:5]))
    assert _refused(views).startswith("tilted 0 shows 5 corners of the board, 8 are needed")


def test_the_world_cannot_be_fixed_by_a_tilted_board() -> None:
    with pytest.raises(ValueError, match="not a flat view"):
        calibrate(_views(), CAMERA.size_px, replace(WORLD, name="tilted 0"))
