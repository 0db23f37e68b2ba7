"""The shipped recipes and cell, and the layout, cameras and lamps built from them."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from config_text import CELL_TEXT
from planning_cell import layout_of, read_cell

from controller.config import EMULATED, Cell, ConfigError, load_cell, load_recipe
from controller.setup.layout import build_layout
from controller.setup.optics import build_lamps, panel_corners, table_corners

ROOT = Path(__file__).resolve().parents[2]
RECIPES = sorted((ROOT / "recipes").glob("*.yaml"))
CELL_FILE = ROOT / "recipes" / "cells" / "emulated.yaml"


@pytest.fixture(scope="module")
def cell_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("cell") / "cell.yaml"
    path.write_text(CELL_TEXT, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def cell(cell_file: Path) -> Cell:
    return load_cell(cell_file)


@pytest.mark.parametrize("path", RECIPES, ids=lambda p: p.stem)
def test_a_shipped_recipe_loads_with_its_part_and_cell(path: Path) -> None:
    recipe = load_recipe(path)
    assert recipe.name == path.stem
    assert recipe.part.is_file()
    assert load_cell(recipe.cell).name == "emulated"


def test_file_names_are_relative_to_the_recipe_wherever_one_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cad").mkdir()
    for name in ("a.stl", "b.stl"):
        (tmp_path / "cad" / name).touch()
    recipe_file = tmp_path / "a.yaml"
    recipe_file.write_text("name: a\npart: cad/a.stl\nothers: [cad/b.stl]\ncell: c.yaml\n")
    monkeypatch.chdir(ROOT / "recipes")
    recipe = load_recipe(Path(os.path.relpath(recipe_file)))
    assert recipe.part.resolve() == tmp_path / "cad" / "a.stl"
    assert [p.resolve() for p in recipe.others] == [tmp_path / "cad" / "b.stl"]
    assert recipe.cell.resolve() == tmp_path / "c.yaml"


def test_an_absolute_file_name_stays(tmp_path: Path) -> None:
    part = tmp_path / "sub" / "a.stl"
    part.parent.mkdir()
    part.touch()
    recipe_file = tmp_path / "a.yaml"
    recipe_file.write_text(f"name: a\npart: {part}\n")
    assert load_recipe(recipe_file).part == part


@pytest.mark.parametrize("key", ["part", "others", "cell"])
@pytest.mark.parametrize("way", ["absolute", "up", "link"])
def test_what_a_recipe_names_lies_in_its_folder(key: str, way: str, tmp_path: Path) -> None:
    outside = tmp_path / "outside.stl"
    outside.touch()
    folder = tmp_path / "recipes"
    folder.mkdir()
    (folder / "a.stl").touch()
    (folder / "link.stl").symlink_to(outside)
    name = {"absolute": str(outside), "up": "../outside.stl", "link": "link.stl"}[way]
    value = f"[{name}]" if key == "others" else name
    lines = ["name: a", f"{key}: {value}"]
    lines += ["part: a.stl"] if key != "part" else []
    recipe_file = folder / "a.yaml"
    recipe_file.write_text("\n".join(lines) + "\n")
    with pytest.raises(ConfigError, match=rf"a\.yaml:2: `{key}`: .* outside the recipe's folder"):
        load_recipe(recipe_file)


def test_a_folder_of_recipes_may_itself_be_a_link(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "real" / "a.stl").touch()
    (tmp_path / "real" / "a.yaml").write_text("name: a\npart: a.stl\n")
    (tmp_path / "link").symlink_to(tmp_path / "real")
    assert load_recipe(tmp_path / "link" / "a.yaml").part.is_file()


def test_every_device_of_the_shipped_cell_is_emulated() -> None:
    assert load_cell(CELL_FILE).emulated_devices == (
        "arm", "gripper", "lights", "io", "overhead", "inspection",
    )  # fmt: skip


def test_one_line_makes_one_device_real(tmp_path: Path) -> None:
    mixed = tmp_path / "mixed.yaml"
    mixed.write_text(
        CELL_TEXT.replace(f"arm:         {{address: {EMULATED}}}", "arm: {address: /dev/ttyUSB0}"),
        encoding="utf-8",
    )
    assert load_cell(mixed).emulated_devices == (
        "gripper", "lights", "io", "overhead", "inspection",
    )  # fmt: skip


@pytest.mark.parametrize("shipped", [True, False])
def test_the_layout_is_the_one_read_from_the_file_by_hand(shipped: bool, cell_file: Path) -> None:
    path = CELL_FILE if shipped else cell_file
    built, expected = build_layout(load_cell(path)), layout_of(read_cell(path))
    assert built.arm.geometry == expected.arm.geometry
    assert built.arm.timing == expected.arm.timing
    for name in ("T_world_arm", "T_world_fixed_tcp", "station_mm", "park_q"):
        assert getattr(built, name) == pytest.approx(getattr(expected, name)), name
    assert [link.name for link in built.arm.links] == ["carriage", "upper", "fore"]
    for ours, theirs in zip(
        (built.column, *built.arm.links), (expected.column, *expected.arm.links), strict=True
    ):
        np.testing.assert_allclose(ours.T, theirs.T)
        assert ours.half_mm == pytest.approx(theirs.half_mm)
    assert len(built.obstacles) == len(expected.obstacles) == (15 if shipped else 3)
    for name, box in built.obstacles.items():
        if name.startswith("chute"):
            np.testing.assert_allclose(box.T, expected.obstacles[name].T, atol=1e-3)
            assert box.half_mm == pytest.approx(expected.obstacles[name].half_mm)
    assert built.trays == expected.trays
    for jaw, other in (
        (built.arm_gripper, expected.arm_gripper),
        (built.fixed_gripper, expected.fixed_gripper),
    ):
        assert len(jaw.body) == len(other.body)
        assert jaw.max_mm == other.max_mm
        assert jaw.pad_length_mm == other.pad_length_mm
        for a, b in zip(jaw.fingers(30.0), other.fingers(30.0), strict=True):
            np.testing.assert_allclose(a.T, b.T)
            assert a.half_mm == pytest.approx(b.half_mm)
    for camera, other_camera in (
        (built.overhead, expected.overhead),
        (built.inspection, expected.inspection),
    ):
        assert camera.size_px == other_camera.size_px
        np.testing.assert_allclose(camera.K, other_camera.K)
        assert camera.distortion == pytest.approx(other_camera.distortion)
        assert camera.T_world_cam == pytest.approx(other_camera.T_world_cam)


def test_the_overhead_camera_looks_down_and_the_inspection_camera_ahead(cell: Cell) -> None:
    layout = build_layout(cell)
    # frames follow OpenCV: z is the view
    assert layout.overhead.T_world_cam[:3, 2] == pytest.approx([0, 0, -1])
    assert layout.inspection.T_world_cam[:3, 2] == pytest.approx([0, 1, 0])
    (middle,) = layout.inspection.project(layout.station_mm[None])
    assert middle == pytest.approx([639.5, 511.5])
    # "picture up = away from the arm, right = the arm's right", as the file says
    here, ahead, right = layout.overhead.project(
        np.array([[360.0, 0, 0], [400, 0, 0], [360, -40, 0]])
    )
    assert ahead[1] < here[1] - 50
    assert right[0] > here[0] + 50


def test_every_pose_is_right_handed(cell: Cell) -> None:
    layout = build_layout(cell)
    for T in (
        layout.T_world_arm,
        layout.T_world_fixed_tcp,
        layout.overhead.T_world_cam,
        layout.inspection.T_world_cam,
    ):
        assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)


def test_degrees_of_the_file_are_radians_inside(cell: Cell) -> None:
    park = build_layout(cell).park_q
    assert park[0] == pytest.approx(80 * np.pi / 180)
    assert park[4] == pytest.approx(-np.pi / 2)


def test_a_ring_lamp_stands_round_the_axis_of_its_own_camera(cell: Cell) -> None:
    layout = build_layout(cell)
    table, station = build_lamps(cell, ("table_ring", "station_ring"))
    assert (table.name, station.name) == ("table_ring", "station_ring")
    for lamp, camera, centre in (
        (table, layout.overhead, cell.lamps["table_ring"].centre),
        (station, layout.inspection, cell.lamps["station_ring"].centre),
    ):
        away = lamp.points_mm - np.array(centre)
        assert len(away) >= 6
        assert np.linalg.norm(away, axis=1) == pytest.approx(60.0)
        assert away @ camera.T_world_cam[:3, 2] == pytest.approx(0.0, abs=1e-9)


def test_a_spot_is_one_point(cell: Cell) -> None:
    (side,) = build_lamps(cell, ("station_side",))
    assert side.points_mm == pytest.approx(np.array([[-120.0, -620.0, 820.0]]))


def test_the_panel_stands_where_the_file_says(cell: Cell) -> None:
    corners = panel_corners(cell, "station_backlight")
    # centre [350, 250, 450], faces -y, 350 wide along x and 290 high along z
    assert sorted(map(tuple, corners)) == sorted(
        (350 + sx * 175, 250, 450 + sz * 145) for sx in (-1, 1) for sz in (-1, 1)
    )
    # in order round it: neighbours share an edge
    edges = np.linalg.norm(corners - np.roll(corners, -1, axis=0), axis=1)
    assert sorted(edges) == pytest.approx([290, 290, 350, 350])
    with pytest.raises(ValueError, match="not a panel"):
        panel_corners(cell, "station_ring")


def test_the_glowing_area_lies_in_the_table(cell: Cell) -> None:
    corners = table_corners(cell)
    assert sorted(map(tuple, corners)) == [
        (180, -225, 0), (180, 225, 0), (540, -225, 0), (540, 225, 0),
    ]  # fmt: skip
    edges = np.linalg.norm(corners - np.roll(corners, -1, axis=0), axis=1)
    assert edges == pytest.approx([360, 450, 360, 450])


@pytest.mark.parametrize("shipped", [True, False])
def test_parts_are_dropped_where_the_camera_sees_the_table_glow(
    shipped: bool, cell_file: Path
) -> None:
    cell = load_cell(CELL_FILE if shipped else cell_file)
    layout, area = build_layout(cell), cell.table.drop_area
    corners = np.array([[x, y, 0.0] for x in area.x for y in area.y])
    pixels = layout.overhead.project(corners)
    assert (pixels > 0).all()
    assert (pixels < layout.overhead.size_px).all()
    glow = cell.table.glowing_area
    assert glow.x[0] < area.x[0] < area.x[1] < glow.x[1]
    assert glow.y[0] < area.y[0] < area.y[1] < glow.y[1]


WIRES = {
    "one unit of a bus": (("gripper:     {address: emulated", "gripper:     {address: 10.0.0.5"),
                          ("io:          {address: emulated, transport: tcp, unit: 1",
                           "io:          {address: 10.0.0.5, transport: tcp, unit: 9"),
                          "gripper and io have unit 9 at 10.0.0.5, both"),
    "a serial line": (("arm:         {address: emulated", "arm:         {address: /dev/ttyUSB0"),
                      ("gripper:     {address: emulated, transport: tcp",
                       "gripper:     {address: /dev/ttyUSB0, transport: rtu"),
                      "gripper and arm have /dev/ttyUSB0, both"),
    "one camera": (("overhead:    {address: emulated", "overhead:    {address: /dev/video0"),
                   ("inspection:  {address: emulated", "inspection:  {address: /dev/video0"),
                   "overhead and inspection have /dev/video0, both"),
    "a tray": (("accept:     {centre: [100, 390]", "accept:     {centre: [-40, 400]"), ("", ""),
               "accept and reject overlap"),
}  # fmt: skip


@pytest.mark.parametrize(("one", "other", "says"), WIRES.values(), ids=WIRES)
def test_what_two_cannot_share_is_refused(
    one: tuple[str, str], other: tuple[str, str], says: str, tmp_path: Path
) -> None:
    text = CELL_TEXT.replace(*one).replace(*other)
    assert text != CELL_TEXT
    path = tmp_path / "cell.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=says):
        load_cell(path)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (("gripper:     {address: emulated", "gripper:     {address: 10.0.0.5"),
         ("io:          {address: emulated", "io:          {address: 10.0.0.5")),
        (("arm:         {address: emulated", "arm:         {driver: ur, address: 10.0.0.9"),
         ("gripper:     {address: emulated", "gripper:     {address: 10.0.0.9")),
    ],
    ids=["units of a gateway", "a gripper on the arm's tool"],
)  # fmt: skip
def test_what_two_may_share_is_taken(
    one: tuple[str, str], other: tuple[str, str], tmp_path: Path
) -> None:
    path = tmp_path / "cell.yaml"
    path.write_text(CELL_TEXT.replace(*one).replace(*other), encoding="utf-8")
    load_cell(path)
