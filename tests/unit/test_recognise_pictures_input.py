"""Stored pictures of every kind: an answer, or one sentence and an exit code."""

from __future__ import annotations

import json
import struct
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from recognise_bench import CAMERA, Files, Grey, backlit, shape

from controller.cli import main
from controller.config import ConfigError
from controller.stored.pictures import pictures_among, read_picture

SIZE = (16, 12)
KEYS = {
    "image", "part", "stable_pose_R", "x_mm", "y_mm", "theta_deg", "score", "ambiguous_with",
    "seconds",  # conventions.md 7
    "pose_index", "sigma_mm", "sigma_deg", "T_world_part", "reason", "remarks", "lighting",
    "seconds_picture", "free_share", "touching_count", "is_cut", "images", "lies_on",
    "is_covered",
    "is_turn_free",
    "is_roll_free",
}  # fmt: skip


@pytest.fixture(scope="module")
def table() -> Grey:
    return backlit(shape(theta_rad=0.3))


@pytest.fixture
def files(tmp_path: Path) -> Files:
    return Files(tmp_path)


def ramp() -> Grey:
    """All of 12 x 16 levels, from 0 to 255."""
    return np.round(np.linspace(0, 255, 192)).astype(np.uint8).reshape(12, 16)


def stored(folder: Path, name: str, levels: NDArray[Any]) -> Path:
    path = folder / name
    assert cv2.imwrite(str(path), levels)
    return path


def png(header: bytes, *chunks: tuple[bytes, bytes]) -> bytes:
    """A PNG file from its parts, after its specification."""
    out = b"\x89PNG\r\n\x1a\n"
    for name, data in ((b"IHDR", header), *chunks, (b"IEND", b"")):
        out += struct.pack(">I", len(data)) + name + data
        out += struct.pack(">I", zlib.crc32(name + data))
    return out


def answers(told: str) -> list[dict[str, Any]]:
    """Every line is an object; nothing else is on stdout."""
    return [dict(json.loads(line)) for line in told.splitlines()]


# one picture


def test_a_grey_picture_is_read_as_it_is(tmp_path: Path) -> None:
    read = read_picture(stored(tmp_path, "grey.png", ramp()), SIZE)
    assert np.array_equal(read.grey, ramp())
    assert read.notes == ()


def test_grey_in_three_channels_is_grey_without_a_word(tmp_path: Path) -> None:
    read = read_picture(stored(tmp_path, "a.png", np.dstack([ramp()] * 3)), SIZE)
    assert np.array_equal(read.grey, ramp())
    assert read.notes == ()


def test_colour_is_turned_to_grey_by_brightness(tmp_path: Path) -> None:
    blue, green, red = ramp(), ramp()[::-1], ramp()[:, ::-1]
    read = read_picture(stored(tmp_path, "a.png", np.dstack([blue, green, red])), SIZE)
    # ITU-R BT.601
    expected = 0.299 * red + 0.587 * green + 0.114 * blue
    assert np.abs(read.grey - expected).max() <= 0.5
    assert read.notes == ("colour is turned to grey",)


def test_transparency_is_ignored_and_said(tmp_path: Path) -> None:
    see_through = np.dstack([ramp(), ramp(), ramp(), ramp()])
    read = read_picture(stored(tmp_path, "a.png", see_through), SIZE)
    assert np.array_equal(read.grey, ramp())
    assert read.notes == ("transparency is ignored",)
    opaque = np.dstack([ramp(), ramp(), ramp(), np.full_like(ramp(), 255)])
    assert read_picture(stored(tmp_path, "b.png", opaque), SIZE).notes == ()


def test_a_palette_is_followed(tmp_path: Path) -> None:
    # colour 0 is level 200, colour 1 is level 10; each row: filter byte 0, then the indices
    rows = b"".join(b"\0" + bytes((x + y) % 2 for x in range(16)) for y in range(12))
    header = struct.pack(">IIBBBBB", 16, 12, 8, 3, 0, 0, 0)
    path = tmp_path / "palette.png"
    path.write_bytes(
        png(header, (b"PLTE", bytes([200] * 3 + [10] * 3)), (b"IDAT", zlib.compress(rows)))
    )
    y, x = np.mgrid[0:12, 0:16]
    assert np.array_equal(read_picture(path, SIZE).grey, np.where((x + y) % 2, 10, 200))


