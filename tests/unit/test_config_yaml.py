"""Wrong recipe and cell files: every problem at once, each with file, line and correction."""

from __future__ import annotations

import gc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from config_text import CELL_TEXT

from controller.config import ConfigError, load_cell, load_recipe

RECIPE_TEXT = """\
name: block
part: block.stl        # line 2
inspection:
  min_coverage: 0.9    # line 4
grasp:
  force_n: 60
count: 3
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "block.stl").write_bytes(b"any")
    return tmp_path


def told(load: Callable[[Path], Any], path: Path) -> list[str]:
    """The lines of the refusal; each begins with the file."""
    with pytest.raises(ConfigError) as caught:
        load(path)
    lines = str(caught.value).split("\n")
    assert all(line.startswith(str(path)) for line in lines), lines
    return [line.removeprefix(str(path)) for line in lines]


def wrong_recipe(folder: Path, old: str, new: str) -> list[str]:
    assert RECIPE_TEXT.count(old) == 1
    path = folder / "block.yaml"
    path.write_text(RECIPE_TEXT.replace(old, new))
    return told(load_recipe, path)


def wrong_cell(folder: Path, old: str, new: str) -> list[str]:
    assert old in CELL_TEXT
    path = folder / "cell.yaml"
    path.write_text(CELL_TEXT.replace(old, new, 1), encoding="utf-8")
    return told(load_cell, path)


def line_of(old: str) -> int:
    return CELL_TEXT[: CELL_TEXT.index(old)].count("\n") + 1


def test_the_recipe_the_tests_begin_with_is_right(folder: Path) -> None:
    (folder / "block.yaml").write_text(RECIPE_TEXT)
    recipe = load_recipe(folder / "block.yaml")
    assert (recipe.name, recipe.count, recipe.grasp.force_n) == ("block", 3, 60.0)


OLD_NAMES = {  # of keys that files may still have: by the new name, with the line that begins it
    "grasp": ("grip", "grasp:"),
    "arm_gripper": ("hand", "  arm_gripper:"),
    "fixed_gripper": ("fixture", "fixed_gripper:"),
    "part_in_fixed_gripper": ("part_in_fixture", "  part_in_fixed_gripper:"),
}


def in_old_names(text: str) -> str:
    """Return a file as it was written before its keys were renamed."""
    for name, (old, key) in OLD_NAMES.items():
        text = text.replace(f"\n{key}", f"\n{key.replace(name, old)}")
    return text


def test_files_with_the_old_names_of_keys_mean_the_same(folder: Path) -> None:
    new, old = folder / "new.yaml", folder / "old.yaml"
    new.write_text(RECIPE_TEXT)
    old.write_text(in_old_names(RECIPE_TEXT))
    assert "\ngrip:" in old.read_text()
    assert load_recipe(old) == load_recipe(new)
    assert load_recipe(new).model_dump(by_alias=True)["grip"]["force_n"] == 60.0  # JSON keeps it
    new.write_text(CELL_TEXT)
    old.write_text(in_old_names(CELL_TEXT))
    assert not any(name in old.read_text() for name in OLD_NAMES)
    assert load_cell(old) == load_cell(new)
    body = load_cell(new).model_dump(by_alias=True)
    assert {"fixture", "hand", "part_in_fixture"} <= {*body, *body["arm"], *body["interlocks"]}


@pytest.mark.parametrize("name", ["arm_gripper", "fixed_gripper", "part_in_fixed_gripper"])
def test_a_key_under_its_old_and_its_new_name_is_refused_with_both_lines(
    folder: Path, name: str
) -> None:
    old, key = OLD_NAMES[name]
    (begun,) = (row for row in CELL_TEXT.splitlines() if row.startswith(key))
    twin = begun.replace(name, old) + (" {}\n" if begun.endswith(":") else "\n")
    (message,) = wrong_cell(folder, begun, twin + begun)
    line = line_of(f"\n{begun}") + 1
    assert message.startswith(f":{line}: `"), message
    assert f"{old}` is the old name of `{name}` on line {line + 1}; leave one out" in message


def test_a_recipe_with_both_names_of_a_key_is_refused_with_both_lines(folder: Path) -> None:
    (message,) = wrong_recipe(folder, "count: 3", "grip:\n  force_n: 50\ncount: 3")
    assert message == ":7: `grip` is the old name of `grasp` on line 5; leave one out"


@pytest.mark.parametrize(
    ("old", "new", "line", "key", "near"),
    [
        ("count: 3", "cout: 3", 7, "cout", "count"),
        ("part: block.stl", "part: block.stl\nothrs: []", 3, "othrs", "others"),
        ("min_coverage: 0.9", "min_coverag: 0.9", 4, "inspection.min_coverag", "min_coverage"),
        ("force_n: 60", "force: 60", 6, "grasp.force", "force_n"),
    ],
)
def test_an_unknown_key_of_a_recipe_is_answered_with_the_nearest(
    folder: Path, old: str, new: str, line: int, key: str, near: str
) -> None:
    (message,) = wrong_recipe(folder, old, new)
    assert message == f":{line}: unknown key `{key}`; did you mean `{near}`?"


@pytest.mark.parametrize(
    ("old", "new", "key", "near"),
    [
        ("interlocks:", "interlock: {door: 1}\ninterlocks:", "interlock", "interlocks"),
        ("unit: 9", "units: 9", "devices.gripper.units", "unit"),
        ("exposure_s: 0.010", "exposure: 0.010", "cameras.overhead.exposure", "exposure_s"),
        ("radius: 60", "radus: 60", "lamps.table_ring.radus", "radius"),
        ("post: ", "posts: [0, 1, 0, 1, 0, 1]\n  post: ", "fixed_gripper.posts", "post"),
        ("x: [180, 540],", "x: [180, 540], yy: 1,", "table.glowing_area.yy", "y"),
        ("thickness_mm: 8,", "thickness_mm: 8, widht_mm: 1,", "arm.fingers.widht_mm", "width_mm"),
        ("roll: 0}", "roll: 0, rol: 1}", "arm.park_deg.rol", "roll"),
        (
            "size: [140, 140]}",
            "size: [140, 140], centr: 1}",
            "trays.quarantine.centr",
            "centre",
        ),
        (
            "{position: [360, 0, 1250],",
            "{position: [360, 0, 1250], xaxis: 1,",
            "cameras.overhead.pose.xaxis",
            "x_axis",
        ),
    ],
)
def test_an_unknown_key_of_a_cell_is_answered_at_every_level(
    folder: Path, old: str, new: str, key: str, near: str
) -> None:
    messages = wrong_cell(folder, old, new)
    word = key.split(".")[-1]
    line = line_of(old) + new[: new.index(word)].count("\n")
    assert messages == [f":{line}: unknown key `{key}`; did you mean `{near}`?"]


def test_a_key_like_no_other_is_answered_with_all_there_are(folder: Path) -> None:
    (message,) = wrong_recipe(folder, "force_n: 60", "qqq: 60")
    assert (
        message == ":6: unknown key `grasp.qqq`; known here: force_n, friction, width_tolerance_mm"
    )


def test_a_misspelt_key_that_must_be_there_is_missing_and_unknown(folder: Path) -> None:
    messages = wrong_cell(folder, "  gripper:     {", "  griper:     {")
    line = line_of("  gripper:     {")
    assert messages == [
        f":{line_of('devices:')}: `devices.gripper` is missing",
        f":{line}: unknown key `devices.griper`; did you mean `gripper`?",
    ]


def test_a_missing_key_is_told_with_the_section_that_lacks_it(folder: Path) -> None:
    assert wrong_recipe(folder, "name: block\n", "") == [": `name` is missing"]
    (message,) = wrong_cell(folder, "    focal_px: 3733.0\n", "")
    line = line_of("  inspection:\n")
    assert message == f":{line}: `cameras.inspection.focal_px` is missing"


def test_a_lamp_the_cell_cannot_do_without_is_named(folder: Path) -> None:
    (message,) = wrong_cell(folder, "  station_ring:", "  station_rings:")
    assert message == ": `lamps` lacks station_ring"


def test_a_link_of_the_arm_that_is_not_there_is_named(folder: Path) -> None:
    messages = wrong_cell(folder, "    carriage:", "    carrriage:")
    assert f":{line_of('  links:')}: `arm.links.carriage` is missing" in messages


@pytest.mark.parametrize(
    ("old", "new", "line", "part"),
    [
        ("0.9 ", "much", 4, "`inspection.min_coverage`: Input should be a valid number"),
        ("0.9 ", "1.5 ", 4, "less than or equal to 1 (found 1.5)"),
        ("0.9 ", ".nan", 4, "finite number (found nan)"),
        ("0.9 ", ".inf", 4, "finite number (found inf)"),
        ("0.9 ", "true", 4, "`inspection.min_coverage`: true and false are not allowed here"),
        ("count: 3", "count: true", 7, "`count`: true and false are not allowed here"),
        ("count: 3", "count: 2.5", 7, "`count`: Input should be a valid integer"),
        ("count: 3", "count: 0", 7, "greater than or equal to 1 (found 0)"),
        ("name: block", "name: 2026", 1, "`name`: must be text; put it in quotes"),
        ("name: block", "name: 2026-11-21", 1, "`name`: must be text; put it in quotes"),
        ("name: block", "name: a/b", 1, "folder"),
        ("name: block", "name: ''", 1, "folder"),
        ("part: block.stl", "part:", 2, "`part`: must be the name of a file (found None)"),
        (
            "grasp:\n  force_n: 60",
            "grasp: 60",
            5,
            "`grasp`: must be a section of `key: value` lines",
        ),
        ("count: 3", "others: a.stl", 7, "`others`: must be a list, as in [a, b]"),
        ("count: 3", "density_g_cm3: -1", 7, "greater than 0 (found -1)"),
    ],
)
def test_a_value_of_the_wrong_kind_or_size_is_told_with_its_line(
    folder: Path, old: str, new: str, line: int, part: str
) -> None:
    (message,) = wrong_recipe(folder, old, new)
    assert message.startswith(f":{line}: "), message
    assert part in message


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        ("x_axis: [0, -1, 0]", "x_axis: [0, -1, 1]", "`cameras.overhead.pose`: x_axis and y_axis"),
        (
            "x: [180, 540]",
            "x: [540, 180]",
            "`table.glowing_area.x`: bounds must go from low to high",
        ),
        ("[-160, -67.5, -90, 90, 0, 1082]", "[-160, -67.5, 90, -90, 0, 1082]", "`arm.links.column"),
        ("[-160, -67.5, -90, 90, 0, 1082]", "[-160, -67.5, -90, 90, 0]", "has too few values"),
        ("size_px: [1280, 1024]", "size_px: [1280, 0]", "`cameras.overhead.size_px`: sizes must"),
        ("size: [150, 150]", "size: [150, -150]", "`trays.accept.size`: sizes must be more than 0"),
        ("kind: ring", "kind: bulb", "`lamps.table_ring.kind`: Input should be 'panel', 'ring'"),
        ("normal: [0, 0, 1], ", "", "`lamps.table_backlight`: a panel needs normal, up and size"),
        (
            "normal: [0, 0, 1]",
            "normal: [1, 0, 0]",
            "normal and up must be of length 1 and",
        ),
        ("door: 1", "door: 0", "`interlocks`: input 0 is given to both emergency_stop and door"),
        ("door: 1", "door: 6", "`interlocks.door`: Input should be less than or equal to 5"),
        (
            "relay_unit: 2",
            "relay_unit: 1",
            "`devices.lights`: both modules on one line",
        ),
        (
            "unit: 9",
            "unit: 300",
            "`devices.gripper.unit`: Input should be less than",
        ),
        ("transport: tcp, unit: 9", "transport: udp, unit: 9", "'tcp', 'rtu' or 'rtu-tcp'"),
        ("fps: 10", "fps: 0", "`cameras.overhead.fps`: Input should be greater than 0"),
    ],
)
def test_a_cell_that_cannot_be_is_refused_where_it_is_written(
    folder: Path, old: str, new: str, part: str
) -> None:
    (message,) = wrong_cell(folder, old, new)
    assert part in message
    line = int(message.split(":")[1])
    # the line itself, or the head of the section that does not fit together
    assert line_of(old) - 6 <= line <= line_of(old)


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("{analog: 2, relay: 2", "{analog: 1, relay: 2", "analog channel 1"),
        ("{analog: 2, relay: 2", "{analog: 2, relay: 1", "relay 1"),
    ],
)
def test_two_lamps_on_one_channel_are_named(folder: Path, old: str, new: str, what: str) -> None:
    (message,) = wrong_cell(folder, old, new)
    assert message == f": `lamps`: {what} is given to both table_ring and table_side"


def test_all_troubles_are_told_at_once_in_the_order_of_the_file(folder: Path) -> None:
    path = folder / "many.yaml"
    path.write_text(
        "part: block.stl\ninspection:\n  min_coverage: 7\n  colour: red\ngrasp: 3\ncount: x\n"
    )
    messages = told(load_recipe, path)
    assert [m.split(":")[1].strip() for m in messages] == ["`name` is missing", "3", "4", "5", "6"]


@pytest.mark.parametrize("text", ["", "\n\n", "# only a comment\n", "---\n", "just words\n"])
@pytest.mark.parametrize("load", [load_recipe, load_cell])
def test_a_file_without_keys_says_so(folder: Path, load: Callable[[Path], Any], text: str) -> None:
    path = folder / "empty.yaml"
    path.write_text(text)
    (message,) = told(load, path)
    assert message == ": is empty or not a list of `key: value` lines"


def test_a_list_is_not_a_recipe(folder: Path) -> None:
    path = folder / "list.yaml"
    path.write_text("- name: a\n- name: b\n")
    assert "not a list of `key: value` lines" in told(load_recipe, path)[0]


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("name: x\n\tpart: y\n", 2),
        ("name: x\npart: [a, b\ncount: 3\n", 3),
        ("name: x\nname: y\n", 2),
        ("name: x\n---\nname: y\n", 2),
        ("name: 'x\n", 2),
    ],
)
def test_what_is_no_yaml_is_told_with_its_line(folder: Path, text: str, line: int) -> None:
    path = folder / "broken.yaml"
    path.write_text(text)
    (message,) = told(load_recipe, path)
    assert message.startswith(f":{line}: not valid YAML: ")


@pytest.mark.parametrize("data", [bytes(range(256)), b"\x80\x81", "Größe".encode("latin-1")])
def test_a_binary_file_is_asked_for_the_right_one(folder: Path, data: bytes) -> None:
    path = folder / "picture.png"
    path.write_bytes(data)
    (message,) = told(load_recipe, path)
    assert "not a text file" in message or "not text in UTF-8; save the file as" in message


def test_a_stray_control_character_is_one_sentence(folder: Path) -> None:
    path = folder / "nul.yaml"
    path.write_bytes(b"name: a\x00b\n")
    (message,) = told(load_recipe, path)
    assert "not valid YAML" in message


def test_a_missing_file_and_a_folder_are_told(folder: Path) -> None:
    assert "no such file" in told(load_recipe, folder / "gone.yaml")[0].lower()
    assert "directory" in told(load_cell, folder)[0]


def test_a_byte_order_mark_of_a_windows_editor_does_no_harm(folder: Path) -> None:
    path = folder / "block.yaml"
    path.write_bytes(b"\xef\xbb\xbf" + RECIPE_TEXT.replace("\n", "\r\n").encode())
    assert load_recipe(path).name == "block"


def test_a_part_that_is_not_there_is_told_with_those_that_are(folder: Path) -> None:
    (folder / "other.obj").write_text("")
    (folder / "notes.txt").write_text("")
    (message,) = wrong_recipe(folder, "block.stl", "blok.stl")
    assert message.endswith("the folder has block.stl, other.obj")
    assert str(folder / "blok.stl") in message


def test_a_part_in_a_folder_that_is_not_there_is_told(folder: Path) -> None:
    (message,) = wrong_recipe(folder, "block.stl", "nowhere/block.stl")
    assert "there is no CAD file in" in message


def test_another_part_that_is_not_there_is_told_too(folder: Path) -> None:
    (message,) = wrong_recipe(folder, "count: 3", "others: [gone.stl]")
    assert "gone.stl" in message


def test_a_file_that_was_read_leaves_nothing_behind(folder: Path) -> None:
    path = folder / "block.yaml"
    path.write_text(RECIPE_TEXT, encoding="utf-8")

    def node_count() -> int:
        gc.collect()
        return sum(type(one).__module__ == "ruamel.yaml.nodes" for one in gc.get_objects())

    load_recipe(path)
    before = node_count()
    load_recipe(path)
    assert node_count() == before
