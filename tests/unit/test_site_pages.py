"""Every page of `docs` is in a chapter of the site, so that a reader finds it (docs/index.md)."""

from __future__ import annotations

import re
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"
TOCTREE = re.compile(r"```\{toctree\}\n(.*?)```", re.DOTALL)


def in_chapters(docs: Path) -> set[str]:
    """Return the pages that tables of contents name, by their path without the ending."""
    found = set()
    for page in docs.rglob("*.md"):
        for table in TOCTREE.findall(page.read_text(encoding="utf-8")):
            names = [line for line in table.split() if not line.startswith(":")]
            for name in names:
                matching = page.parent.glob(f"{name}.md")
                found |= {one.relative_to(docs).with_suffix("").as_posix() for one in matching}
    return found


def test_every_page_is_in_a_chapter() -> None:
    pages = {page.relative_to(DOCS).with_suffix("").as_posix() for page in DOCS.rglob("*.md")}
    assert len(pages) > 100
    assert pages - in_chapters(DOCS) == {"index"}, "name them in a toctree of docs/index.md"


def test_a_page_in_no_chapter_is_found(tmp_path: Path) -> None:
    for name in ("index", "one", "two", "adr/0001-why", "adr/index"):
        page = (tmp_path / name).with_suffix(".md")
        page.parent.mkdir(exist_ok=True)
        page.write_text("# A page\n", encoding="utf-8")
    front = "```{toctree}\n:caption: How to\n\none\nadr/index\n```\n"
    (tmp_path / "index").with_suffix(".md").write_text(front, encoding="utf-8")
    (tmp_path / "adr" / "index").with_suffix(".md").write_text("```{toctree}\n:glob:\n\n0*\n```\n")
    assert in_chapters(tmp_path) == {"one", "adr/index", "adr/0001-why"}