@given(bits=st.sampled_from([10, 12, 14, 16]), seed=st.integers(0, 99))
def test_sixteen_bits_are_scaled_by_the_cameras_range(
    tmp_path_factory: pytest.TempPathFactory, bits: int, seed: int
) -> None:
    levels = np.random.default_rng(seed).integers(0, 2**bits, (12, 16)).astype(np.uint16)
    levels[0, :2] = 2**bits - 1, 1  # some place is as bright as it gets, and no bit is empty
    path = stored(tmp_path_factory.getbasetemp(), "deep.png", levels)
    read = read_picture(path, SIZE)
    assert np.abs(read.grey - levels * (255 / (2**bits - 1))).max() <= 0.5
    assert f"{bits} bits" in read.notes[0]


@pytest.mark.parametrize("bits", [10, 12, 14])
def test_levels_at_the_upper_end_of_sixteen_bits_are_known_by_empty_bits(
    tmp_path: Path, bits: int
) -> None:
    levels = np.random.default_rng(bits).integers(0, 2**bits, (12, 16)).astype(np.uint16)
    levels[0, :2] = 2 ** (bits - 1), 1
    read = read_picture(stored(tmp_path, "a.png", levels << (16 - bits)), SIZE)
    assert np.abs(read.grey - levels * (255 / (2**bits - 1))).max() <= 0.5
    assert read.notes == (f"levels of {bits} bits, stored at the upper end of 16",)


def test_levels_with_decimals_are_of_one_or_of_255(tmp_path: Path) -> None:
    unit = read_picture(stored(tmp_path, "a.tiff", (ramp() / 255).astype(np.float32)), SIZE)
    assert np.array_equal(unit.grey, ramp())
    whole = read_picture(stored(tmp_path, "b.tiff", ramp().astype(np.float32)), SIZE)
    assert np.array_equal(whole.grey, ramp())
    assert "0 to 1" in unit.notes[0]
    assert "8 bits" in whole.notes[0]


def test_levels_that_are_no_picture_are_refused(tmp_path: Path) -> None:
    hole = (ramp() / 255).astype(np.float32)
    hole[3, 3] = np.nan
    with pytest.raises(ConfigError, match="not numbers"):
        read_picture(stored(tmp_path, "a.tiff", hole), SIZE)
    with pytest.raises(ConfigError, match=r"below zero, down to -0\.5"):
        read_picture(stored(tmp_path, "b.tiff", (ramp() / 255 - 0.5).astype(np.float32)), SIZE)
    with pytest.raises(ConfigError, match=r"up to 2\.55e"):
        read_picture(stored(tmp_path, "c.tiff", ramp().astype(np.float32) * 1e6), SIZE)


