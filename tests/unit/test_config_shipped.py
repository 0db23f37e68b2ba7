"""What comes with cellctl is found from any folder; a project's own recipe comes first."""

from __future__ import annotations

from pathlib import Path

import pytest

from controller.config import (
    EMULATED_CELL,
    ConfigError,
    find_recipe,
    load_cell,
    load_recipe,
    project_recipe,
)

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_emulated_cell_is_the_one_in_the_house() -> None:
    assert load_cell(EMULATED_CELL) == load_cell(ROOT / "recipes/cells/emulated.yaml")


def test_the_metrology_cell_is_the_emulated_one_with_a_finer_camera() -> None:
    plain, fine = (load_cell(ROOT / f"recipes/cells/{n}.yaml") for n in ("emulated", "metrology"))
    named = {"name": "", "inspection": None}
    same = [
        {**cell.model_dump(), "name": "", "cameras": {**cell.model_dump()["cameras"], **named}}
        for cell in (plain, fine)
    ]
    for cell in same:
        for name, lamp in cell["lamps"].items():
            if name.startswith("station"):
                lamp["full_grey"] = None  # by the camera at the station, which is another one
    assert same[0] == same[1]
    camera = fine.cameras.inspection
    assert camera.size_px == (2448, 2048)
    away_mm = fine.station.position[1] - camera.pose.position[1]
    assert 1e3 * away_mm / camera.focal_px == pytest.approx(41.0, abs=0.5)  # um a pixel


def test_the_ur5e_cell_is_the_emulated_one_with_another_arm() -> None:
    umi, ur = (
        load_cell(ROOT / f"recipes/cells/{n}.yaml").model_dump() for n in ("emulated", "ur5e")
    )
    assert ur["devices"].pop("arm")["driver"] == "ur"
    for cell in (umi, ur):
        cell["devices"].pop("arm", None)
        del cell["name"], cell["arm"]
    assert umi == ur


def test_a_bare_name_means_a_recipe_that_comes_with_cellctl() -> None:
    recipe = load_recipe(find_recipe(Path("holder")))
    assert recipe.name == "holder"
    assert recipe.part.is_file()


def test_a_file_of_that_name_comes_first(elsewhere: Path) -> None:
    (elsewhere / "holder").write_text("name: mine\n")
    assert find_recipe(Path("holder")) == Path("holder")


def test_without_a_name_the_projects_recipe_comes_before_the_default(elsewhere: Path) -> None:
    assert project_recipe() is None
    assert load_recipe(find_recipe(None)).name == "featuretype"
    (elsewhere / "recipe.yaml").write_text("name: mine\n")
    assert find_recipe(None) == Path("recipe.yaml")


def test_a_bare_name_that_is_unknown_is_answered_with_those_there_are() -> None:
    with pytest.raises(ConfigError, match=r"flange: no such file, .* flange_xy, holder"):
        find_recipe(Path("flange"))


def test_a_recipe_that_names_no_cell_gets_the_emulated_one(elsewhere: Path) -> None:
    (elsewhere / "holder.stl").write_bytes((ROOT / "recipes/parts/holder.stl").read_bytes())
    path = elsewhere / "recipe.yaml"
    path.write_text("name: mine\npart: holder.stl\n")
    assert load_recipe(path).cell == EMULATED_CELL
    (elsewhere / "cells").mkdir()
    beside = elsewhere / "cells" / "emulated.yaml"
    beside.write_text(EMULATED_CELL.read_text())
    assert load_recipe(path).cell == beside


def test_a_cell_that_a_recipe_names_is_never_replaced(elsewhere: Path) -> None:
    (elsewhere / "holder.stl").write_bytes((ROOT / "recipes/parts/holder.stl").read_bytes())
    path = elsewhere / "recipe.yaml"
    path.write_text("name: mine\npart: holder.stl\ncell: cells/emulated.yaml\n")
    assert load_recipe(path).cell == elsewhere / "cells" / "emulated.yaml"
