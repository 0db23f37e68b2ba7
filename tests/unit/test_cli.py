"""The command line: every mistake gives one sentence and an exit code."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from controller.cli import main

ROOT = Path(__file__).parents[2]
HOLDER = ROOT / "recipes/parts/holder.stl"
CELL = ROOT / "recipes/cells/emulated.yaml"


def recipe(folder: Path, text: str) -> str:
    path = folder / "recipe.yaml"
    path.write_text(text)
    return str(path)


def test_no_command_shows_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    told = capsys.readouterr()
    assert "report" in told.out + told.err


def test_an_unknown_command_is_the_command_lines_fault(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["frobnicate"]) == 2
    assert "frobnicate" in capsys.readouterr().err


def test_a_missing_recipe_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "nowhere.yaml"]) == 2
    assert "nowhere.yaml" in capsys.readouterr().err


def test_a_wrong_key_is_answered_with_line_and_right_key(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = recipe(tmp_path, f"name: x\npart: {HOLDER}\ngrasp:\n  forse_n: 3\n")
    assert main(["run", path]) == 2
    said = capsys.readouterr().err
    assert f"{path}:4" in said
    assert "did you mean `force_n`?" in said


def test_an_unknown_part_tells_which_there_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "other.stl").write_bytes(HOLDER.read_bytes())
    path = recipe(tmp_path, "name: x\npart: bracket.stl\n")
    assert main(["check", path]) == 2
    said = capsys.readouterr().err
    assert "unknown part" in said
    assert "other.stl" in said


def test_an_open_surface_is_refused_before_anything_starts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    box = trimesh.creation.box(extents=[30, 20, 10])
    box.update_faces(np.arange(len(box.faces)) > 0)
    box.export(tmp_path / "open.stl")
    path = recipe(tmp_path, "name: x\npart: open.stl\n")
    assert main(["run", path, "--cell", str(CELL)]) == 2
    said = capsys.readouterr().err
    assert "not closed" in said
    assert "open.stl" in said


def test_an_empty_cad_file_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "empty.stl").write_bytes(b"\0" * 80 + b"\0\0\0\0")
    path = recipe(tmp_path, "name: x\npart: empty.stl\n")
    assert main(["run", path, "--cell", str(CELL)]) == 2
    assert "empty.stl" in capsys.readouterr().err


def test_time_cannot_run_faster_on_real_devices(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (ROOT / "recipes/cells/emulated.yaml").read_text()
    cell = tmp_path / "cell.yaml"
    cell.write_text(
        text.replace("arm:         {address: emulated}", "arm: {address: /dev/ttyUSB9}")
    )
    (tmp_path / "holder.stl").write_bytes(HOLDER.read_bytes())
    path = recipe(tmp_path, "name: x\npart: holder.stl\ncell: cell.yaml\n")
    assert main(["run", path, "--speed", "10"]) == 2
    assert "real devices" in capsys.readouterr().err


def test_a_report_of_no_run_says_where_it_looked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["report", "--runs", str(tmp_path)]) == 1
    assert str(tmp_path) in capsys.readouterr().err


def test_compile_answers_in_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compile", str(HOLDER), "--json"]) == 0
    body = json.loads(capsys.readouterr().out)
    assert body["part"] == "holder"
    likely = body["stable_poses"][0]
    assert np.allclose(np.array(likely["R"]) @ np.array(likely["R"]).T, np.eye(3))
    # a turned disc, 76.2 mm across and 12.7 mm high (parts manifest): two faces to lie on
    assert sum(p["probability"] > 0.3 for p in body["stable_poses"]) == 2


def test_a_place_that_is_no_place_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    cell = str(ROOT / "recipes/cells/emulated.yaml")
    assert main(["plan", str(HOLDER), "--cell", cell, "--at", "300,20"]) == 2
    assert "X,Y,THETA" in capsys.readouterr().err


def test_a_picture_that_is_none_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    calibration = tmp_path / "camera.json"
    calibration.write_text(
        json.dumps(
            {
                "size_px": [640, 480],
                "K": [[3000, 0, 320], [0, 3000, 240], [0, 0, 1]],
                "distortion": [0, 0, 0, 0, 0],
                "T_world_cam": [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 900], [0, 0, 0, 1]],
            }
        )
    )
    picture = tmp_path / "table.png"
    picture.write_text("no picture")
    asked = ["recognise", str(picture), "--parts", str(HOLDER), "--calibration", str(calibration)]
    assert main(asked) == 2
    assert "not a readable picture" in capsys.readouterr().err


def test_a_calibration_that_is_none_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    calibration = tmp_path / "camera.json"
    calibration.write_text("{}")
    picture = tmp_path / "table.png"
    picture.touch()
    asked = ["recognise", str(picture), "--parts", str(HOLDER), "--calibration", str(calibration)]
    assert main(asked) == 2
    assert "no camera calibration" in capsys.readouterr().err
