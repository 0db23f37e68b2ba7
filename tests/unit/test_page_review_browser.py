"""*Review* and *History* in Chromium: decided by keyboard, looked at on a phone."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytest.importorskip("starlette", reason="the page's packages are not installed (extra `page`)")

from results_bench import RunWriter, bad_run, finding, good_run, verdict, view
from test_page_browser import CHROMIUM, Served, chromium, grave, tab, until

from controller.cell.batch import Papers
from controller.cell.journal import JOURNAL_NAME, read_rows, rows
from controller.inspection import Verdict
from controller.page.records import records as records_module
from controller.page.security import Role

__all__ = ["chromium", "tab"]  # fixtures

pytestmark = pytest.mark.skipif(not CHROMIUM.is_file(), reason="no Chromium at /usr/bin/chromium")
OPEN = "20260303-120000-000-featuretype"
FAILED = "20260302-120000-000-featuretype"
BORE = rows.CharacteristicFields(
    id="d1", balloon=1, kind="diameter", label="bore 8", nominal=8.0, lower=7.9, upper=8.1,
    source="recipe", measured=8.01, U=0.02, verdict="pass",
)  # fmt: skip


def write_runs(runs: Path) -> None:
    good_run(runs)
    bad_run(runs)
    writer = RunWriter(runs, OPEN, count=2, papers=Papers(serials=("SN7", "SN8"), lot="L7"))
    for measured in (8.01, 8.03):
        writer.look()
        writer.plan()
        one = view("G1-V0", finding())
        writer.show("show with grasp G1", one, 4.0)
        writer.judge_view(one)
        value = BORE.model_copy(update={"measured": measured})
        writer.write(rows.PartMeasured(characteristics=(value,)))
        writer.judge(verdict(Verdict.INDETERMINATE))
        writer.place("quarantine")
    writer.end()


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("written")
    # playwright has an event loop in this thread
    with ThreadPoolExecutor(1) as beside:
        beside.submit(write_runs, folder).result()
    return folder


@pytest.fixture
def served(runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Served]:
    monkeypatch.setattr(records_module, "make_pool", lambda: ThreadPoolExecutor(1))
    monkeypatch.setattr(records_module, "WAIT_S", 60.0)
    shutil.copytree(runs, tmp_path / "runs")
    found = Served(tmp_path, monkeypatch)
    yield found
    found.end()


def written(folder: Path) -> list[dict[str, Any]]:
    found = read_rows(folder / "runs" / JOURNAL_NAME)
    return [row.body for row in found if row.name == "part_reviewed"]


def test_a_part_is_decided_on_by_keyboard_and_the_page_shows_it(
    served: Served, tab: Any, tmp_path: Path
) -> None:
    tab.goto(served.link())
    tab.click("nav.screens >> text=Review")
    tab.focus("a.card >> nth=0")
    tab.keyboard.press("Enter")
    tab.wait_for_selector("#decide")
    until(tab, lambda: tab.evaluate("document.querySelector('.crop img').naturalWidth > 100"))
    # the pose of this view is the test's own, and no camera sees the part there: it is said
    until(tab, lambda: "out of this picture" in tab.inner_text(".crops"))
    for width, height in ((1440, 900), (390, 844)):  # wherever a person has scrolled to
        tab.set_viewport_size({"width": width, "height": height})
        for top in (0, 600):
            tab.evaluate(f"window.scrollTo(0, {top})")
            for word in ("accept", "reject"):
                place = tab.locator(f"button[value={word}]").bounding_box()
                assert 0 <= place["y"] <= height - place["height"]
    tab.click("button[value=accept]")
    assert "Write a reason first." in tab.inner_text("#said")
    assert written(tmp_path) == []
    tab.keyboard.type("a reflection of the ring")
    tab.check("input[name=finding-1][value=false_alarm]")
    tab.focus("button[value=accept]")
    tab.keyboard.press("Enter")
    tab.wait_for_selector(".earlier >> text=a reflection of the ring")
    (body,) = written(tmp_path)
    assert (body["verdict"], body["who"], body["findings"]) == (
        "accept", "ada, page", [{"number": 1, "word": "false_alarm"}],
    )  # fmt: skip
    assert tab.is_checked("input[name=finding-1][value=false_alarm]")


def test_whoever_is_late_sees_why_and_nothing_is_written(
    served: Served, tab: Any, tmp_path: Path
) -> None:
    tab.goto(served.link())
    tab.goto(f"{served.origin}/review/part/{OPEN}/1")
    other = tab.context.new_page()
    other.goto(f"{served.origin}/review/part/{OPEN}/1")
    other.fill("#why", "dust")
    other.click("button[value=reject]")
    other.wait_for_selector(".earlier")
    tab.fill("#why", "no dust")
    tab.click("button[value=accept]")
    until(tab, lambda: "somebody decided meanwhile" in tab.inner_text("#said"))
    assert tab.input_value("#why") == "no dust"  # what was written is not lost
    assert [body["verdict"] for body in written(tmp_path)] == ["reject"]


def test_a_viewer_reads_the_history_compares_two_parts_and_decides_nothing(
    served: Served, tab: Any
) -> None:
    tab.goto(served.link(Role.VIEWER))
    tab.click("nav.screens >> text=History")
    assert tab.locator("tbody tr").count() == 4
    tab.click("thead >> text=findings")
    assert tab.get_attribute("th[aria-sort]", "aria-sort") == "descending"
    assert FAILED in tab.inner_text("tbody tr >> nth=0")
    tab.select_option("[name=verdict]", "indeterminate")
    tab.click("text=Show")
    assert tab.locator("tbody tr").count() == 2
    for box in tab.query_selector_all("[name=part]"):
        box.check()
    tab.click("text=Compare two parts")
    assert "0.020" in tab.inner_text("main")
    tab.goto(f"{served.origin}/review/part/{OPEN}/1")
    assert tab.is_disabled("input[name=finding-1][value=real]")
    assert tab.query_selector("button[value=accept]") is None


@pytest.mark.parametrize(("scheme", "width"), [("light", 1280), ("dark", 390)])
def test_axe_finds_nothing_serious_and_nothing_is_wider_than_the_screen(
    served: Served, tab: Any, scheme: str, width: int
) -> None:
    tab.emulate_media(color_scheme=scheme)
    tab.set_viewport_size({"width": width, "height": 844})
    tab.goto(served.link())
    for path in (
        "/review?lang=de",
        f"/review/part/{OPEN}/1",
        "/history",
        f"/history/part/{FAILED}/1",
        "/history/charts",
        f"/history/compare?part={OPEN}/1&part={OPEN}/2",
    ):
        tab.goto(served.origin + path)
        assert tab.evaluate("document.documentElement.scrollWidth") <= width, path
        assert grave(tab) == [], path
    assert json.dumps(tab.problems) == "[]"
