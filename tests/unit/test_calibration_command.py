"""`cellctl calibrate camera`: the files it reads and writes, and its messages on wrong ones."""

from __future__ import annotations

import contextlib
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from board_pictures import camera_over_table, picture_of, pose

from controller.calibration.camera import Chessboard
from controller.cli import main
from controller.cli.calibrating.camera_calibration import read_grey
from controller.cli.inputs.calibration_file import load_calibration, write_calibration
from controller.config import ConfigError

BOARD = Chessboard((7, 4), 14.0)
CAMERA = camera_over_table((240, 192), (420.0, 525.0), (-0.2, 0.1, 0.0, 0.0, 0.0), height_mm=400.0)
POSES = {
    "a_0.png": ("flat", pose(-45, -25, 0, 8)),
    "a_1.png": ("flat", pose(-95, -65, 0, 2)),
    "a_2.png": ("flat", pose(80, -45, 0, 88)),
    "a_3.png": ("tilted", pose(-40, -25, 20, 4, (22, 0))),
    "a_4.png": ("tilted", pose(-70, 10, 30, 0, (-20, 8))),
    "a_5.png": ("tilted", pose(-10, -30, 30, 10, (4, 23))),
}
TARGET: dict[str, Any] = {
    "inner_corners": [7, 4],
    "square_mm": 14.0,
    "images": [{"image": name, "placed": placed} for name, (placed, _) in POSES.items()],
    "world": {"image": "a_0.png", "origin_mm": [-45.0, -25.0, 0.0], "x_axis_angle_deg": 8.0},
}
Files = Callable[..., tuple[list[str], Path]]


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the six pictures."""
    folder = tmp_path_factory.mktemp("board")
    for i, (name, (_, T)) in enumerate(POSES.items()):
        cv2.imwrite(str(folder / name), picture_of(CAMERA, T, BOARD, seed=i))
    return folder


@pytest.fixture(scope="module")
def done(shot: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The calibration file of the six pictures and an empty one, and what people were told."""
    folder = tmp_path_factory.mktemp("calibration")
    empty = folder / "b_6.png"
    cv2.imwrite(str(empty), np.full((192, 240), 70, dtype=np.uint8))
    target = _changed(images=[*TARGET["images"], {"image": "b_6.png", "placed": "tilted"}])
    (folder / "target.json").write_text(json.dumps(target), encoding="utf-8")
    output = folder / "cameras" / "overhead.json"
    images = [*(str(shot / name) for name in POSES), str(empty)]
    command = ["calibrate", "camera", *images, "--target", str(folder / "target.json")]
    told = io.StringIO()
    with contextlib.redirect_stdout(told):
        assert main([*command, "-o", str(output)]) == 0
    return output, told.getvalue()


def _run(tmp_path: Path, images: list[Path], target: dict[str, Any], *more: str) -> int:
    path = tmp_path / "target.json"
    path.write_text(json.dumps(target), encoding="utf-8")
    names = [str(image) for image in images]
    output = str(tmp_path / "camera.json")
    return main(["calibrate", "camera", *names, "--target", str(path), "-o", output, *more])


def _changed(**keys: Any) -> dict[str, Any]:
    target = {**TARGET, **keys}
    return {key: value for key, value in target.items() if value is not None}


def test_the_file_written_is_the_camera_that_took_the_pictures(done: tuple[Path, str]) -> None:
    found = load_calibration(done[0])
    body = json.loads(done[0].read_text(encoding="utf-8"))
    assert found.size_px == (240, 192)
    width, height = found.size_px
    u, v = np.meshgrid(np.linspace(20, width - 21, 5), np.linspace(20, height - 21, 5))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    off = np.linalg.norm(found.on_plane(pixels) - CAMERA.on_plane(pixels), axis=1)
    assert off.max() < 4 * body["uncertainty"]["table"][0]["worst_std_mm"]
    assert off.max() < 0.3  # of a pixel: 0.95 mm
    error = np.abs(found.position_mm - CAMERA.position_mm)
    assert (error < 4 * np.array(body["uncertainty"]["position_std_mm"])).all()
    assert body["residuals"]["rms_px"] < 0.05
    assert body["counts"] == {
        "pictures": 7,
        "boards": 6,
        "flat": 3,
        "tilted": 3,
        "corners": 6 * 28,
        "outliers": body["counts"]["outliers"],
    }
    assert body["board"] == {"inner_corners": [7, 4], "square_mm": 14.0}
    assert body["world"]["image"] == "a_0.png"
    assert [missed["image"] for missed in body["missed"]] == ["b_6.png"]


