"""What the pages cite in their own form leads to it on the site: ``pytest docs``."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest
from sphinx.application import Sphinx

DOCS = Path(__file__).parent
DOT_MD = ".md"  # these pages are made here: no citation of the repository's
PAGES = {
    "index": f"""# Front

```{{toctree}}
operating
operating/stops
alarms
adr/0007-why
```

Read `docs/alarms{DOT_MD}`, *Of the arm*, and `alarms{DOT_MD} 2`.
`docs/gone{DOT_MD}` is no page, nor is `run`.
Why: ADR 7, and ADRs 7 and 1. *Of the arm* alone is no heading of this page.
""",
    "operating": "# Operating\n\nSee *When it stops*.\n",
    "operating/stops": "# When it stops\n\nBegin with *Operating*.\n",
    "alarms": "# Alarms\n\n## Of the arm\n\nOne.\n\n## 2. Others\n\nTwo.\n",
    "adr/0007-why": "# 7. Why\n\nADR 7 itself.\n",
}


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[str]]:
    """Return the links of each page's text."""
    folder = tmp_path_factory.mktemp("site")
    for name, text in PAGES.items():
        page = folder / "in" / f"{name}{DOT_MD}"
        page.parent.mkdir(parents=True, exist_ok=True)
        page.write_text(text, encoding="utf-8")
    sys.path.insert(0, str(DOCS))
    settings = {
        "extensions": ["myst_parser", "site_links"],
        "html_theme": "basic",
        "myst_heading_anchors": 3,
    }
    app = Sphinx(
        folder / "in", None, folder / "out", folder / "trees", "html",
        confoverrides=settings, status=None, warningiserror=True,
    )  # fmt: skip
    app.build()
    found = {}
    for name in PAGES:
        body = (folder / "out" / f"{name}.html").read_text(encoding="utf-8")
        body = body.split('<div class="body" role="main">')[1].split('<div class="clearer">')[0]
        body = re.sub(r'<div class="toctree-wrapper.*?</div>', "", body, flags=re.DOTALL)
        found[name] = re.findall(r'<a class="reference internal" href="([^"]+)"', body)
        assert DOT_MD not in body.replace(f"gone{DOT_MD}", "")  # titles, not paths
    return found


def test_pages_headings_sections_and_decisions_become_links(site: dict[str, list[str]]) -> None:
    assert site["index"] == [
        "alarms.html#of-the-arm",
        "alarms.html#of-the-arm",
        "alarms.html#others",
        "adr/0007-why.html",
        "adr/0007-why.html",
    ]


def test_a_heading_is_found_in_the_other_chapters_of_its_guide(site: dict[str, list[str]]) -> None:
    assert site["operating"] == ["operating/stops.html#when-it-stops"]
    assert site["operating/stops"] == ["../operating.html#operating"]


def test_a_page_does_not_lead_to_itself_by_its_number(site: dict[str, list[str]]) -> None:
    assert site["adr/0007-why"] == []
