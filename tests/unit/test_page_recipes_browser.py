"""*Recipes* in Chromium: a part in three dimensions, limits changed, a file sent."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytest.importorskip("starlette", reason="the page's packages are not installed (extra `page`)")

from cad_solids import box, mesh_of, rod
from test_page_browser import (
    CHROMIUM,
    Served,
    chromium,
    grave,
    require_sound_on_all_screens,
    tab,
    until,
)

from controller.config import load_recipe
from controller.page.security import Role

__all__ = ["chromium", "tab"]  # fixtures

pytestmark = pytest.mark.skipif(not CHROMIUM.is_file(), reason="no Chromium at /usr/bin/chromium")
RECIPE = "name: block\npart: parts/block.stl\nunit: mm\ninspection:\n  min_coverage: 0.5  # kept\n"
PATIENT_MS = 120_000  # a child process starts, compiles and draws


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A page of a project with a recipe of a block of 40 x 30 x 10 mm with a bore of 10 mm."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (tmp_path / "parts").mkdir()
    (tmp_path / "runs").mkdir()
    mesh_of(box(40, 30, 10) - rod(5, 20, 64)).export(tmp_path / "parts" / "block.stl")
    (tmp_path / "block.yaml").write_text(RECIPE)
    found = Served(tmp_path, monkeypatch)
    yield found
    found.end()


def test_a_limit_is_changed_its_difference_seen_and_the_file_written(
    site: Served, tab: Any, tmp_path: Path
) -> None:
    tab.set_default_timeout(PATIENT_MS)
    tab.goto(site.link(Role.ENGINEER))
    tab.goto(f"{site.origin}/recipes")
    tab.click("text=block.yaml")
    tab.wait_for_selector("#rows tr")  # compiled by itself
    tab.wait_for_selector("canvas[data-drawn]")
    assert tab.locator("#poses img").count() >= 2
    row = "#rows tr[data-id='hole 10 mm diameter']"
    assert tab.input_value(f"{row} [data-field=nominal]") == "10"
    tab.fill(f"{row} [data-field=upper]", "ten")
    assert tab.is_disabled("#draft")
    tab.fill(f"{row} [data-field=upper]", "10,05")
    tab.fill(f"{row} [data-field=lower]", "9.95")
    assert tab.is_disabled("#save")
    tab.click("#draft")
    tab.wait_for_selector("#diff", state="visible")
    assert "+      upper: 10.05" in tab.inner_text("#diff")
    assert (tmp_path / "block.yaml").read_text() == RECIPE
    tab.click("#save")
    until(tab, lambda: "10.05" in (tmp_path / "block.yaml").read_text())
    assert (tmp_path / "block.yaml").read_text().startswith(RECIPE)
    until(tab, lambda: "recipe" in tab.inner_text(row))  # compiled anew: who states the limits


def test_axe_finds_nothing_serious_and_nothing_is_wider_than_a_phone(
    site: Served, tab: Any
) -> None:
    tab.set_default_timeout(PATIENT_MS)
    tab.goto(site.link(Role.ENGINEER))
    tab.goto(f"{site.origin}/recipes/one/project/block?lang=de")
    tab.wait_for_selector("#rows tr")
    tab.fill("[data-setting=min_coverage]", "0,6")
    tab.click("#draft")
    tab.wait_for_selector("#diff", state="visible")
    require_sound_on_all_screens(tab)
    tab.goto(f"{site.origin}/recipes")
    tab.wait_for_selector("#shipped a")
    assert tab.evaluate("document.documentElement.scrollWidth") <= 390
    assert grave(tab) == []


def test_a_file_is_sent_looked_at_and_made_a_recipe(site: Served, tab: Any, tmp_path: Path) -> None:
    tab.set_default_timeout(PATIENT_MS)
    mesh_of(box(20, 20, 30)).export(tmp_path / "post.stl")
    tab.goto(site.link(Role.ENGINEER))
    tab.goto(f"{site.origin}/recipes")
    tab.set_input_files("#file", str(tmp_path / "post.stl"))
    tab.click("#send")
    tab.wait_for_selector("#take:enabled")
    assert "20.0 × 20.0 × 30.0 mm" in tab.inner_text("#sent-facts")
    assert tab.input_value("#stem") == "post"
    tab.click("#take")
    tab.wait_for_url("**/recipes/one/project/post")
    assert load_recipe(tmp_path / "post.yaml").part == tmp_path / "parts" / "post.stl"


def test_a_part_is_drawn_although_the_one_before_could_not_be(
    site: Served, tab: Any, tmp_path: Path
) -> None:
    tab.set_default_timeout(PATIENT_MS)
    mesh_of(rod(10, 30, 32)).export(tmp_path / "post.stl")
    tab.goto(site.link(Role.ENGINEER))
    tab.goto(f"{site.origin}/recipes")
    mesh = "**/recipes/mesh/sent/file"
    tab.route(mesh, lambda route: route.fulfill(json={"why": "too many triangles"}))
    tab.set_input_files("#file", str(tmp_path / "post.stl"))
    tab.click("#send")
    until(tab, lambda: "too many triangles" in tab.inner_text("#scene-words"))
    assert not tab.is_visible("#scene")
    tab.unroute(mesh)
    tab.click("#again")
    tab.wait_for_selector("#scene[data-drawn]", state="visible")
    assert tab.inner_text("#scene-words") == ""


def test_a_viewer_sees_and_changes_nothing(site: Served, tab: Any) -> None:
    tab.goto(site.link(Role.VIEWER))
    tab.goto(f"{site.origin}/recipes/one/project/block")
    tab.wait_for_selector("#facts:has-text('block.stl')")
    assert tab.locator("[data-work]:enabled").count() == 0
    assert tab.locator("[data-setting]:enabled").count() == 0
    assert tab.query_selector("#save") is None