def bad_files(folder: Path) -> dict[str, str]:
    """Files of which none is a picture to answer, and what is said of each."""
    whole = stored(folder, "whole.png", ramp()).read_bytes()
    jpeg = stored(folder, "whole.jpg", ramp()).read_bytes()
    tiff = stored(folder, "whole.tiff", ramp()).read_bytes()
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 0xFF
    nothing = png(struct.pack(">IIBBBBB", 0, 0, 8, 0, 0, 0, 0), (b"IDAT", zlib.compress(b"")))
    contents = {
        "empty.png": (b"", "the file is empty"),
        "text.png": (b"hello", "not a readable picture"),
        "half.png": (whole[: len(whole) // 2], "cut off or damaged"),
        "no_end.png": (whole[:-12], "cut off or damaged"),
        "flipped.png": (bytes(flipped), "cut off or damaged"),
        "half.jpg": (jpeg[: len(jpeg) // 2], "cut off or damaged"),
        "hole.jpg": (jpeg[: -len(jpeg) // 8] + jpeg[-2:], "cut off or damaged"),
        "half.tiff": (
            tiff[: len(tiff) // 2],
            "not a readable picture",
        ),  # its size stands at its end,
        "nothing.png": (nothing, "not a readable picture"),
        "short.png": (
            stored(folder, "x.png", ramp()[:5]).read_bytes(),
            "16 x 5 px, the calibration is for 16 x 12 px",
        ),
        "turned.png": (
            stored(folder, "y.png", np.ascontiguousarray(ramp().T)).read_bytes(),
            "12 x 16 px, the calibration is for 16 x 12 px",
        ),
    }
    for name, (data, _) in contents.items():
        (folder / name).write_bytes(data)
    return {name: words for name, (_, words) in contents.items()}


def test_every_bad_file_is_named_with_what_is_wrong(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for name, words in bad_files(tmp_path).items():
        with pytest.raises(ConfigError) as raised:
            read_picture(tmp_path / name, SIZE)
        assert str(raised.value).startswith(str(tmp_path / name))
        assert words in str(raised.value)
    with pytest.raises(ConfigError, match="No such file"):
        read_picture(tmp_path / "missing.png", SIZE)
    assert capfd.readouterr() == ("", "")  # decoders do not talk past the sentence


def test_a_folder_is_its_pictures_in_order_each_once(tmp_path: Path) -> None:
    for name in ("b.png", "a.TIFF", "truth.json", ".hidden.png"):
        (tmp_path / name).write_bytes(b"x")
    first, second = tmp_path / "a.TIFF", tmp_path / "b.png"
    assert pictures_among([tmp_path]) == ([first, second], [])
    found, remarks = pictures_among([second, tmp_path, tmp_path / "." / "b.png"])
    assert found == [second, first]
    assert remarks == [f"{second}: named twice, answered once"] * 2
    (tmp_path / "empty").mkdir()
    with pytest.raises(ConfigError, match="no picture in this folder"):
        pictures_among([tmp_path / "empty"])


# the command


def test_one_line_an_object_holds_what_was_promised(
    files: Files, capfd: pytest.CaptureFixture[str]
) -> None:
    both = backlit(shape(35.0, -25.0), shape(-40.0, 30.0))
    asked = files.command(files.keep("two.png", both), files.keep("none.png", backlit()))
    assert main(asked) == 0
    told = capfd.readouterr()
    lines = answers(told.out)
    assert [line["image"] for line in lines] == ["two.png"] * 2
    assert "none.png: nothing on the table" in told.err
    for line in lines:
        assert set(line) == KEYS
        assert line["lighting"] == "backlit"
        assert line["seconds_picture"] == pytest.approx(2 * line["seconds"])
        assert line["part"] == "elbow"
        assert 0 < line["sigma_mm"] < 0.2
        assert 0 < line["sigma_deg"] < 1.0
        T = np.array(line["T_world_part"])
        turn = np.radians(line["theta_deg"])
        c, s = np.cos(turn), np.sin(turn)
        about_z = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        np.testing.assert_allclose(T[:3, :3], about_z @ np.array(line["stable_pose_R"]), atol=0.01)


def test_a_stranger_has_a_reason_and_no_numbers_that_json_lacks(
    files: Files, capfd: pytest.CaptureFixture[str]
) -> None:
    picture = np.full(CAMERA.size_px[::-1], 210, np.uint8)
    cv2.ellipse(picture, (400, 320), (150, 60), 30, 0, 360, 18, -1)
    assert main(files.command(files.keep("egg.png", picture))) == 1
    (line,) = answers(capfd.readouterr().out)
    assert line["part"] is line["sigma_mm"] is line["sigma_deg"] is line["T_world_part"] is None
    assert line["pose_index"] == -1
    assert "none of the known parts" in line["reason"]


def test_bad_pictures_are_told_and_the_others_answered(
    files: Files, table: Grey, capfd: pytest.CaptureFixture[str]
) -> None:
    (files.pictures / "a_bad.png").write_bytes(b"hello")
    files.keep("b_good.png", table)
    (files.pictures / "c_empty.png").write_bytes(b"")
    files.keep("d_small.png", table[:100])
    assert main(files.command(files.pictures)) == 2
    told = capfd.readouterr()
    (line,) = answers(told.out)
    assert (line["image"], line["part"]) == ("b_good.png", "elbow")
    assert told.err.count("cellctl: ") == 3
    for name in ("a_bad.png", "c_empty.png", "d_small.png"):
        assert name in told.err


def test_conversions_are_said_once_a_run_and_told_in_every_line(
    files: Files, table: Grey, capfd: pytest.CaptureFixture[str]
) -> None:
    warm = cv2.cvtColor(table, cv2.COLOR_GRAY2BGR)
    warm[..., 0] //= 2
    asked = files.command(
        files.keep("a.png", warm),
        files.keep("b.png", warm),
        files.keep("c.png", table.astype(np.uint16) << 4),
    )
    assert main(asked) == 0
    told = capfd.readouterr()
    assert told.err.count("colour is turned to grey") == 1
    assert told.err.count("12 bits") == 1
    colour, again, deep = answers(told.out)
    assert "colour is turned to grey" in colour["remarks"]
    assert "colour is turned to grey" in again["remarks"]
    assert any("12 bits" in remark for remark in deep["remarks"])
    assert {line["part"] for line in (colour, again, deep)} == {"elbow"}


def test_a_picture_too_bright_or_too_dark_is_answered_with_a_remark(
    files: Files, table: Grey, capfd: pytest.CaptureFixture[str]
) -> None:
    bright = np.clip(table.astype(int) * 2, 0, 255).astype(np.uint8)
    asked = files.command(
        files.keep("bright.png", bright),
        files.keep("dim.png", table // 5),
        files.keep("black.png", table // 60),
    )
    assert main(asked) == 0
    told = capfd.readouterr()
    lit, dim = answers(told.out)
    assert lit["part"] == dim["part"] == "elbow"
    assert any("saturated" in remark for remark in lit["remarks"])
    assert any("under-exposed" in remark for remark in dim["remarks"])
    assert "bright.png: " in told.err
    assert "dim.png: under-exposed" in told.err
    assert "black.png: the table's level is" in told.err


def test_the_same_picture_twice_is_answered_once(
    files: Files, table: Grey, capfd: pytest.CaptureFixture[str]
) -> None:
    path = files.keep("a.png", table)
    assert main(files.command(path, files.pictures, path)) == 0
    told = capfd.readouterr()
    assert len(answers(told.out)) == 1
    assert told.err.count("named twice") == 2


def test_a_missing_calibration_and_one_of_another_size_are_told(
    files: Files, table: Grey, capfd: pytest.CaptureFixture[str]
) -> None:
    path = files.keep("a.png", table)
    asked = files.command(path)
    assert main([*asked[:-2], "nowhere.json", "--json"]) == 2
    assert "nowhere.json" in capfd.readouterr().err
    body = json.loads(files.calibration.read_text())
    files.calibration.write_text(json.dumps({**body, "size_px": [1280, 1024]}))
    assert main(asked) == 2
    told = capfd.readouterr()
    assert told.out == ""
    assert told.err.strip() == (
        f"cellctl: {path}: 800 x 640 px, the calibration is for 1280 x 1024 px"
    )


def test_explain_writes_a_drawing_and_the_stages(
    files: Files, table: Grey, capfd: pytest.CaptureFixture[str]
) -> None:
    path = files.keep("shot.png", table)
    other = files.folder / "other"
    other.mkdir()
    (other / "shot.png").write_bytes(path.read_bytes())
    folder = files.folder / "new" / "why"
    asked = [*files.command(path, other / "shot.png"), "--explain", str(folder)]
    assert main(asked) == 0
    assert len(answers(capfd.readouterr().out)) == 2  # nothing but answers
    for name in ("shot", "shot-2"):
        drawing = cv2.imread(str(folder / f"{name}.explain.png"))
        assert drawing is not None
        assert np.ptp(drawing.astype(int), axis=2).max() > 100  # in colour
        text = (folder / f"{name}.explain.txt").read_text(encoding="utf-8")
        assert "x [mm]" in text  # units in brackets are no mark-up
        body = json.loads((folder / f"{name}.explain.json").read_text(encoding="utf-8"))
        assert body["image"] == "shot.png"
        titles = [stage["title"] for stage in body["stages"]]
        assert titles[0] == "segmentation"
        assert titles[-1] == "object 1: decision"
        assert all(title in text for title in titles)


def test_explain_shows_the_stages_to_people_and_refuses_what_is_no_folder(
    files: Files, table: Grey, capfd: pytest.CaptureFixture[str]
) -> None:
    path = files.keep("shot.png", table)
    folder = files.folder / "why"
    asked = files.command(path, json_lines=False)
    assert main([*asked, "--explain", str(folder)]) == 0
    told = capfd.readouterr().out
    assert "object 1: candidates by silhouette" in told
    assert str(folder / "shot.explain.png") in told
    assert not (folder / "shot.explain.json").exists()
    assert main([*asked, "--explain", str(path)]) == 2
    assert f"--explain {path}" in capfd.readouterr().err
