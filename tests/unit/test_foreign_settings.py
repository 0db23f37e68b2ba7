"""Settings, lists and sets of views as other programs write them: encodings, commas, numbers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from controller.cad import CadError, load_solid
from controller.cli.inputs.calibration_file import load_calibration
from controller.cli.inputs.parts_list import load_parts_list
from controller.config import ConfigError, load_cell, load_recipe
from controller.config.files import parse_json, text_of
from controller.results.gauge import read_references

CELL = Path(__file__).resolve().parents[2] / "recipes" / "cells" / "emulated.yaml"
RECIPE = "name: {name}\npart: part.stl\ndensity_g_cm3: 2.7\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "part.stl").write_bytes(b"")
    return tmp_path


def recipe(folder: Path, data: bytes) -> Any:
    (folder / "a.yaml").write_bytes(data)
    return load_recipe(folder / "a.yaml")


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32"])
def test_a_recipe_is_read_in_each_encoding_that_its_bytes_tell(folder: Path, encoding: str) -> None:
    text = RECIPE.format(name="Gehaeuse") + "# größer\n"
    assert recipe(folder, text.encode(encoding)).name == "Gehaeuse"


def test_a_comment_may_be_in_any_code_page_and_a_value_may_not(folder: Path) -> None:
    text = "# für Müller\r" + RECIPE.format(name="plate").replace("\n", "\r")
    assert recipe(folder, text.encode("cp1252")).name == "plate"
    with pytest.raises(ConfigError, match=r"a\.yaml:1: .* is not text in UTF-8; save the file"):
        recipe(folder, RECIPE.format(name="Gehäuse").encode("cp1252"))


def test_a_decimal_comma_in_settings_is_answered_with_the_right_number(folder: Path) -> None:
    text = RECIPE.format(name="plate").replace("2.7", "2,7")
    with pytest.raises(ConfigError, match=r"density_g_cm3.*write a decimal point: 2\.7"):
        recipe(folder, text.encode())


@pytest.mark.parametrize("word", ["1e308", "-1e16", ".nan", ".inf", "1" + "0" * 400])
def test_a_wild_number_in_a_cell_file_is_named_with_its_key(tmp_path: Path, word: str) -> None:
    text = CELL.read_text(encoding="utf-8")
    at = text.index("glow")
    begin = text.index("x: [", at) + len("x: [")
    end = text.index(",", begin)
    (tmp_path / "cell.yaml").write_text(text[:begin] + word + text[end:])
    with pytest.raises(ConfigError) as caught:
        load_cell(tmp_path / "cell.yaml")
    assert str(caught.value).startswith(f"{tmp_path / 'cell.yaml'}:")
    assert "no number of sense" in str(caught.value) or "finite" in str(caught.value)


@pytest.mark.parametrize("word", ["1e308", "1e999", ".nan", "2,5"])
def test_a_wild_number_in_a_csg_text_is_named_with_its_key(tmp_path: Path, word: str) -> None:
    path = tmp_path / "a.csg.yaml"
    path.write_text(f"unit: mm\npart:\n  cylinder: {{radius: {word}, height: 20}}\n")
    with pytest.raises(CadError, match=r"a\.csg\.yaml:3: `?.*radius"):
        load_solid(path)


def test_a_csg_text_in_utf_16_with_a_comment_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.csg.yaml"
    text = "unit: mm # Maß\npart:\n  block: {size: [60, 40, 20]}\n"
    for encoding in ("utf-16", "cp1252", "utf-8-sig"):
        path.write_bytes(text.encode(encoding))
        assert load_solid(path).volume_mm3 == pytest.approx(48_000)


def test_a_wild_number_in_json_is_named_with_its_key(tmp_path: Path) -> None:
    for word in ("NaN", "-Infinity", "1e308", "1e999"):
        with pytest.raises(ConfigError, match=r"a\.json: `views\[1\]\.x`: .* no number of sense"):
            parse_json(f'{{"views": [{{}}, {{"x": {word}}}]}}', Path("a.json"), "a set")
    camera = {
        "size_px": [640, 480],
        "K": [[1e308, 0, 320], [0, 800, 240], [0, 0, 1]],
        "distortion": [0, 0, 0, 0, 0],
        "T_world_cam": [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 900], [0, 0, 0, 1]],
    }
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(camera))
    with pytest.raises(ConfigError, match=r"camera\.json: `K\[0\]\[0\]`: 1e\+308"):
        load_calibration(path)


def test_json_in_utf_16_is_read_and_in_a_code_page_refused_with_the_line() -> None:
    assert parse_json('{"a": "ä"}'.encode("utf-16"), Path("a.json"), "a set") == {"a": "ä"}
    with pytest.raises(ConfigError, match=r"a\.json: line 2 \(.*Gehäuse.*\) is not text in UTF-8"):
        parse_json('{\n"a": "Gehäuse"}'.encode("cp1252"), Path("a.json"), "a set")
    assert text_of("ä".encode(), Path("a.csv")) == "ä"


@pytest.mark.parametrize(
    ("text", "encoding"),
    [
        ("recipe;serial\nwidget;A1\n", "utf-8-sig"),
        ("recipe\tserial\r\nwidget\tA1\r\n", "utf-16"),
        ("sep=;\r\nrecipe;serial\r\nwidget;A1\r\n", "ascii"),
        ("recipe,serial\rwidget,A1\r", "ascii"),
    ],
)
def test_a_list_of_parts_is_read_as_spreadsheets_write_it(
    tmp_path: Path, text: str, encoding: str
) -> None:
    (tmp_path / "list.csv").write_bytes(text.encode(encoding))
    found = load_parts_list(tmp_path / "list.csv", "")
    assert [label.serial for _, label in found.labels] == ["A1"]


def test_a_list_in_a_code_page_is_refused_with_its_line(tmp_path: Path) -> None:
    (tmp_path / "list.csv").write_bytes("recipe;serial\nwidget;Prüf1\n".encode("cp1252"))
    with pytest.raises(ConfigError, match=r"line 2 \(widget;Prüf1\) is not text in UTF-8"):
        load_parts_list(tmp_path / "list.csv", "")


def test_reference_values_have_decimal_commas_where_semicolons_part_them(tmp_path: Path) -> None:
    path = tmp_path / "reference.csv"
    path.write_bytes("characteristic;value;U\nd1;12,345;0,004\n".encode("utf-16"))
    (one,) = read_references(path, ["d1"], [])
    assert (one.value, one.U) == (12.345, 0.004)
    path.write_text("characteristic;value\nd1;1e308\n")
    with pytest.raises(ConfigError, match=r"reference\.csv:2: value is '1e308'"):
        read_references(path, ["d1"], [])
