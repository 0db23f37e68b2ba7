"""Calibrations that a cell file refers to: their values, their hash, and what is refused."""

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from config_text import CELL_TEXT

from controller.config import ConfigError, load_cell
from controller.config.calibrations import (
    CameraCalibration,
    read_calibration,
    write_calibration,
)
from controller.setup.drivers import require_drivers
from controller.setup.layout import build_layout
from controller.setup.measured_arm import measured_arm
from controller.setup.optics import build_camera
from emulators.world.arms import UmiShape
from emulators.world.layout import read_layout

HEADER = {"schema": 1, "measured": "2026-03-02T08:30:00Z", "by": "A. Person"}
# a camera that looks straight down, turned by 30 degrees about the line of sight
C, S = float(np.cos(np.radians(30))), 0.5
DOWN = [[S, -C, 0, 362.0], [-C, -S, 0, 3.0], [0, 0, -1, 1248.0], [0, 0, 0, 1]]
UPRIGHT = [[1, 0, 0, 2.0], [0, 1, 0, -1.0], [0, 0, 1, 0.5], [0, 0, 0, 1]]
CAMERA = HEADER | {
    "kind": "camera",
    "size_px": [1280, 1024],
    "K": [[3600.0, 0, 640.0], [0, 3605.0, 508.0], [0, 0, 1]],
    "distortion": [-0.05, 0.03, 0.0001, 0.0002, 0.001],
    "T_world_cam": DOWN,
    "u_pose_mm": 0.05,
    "u_pose_deg": 0.01,
    "exposure_s": 0.012,
}
ARM = HEADER | {
    "kind": "arm",
    "T_world_arm": UPRIGHT,
    "upper_mm": 253.9,
    "fore_mm": 253.2,
    "tool_mm": 176.7,
    "tool_off_mm": [0.3, -0.2],
    "zero_deg": {"shoulder": 0.4, "elbow": -0.3, "yaw": 0.2, "pitch": 0.1, "roll": -0.5},
    "zed_zero_mm": 0.25,
    "yaw_per_elbow": 0.004,
    "sag_mm": 0.6,
    "jaw_zero_mm": 0.4,
    "play_deg": {"shoulder": 0.2},
    "u_mm": 0.2,
    "u_deg": 0.05,
}
FIXED = HEADER | {"kind": "fixed_gripper", "T_world_tcp": UPRIGHT, "u_mm": 0.1, "u_deg": 0.1}
TRAYS = HEADER | {"kind": "trays", "centres": {"accept": [103.0, 388.0]}, "u_mm": 0.1}
PLACED = {"kind": "arm", "T_world_arm": UPRIGHT, "u_mm": 0.2, "u_deg": 0.05}
UR_CELL = Path(__file__).parents[2] / "recipes" / "cells" / "ur5e.yaml"
LAMP = {"analog": 4, "relay": 5, "level": 1.1, "settle_s": 0.2}
LAMPS = HEADER | {"kind": "lamps", "lamps": {"station_ring": LAMP}}


def written(folder: Path, drawing: str = CELL_TEXT, **calibrations: dict[str, Any]) -> Path:
    """Write a cell file that refers to calibrations; return its path."""
    text = drawing.rstrip() + ("\ncalibration:\n" if calibrations else "\n")
    for name, body in calibrations.items():
        data = json.dumps(body).encode()
        path = folder / "cal" / f"{name}.json"
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(data)
        digest = hashlib.sha256(data).hexdigest()
        text += f"  {name}: {{file: cal/{name}.json, sha256: {digest}}}\n"
    path = folder / "cell.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_camera_is_as_it_was_measured(tmp_path: Path) -> None:
    cell = load_cell(written(tmp_path, overhead=CAMERA))
    camera = build_camera(cell.cameras.overhead)
    np.testing.assert_array_equal(camera.K, CAMERA["K"])
    np.testing.assert_array_equal(camera.distortion, CAMERA["distortion"])
    np.testing.assert_allclose(camera.T_world_cam, DOWN, atol=1e-9)
    assert cell.cameras.overhead.exposure_s == 0.012
    assert str(cell.cameras.overhead.calibrated) == "2026-03-02"


