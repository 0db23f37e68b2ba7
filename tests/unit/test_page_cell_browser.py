"""*Cell* in Chromium: nothing serious by axe, devices examined while no run has the cell."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytest.importorskip("starlette", reason="the page's packages are not installed (extra `page`)")

from page_bench import CELL, HERE, journal, picture
from test_page_browser import CHROMIUM, Served, chromium, require_sound_on_all_screens, tab, until

from controller.cell.journal import rows
from controller.page import cell as cell_screen
from controller.page.security import Role
from controller.page.work import Workshop

__all__ = ["chromium", "tab"]  # fixtures

pytestmark = pytest.mark.skipif(not CHROMIUM.is_file(), reason="no Chromium at /usr/bin/chromium")
DOCTOR = """
import json
from messages import say
from messages.form import with_said
found = say("{found} ({kind})", found="UMI <b>RTX</b>", kind="real")
print(json.dumps(with_said({"check": "arm", "ok": True, "found": found, "remedy": ""})))
found = say("no answer within {connect_timeout_wall_s:g} s", connect_timeout_wall_s=2)
print(json.dumps(with_said({"check": "io", "ok": False, "found": found,
                            "remedy": "see the message; then run doctor again"})))
raise SystemExit(1)
"""


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Served]:
    """A page of a project with a cell file and a run with a picture; a stand-in for the doctor."""
    shutil.copy(CELL, tmp_path / "cell.yaml")
    writer = journal(tmp_path / "runs")
    picture(tmp_path / "runs", "pictures/a.png")
    writer.write(rows.Connected({"arm": "UMI RTX"}))
    for off in (0.02, 0.03, 0.01):
        views = tuple(
            rows.ViewOffFields(view=f"V{k}", grasp=1, off_mm=off, off_deg=0.0) for k in range(3)
        )
        writer.write(rows.ViewsPosed(views=views), 1)
    writer.write(rows.ViewPicturesTaken(view="V1", pictures={"ring": "pictures/a.png"}, q=HERE), 1)
    writer.close()
    shop = Workshop((sys.executable, "-c", DOCTOR))
    with patch.object(cell_screen, "Workshop", lambda **_: shop):
        found = Served(tmp_path, monkeypatch)
    yield found
    found.end()


def test_devices_are_examined_and_axe_finds_nothing_serious(site: Served, tab: Any) -> None:
    tab.goto(site.link(Role.ENGINEER))
    tab.goto(f"{site.origin}/cell?lang=de")
    tab.wait_for_selector("#devices tr")
    tab.wait_for_selector("#pictures img")
    tab.wait_for_selector("#drift polyline", state="attached")
    tab.click("#examine")
    until(tab, lambda: "siehe die Meldung; danach neu" in tab.inner_text("#checks"))
    assert "UMI <b>RTX</b> (echt)" in tab.inner_text("#checks")
    assert "keine Antwort in 2 s" in tab.inner_text("#checks")
    assert "Inbetriebnahme" in tab.inner_text("body")
    assert "nie begonnen" in tab.inner_text("#steps")
    until(tab, lambda: tab.inner_text("#doctor-said").startswith("✗"))
    require_sound_on_all_screens(tab)