@pytest.mark.slow
def test_pictures_of_other_names_and_folders_are_known_by_how_they_end(
    shot: Path, done: tuple[Path, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    images = []
    for name in POSES:
        images.append(tmp_path / f"lo_{name}")
        images[-1].write_bytes((shot / name).read_bytes())
    assert _run(tmp_path, images, TARGET, "--json") == 0
    answer = json.loads(capsys.readouterr().out)
    before = json.loads(done[0].read_text(encoding="utf-8"))
    assert answer["file"] == str(tmp_path / "camera.json")
    np.testing.assert_allclose(answer["K"], before["K"], rtol=1e-9)
    np.testing.assert_allclose(answer["T_world_cam"], before["T_world_cam"], atol=1e-6)
    assert answer["made"]["images"] == [image.name for image in images]
    assert [view["image"] for view in answer["residuals"]["views"]] == list(POSES)


def test_people_are_told_of_boards_not_found_and_of_what_is_known_how_well(
    done: tuple[Path, str],
) -> None:
    told = done[1]
    assert "boards found in 6 of 7 pictures: 3 flat, 3 tilted" in told
    assert "not in b_6.png: no chessboard with 7 x 4 inner corners" in told
    assert "deg off the vertical" in told
    assert "a position at z = 0 mm is known to" in told
    assert f"written to {done[0]}" in told


# -- what is refused ------------------------------------------------------------------------------


@pytest.fixture
def refusal(shot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    def refused(target: dict[str, Any] = TARGET, images: list[Path] | None = None) -> str:
        chosen = [shot / name for name in POSES] if images is None else images
        assert _run(tmp_path, chosen, target) == 2
        assert not (tmp_path / "camera.json").exists()
        return capsys.readouterr().err

    return refused


@pytest.mark.parametrize(
    ("target", "told"),
    [
        (_changed(square_m=0.014), "unknown key `square_m`; did you mean `square_mm`?"),
        (_changed(square_mm=None), "`square_mm` is missing"),
        (_changed(square_mm=-3), "`square_mm`: Input should be greater than 0"),
        (_changed(inner_corners=None), "either `inner_corners` of a chessboard or `squares`"),
        (_changed(inner_corners=[7, 1]), "inner_corners.1"),
        (_changed(squares=[8, 5]), "keep one"),
        (_changed(inner_corners=None, squares=[8, 5]), "needs `marker_mm` and `dictionary`"),
        (
            _changed(inner_corners=None, squares=[8, 5], marker_mm=15, dictionary="DICT_4X4_50"),
            "`marker_mm` 15 must be less than `square_mm` 14",
        ),
        (
            _changed(inner_corners=None, squares=[8, 5], marker_mm=9, dictionary="DICT_4X4"),
            "OpenCV knows no dictionary DICT_4X4",
        ),
        (
            _changed(images=[{"image": "a_0.png", "placed": "upright"}]),
            "a board is placed flat (on the table) or tilted, not 'upright'",
        ),
        (
            _changed(images=TARGET["images"][3:], world=None),
            "take at least one picture with the board on the table",
        ),
        (_changed(images=TARGET["images"] * 2), "`images` names a_0.png twice"),
        (
            _changed(world={"image": "a_3.png"}),
            "`world.image` a_3.png is not one of the flat ones (a_0.png, a_1.png, a_2.png)",
        ),
        (_changed(inner_corners=[7, 5]), "one count of inner corners odd, the other even"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_wrong_target_file_is_told_with_its_key(
    refusal: Callable[..., str], target: dict[str, Any], told: str
) -> None:
    error = refusal(target)
    assert "target.json:" in error
    assert told in error


def test_what_is_no_json_is_told(
    shot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "target.json"
    path.write_text('{"square_mm": 14,\n "images": [', encoding="utf-8")
    command = ["calibrate", "camera", str(shot / "a_0.png"), "--target", str(path)]
    assert main([*command, "-o", str(tmp_path / "camera.json")]) == 2
    assert "target.json" in capsys.readouterr().err


def test_a_picture_the_target_file_does_not_know_is_refused(
    refusal: Callable[..., str], tmp_path: Path
) -> None:
    told = refusal(images=[tmp_path / "other.png"])
    assert "other.png: `images` of" in told
    assert "does not list it" in told


def test_two_pictures_for_one_entry_are_refused(
    refusal: Callable[..., str], shot: Path, tmp_path: Path
) -> None:
    told = refusal(images=[shot / "a_0.png", tmp_path / "lo_a_0.png"])
    assert "both fit `a_0.png`" in told


def test_the_longest_fitting_entry_is_meant(
    refusal: Callable[..., str], shot: Path, tmp_path: Path
) -> None:
    # both entries fit the end of the name: a world picture that is not among them says which won
    entries = [*TARGET["images"], {"image": "lo_a_0.png", "placed": "tilted"}]
    picture = tmp_path / "lo_a_0.png"
    picture.write_bytes((shot / "a_0.png").read_bytes())
    told = refusal(_changed(images=entries), images=[picture])
    assert "a_0.png fixes the world (`world.image`), but is not among the images" in told


def test_pictures_that_are_none_are_refused(refusal: Callable[..., str], tmp_path: Path) -> None:
    assert "No such file" in refusal(images=[tmp_path / "a_0.png"])
    (tmp_path / "a_1.png").write_bytes(b"not a picture")
    assert "is not a readable picture" in refusal(images=[tmp_path / "a_1.png"])
    (tmp_path / "a_2.png").write_bytes(b"")
    assert "the file is empty" in refusal(images=[tmp_path / "a_2.png"])


def test_twelve_bits_in_sixteen_are_read_with_all_their_contrast(tmp_path: Path) -> None:
    path = tmp_path / "deep.png"
    cv2.imwrite(str(path), np.array([[0, 2000, 4000]], dtype=np.uint16))
    np.testing.assert_array_equal(read_grey(path), [[0, 128, 255]])


def test_pictures_of_two_sizes_are_refused(
    refusal: Callable[..., str], shot: Path, tmp_path: Path
) -> None:
    other = tmp_path / "a_1.png"
    cv2.imwrite(str(other), np.zeros((100, 120), dtype=np.uint8))
    told = refusal(images=[shot / "a_0.png", other])
    assert "120 x 100 px, but" in told
    assert "240 x 192 px" in told


def test_flat_pictures_alone_are_refused_with_what_to_do(
    refusal: Callable[..., str], shot: Path
) -> None:
    told = refusal(images=[shot / name for name in list(POSES)[:3]])
    assert "the camera is not calibrated: boards found in 3 pictures, 4 are needed" in told


def test_a_world_picture_without_its_board_is_refused(
    refusal: Callable[..., str], shot: Path, tmp_path: Path
) -> None:
    blank = tmp_path / "a_0.png"
    cv2.imwrite(str(blank), np.full((192, 240), 70, dtype=np.uint8))
    told = refusal(images=[blank, shot / "a_1.png"])
    assert "a_0.png fixes the world, but its board was not found: no chessboard" in told


def test_a_file_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("", encoding="utf-8")
    with pytest.raises(ConfigError, match="cannot be written"):
        write_calibration(tmp_path / "taken" / "camera.json", {})


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("{}", "no camera calibration"),
        ("[1]", "no camera calibration"),
        ('{"size_px": [2, 2], "K": [1], "distortion": [], "T_world_cam": []}', "3 x 3"),
    ],
)
def test_what_is_no_calibration_file_is_told(tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / "camera.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=told):
        load_calibration(path)