def test_arm_gripper_and_trays_are_where_they_were_measured(tmp_path: Path) -> None:
    layout = build_layout(load_cell(written(tmp_path, arm=ARM, fixed_gripper=FIXED, trays=TRAYS)))
    np.testing.assert_allclose(layout.T_world_arm, UPRIGHT)
    np.testing.assert_allclose(layout.T_world_fixed_tcp, UPRIGHT)
    assert layout.trays["accept"].centre_mm == (103.0, 388.0)
    # nothing is known of it along its pads but what the file has, and how far that may be off
    assert layout.fixed_held == pytest.approx((4.0, np.radians(1.0)))
    assert build_layout(load_cell(written(tmp_path, arm=ARM))).fixed_held == (0.0, 0.0)
    # stretched along x, its wrist level: by the lengths and zeros of the file, link by link
    shoulder, elbow, yaw = np.radians([0.4, -0.3, 0.2])
    heading = shoulder + elbow / 2 + yaw + 0.004 * elbow
    pitch, roll = np.radians([0.1, -0.5])
    x = 253.9 * np.cos(shoulder) + 253.2 * np.cos(shoulder + elbow)
    approach = np.array(
        [np.cos(heading) * np.cos(pitch), np.sin(heading) * np.cos(pitch), np.sin(pitch)]
    )
    level = np.array([-np.sin(heading), np.cos(heading), 0.0])
    across = np.cross(approach, level)
    jaws = np.cos(roll) * level + np.sin(roll) * across
    other = np.cross(approach, jaws)
    sag = 0.6 * np.cos(elbow / 2) ** 2
    wrist_x = x
    tcp = 176.7 * approach + 0.3 * jaws - 0.2 * other
    T = layout.arm.forward(np.zeros(6))
    assert T[0, 3] == pytest.approx(wrist_x + tcp[0], abs=1e-9)
    assert T[2, 3] == pytest.approx(915.0 + 0.25 - sag + tcp[2], abs=1e-9)
    np.testing.assert_allclose(T[:3, 1], jaws, atol=1e-12)


def test_the_column_goes_where_the_base_goes_that_it_stands_on(tmp_path: Path) -> None:
    drawn = build_layout(load_cell(written(tmp_path))).column
    c, s = np.cos(0.01), np.sin(0.01)  # leans about x
    leaning = [[1, 0, 0, 2.0], [0, c, -s, -1.0], [0, s, c, 0.5], [0, 0, 0, 1]]
    column = build_layout(load_cell(written(tmp_path, arm=ARM | {"T_world_arm": leaning}))).column
    x, y, z = drawn.T[:3, 3]
    expected = [x + 2.0, c * y - s * z - 1.0, s * y + c * z + 0.5]
    np.testing.assert_allclose(column.T[:3, 3], expected, atol=1e-9)
    np.testing.assert_allclose(column.T[:3, 2], [0, -s, c], atol=1e-9)
    np.testing.assert_array_equal(column.half_mm, drawn.half_mm)


def test_the_driver_of_the_arm_gets_play_and_jaws(tmp_path: Path) -> None:
    cell = load_cell(written(tmp_path, arm=ARM))
    settings = cell.devices.arm.settings
    assert settings["play_deg"] == {"shoulder": 0.2}
    assert settings["jaw_zero_mm"] == 0.4


def test_lamps_get_the_channels_that_were_found(tmp_path: Path) -> None:
    swapped = LAMPS | {
        "lamps": {
            "station_ring": LAMP,
            "station_side": LAMP | {"analog": 5, "relay": 4},
        }
    }
    lamps = load_cell(written(tmp_path, lamps=swapped)).lamps
    assert (lamps["station_ring"].analog, lamps["station_ring"].relay) == (4, 5)
    assert (lamps["station_side"].analog, lamps["station_side"].relay) == (5, 4)


def test_the_emulated_world_knows_nothing_of_calibrations(tmp_path: Path) -> None:
    path = written(tmp_path, overhead=CAMERA, arm=ARM, fixed_gripper=FIXED, trays=TRAYS)
    world = read_layout(path)
    assert world.cameras["overhead"].focal_px == 3571.0
    assert isinstance(world.arm.shape, UmiShape)
    assert world.arm.shape.upper_mm == 253.5
    assert world.fixed_gripper.T_world_tcp[0, 3] != 2.0


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (ARM | {"zero_deg": {"shoulder": 12.0}}, r"arm\.figures\.shoulder_rad.*another arm"),
        (HEADER | {**PLACED, "figures": {"elbow_rz_rad": 1e-4}}, r"elbow_rad.*another arm"),
        (HEADER | {**PLACED, "figures": {"upper_mm": 253.9}}, r"not of both.*calibrate this one"),
    ],
)
def test_figures_of_another_arm_are_refused(
    tmp_path: Path, body: dict[str, Any], message: str
) -> None:
    cell = load_cell(written(tmp_path, arm=body))
    with pytest.raises(ConfigError, match=message):
        build_layout(cell)


def test_play_of_a_motor_that_the_arm_has_not_is_refused_by_its_driver(tmp_path: Path) -> None:
    path = written(tmp_path, arm=ARM | {"play_deg": {"zed": 0.1}})
    with pytest.raises(ConfigError, match=r"devices\.arm\.settings.*play_deg: 'zed'"):
        require_drivers(path, load_cell(path))


def test_a_ur_arm_is_as_it_was_measured(tmp_path: Path) -> None:
    drawn = load_cell(UR_CELL)
    names = [one.name for one in measured_arm(build_layout(drawn)).unknowns]
    figures = dict.fromkeys(names, 0.0) | {"tool_x_mm": 0.4, "elbow_y_mm": -0.2}
    body = HEADER | {**PLACED, "kind": "arm", "figures": figures, "jaw_zero_mm": 0.3}
    path = written(tmp_path, UR_CELL.read_text(), arm=body)
    cell = load_cell(path)
    require_drivers(path, cell)
    assert cell.devices.arm.settings == {"jaw_zero_mm": 0.3}
    layout, before = build_layout(cell), build_layout(drawn)
    np.testing.assert_allclose(layout.T_world_arm, UPRIGHT)
    q = np.array([0.3, -1.2, 1.1, -0.7, 0.9, 0.2])
    R, _ = before.arm.link_frames(q[None])
    moved = -0.2 * R[0, 1, :, 1]  # the elbow, along the y axis of its own frame with elbow at 0
    T, T_before = layout.arm.forward(q), before.arm.forward(q)
    np.testing.assert_allclose(T[:3, :3], T_before[:3, :3], atol=1e-12)
    expected = T_before[:3, 3] + moved + 0.4 * T_before[:3, 0]
    np.testing.assert_allclose(T[:3, 3], expected, atol=1e-9)


def test_a_file_that_was_changed_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, overhead=CAMERA)
    (tmp_path / "cal" / "overhead.json").write_text(json.dumps(CAMERA | {"by": "B. Person"}))
    with pytest.raises(ConfigError, match=r"calibration\.overhead.*has changed since"):
        load_cell(path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    path = written(tmp_path, arm=ARM)
    (tmp_path / "cal" / "arm.json").unlink()
    with pytest.raises(ConfigError, match=r"calibration\.arm.*arm\.json.*No such file"):
        load_cell(path)


@pytest.mark.parametrize(
    ("name", "body", "message"),
    [
        ("arm", CAMERA, r"arm\.json: is of kind 'camera'; a calibration of kind `arm`"),
        ("overhead", CAMERA | {"size_px": [640, 480]}, r"640 x 480 px.*1280 x 1024"),
        ("overhead", CAMERA | {"cell": "other"}, r"of cell `other`"),
        ("overhead", CAMERA | {"measured": "2026-03-02T08:30:00"}, r"offset from UTC"),
        ("overhead", CAMERA | {"focal": 1}, r"focal"),
        ("overhead", CAMERA | {"K": [[3600, 1, 640], [0, 3600, 508], [0, 0, 1]]}, r"`K`"),
        ("overhead", CAMERA | {"schema": 2}, r"schema"),
        ("overhead", CAMERA | {"T_world_cam": UPRIGHT}, r"cameras.*overhead"),
        ("arm", ARM | {"T_world_arm": [[2, 0, 0, 0], *UPRIGHT[1:]]}, r"T_world_arm.*not a pose"),
        ("trays", TRAYS | {"centres": {"bin": [0, 0]}}, r"centres"),
        ("lamps", LAMPS | {"lamps": {"lamp": LAMP}}, r"has a lamp `lamp`"),
        ("lamps", LAMPS | {"lamps": {"station_ring": LAMP | {"analog": 5}}}, r"analog channel 5"),
    ],
)
def test_what_makes_no_sense_is_refused_with_its_place(
    tmp_path: Path, name: str, body: dict[str, Any], message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        load_cell(written(tmp_path, **{name: body}))


def test_no_json_is_no_calibration(tmp_path: Path) -> None:
    path = tmp_path / "arm.json"
    path.write_text("name: arm\n")
    with pytest.raises(ConfigError, match="not valid JSON"):
        read_calibration(path, "arm")


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    camera = CameraCalibration.model_validate(CAMERA)
    path = tmp_path / "new" / "overhead.json"
    digest = write_calibration(path, camera)
    assert read_calibration(path, "overhead") == camera
    assert digest == hashlib.sha256(path.read_bytes()).hexdigest()
    assert [one.name for one in path.parent.iterdir()] == ["overhead.json"]
