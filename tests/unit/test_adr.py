"""Each record of a decision has its four parts, so that a reader finds the reason at once."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

DOT_MD = ".md"  # a page that is made here is no citation
DOCS = Path(__file__).resolve().parents[2] / "docs"
sys.path.insert(0, str(DOCS))

import adr_index  # noqa: E402  (its folder comes first)

ADRS = sorted((DOCS / "adr").glob("0*.md"))
PARTS = ["Context", "Options weighed", "Decision", "Consequences"]


def parts_of(text: str) -> list[str]:
    """Return the headings of the second level that have text below them."""
    return re.findall(r"^## (.+)\n\s*(?!#)\S", text, re.MULTILINE)


@pytest.mark.parametrize("page", ADRS, ids=lambda page: page.stem)
def test_a_record_has_its_four_parts(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert text.startswith(f"# {int(page.stem[:4])}. ")
    assert parts_of(text) == PARTS


def test_the_index_lists_every_record_with_its_status() -> None:
    stored = (DOCS / "adr" / "index.md").read_text(encoding="utf-8")
    assert stored == adr_index.page(), "run: python docs/adr_index.py > docs/adr/index.md"
    assert stored.count("](0") == len(ADRS)


def test_a_record_without_a_status_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "0001-why").with_suffix(DOT_MD).write_text(
        "# 1. Why\n\n## Context\n", encoding="utf-8"
    )
    monkeypatch.setattr(adr_index, "FOLDER", tmp_path)
    with pytest.raises(ValueError, match=r"0001-why\S+ write .*Status: accepted"):
        adr_index.page()


def test_a_number_that_two_records_took_in_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for number in (3, 4):
        text = f"# {number}. Why\n\nStatus: accepted, 2026-01-31. Takes in 1 and 2.\n"
        (tmp_path / f"{number:04d}-why").with_suffix(DOT_MD).write_text(text, encoding="utf-8")
    monkeypatch.setattr(adr_index, "FOLDER", tmp_path)
    with pytest.raises(ValueError, match=r"\[1, 2\]"):
        adr_index.page()


def test_a_part_without_text_does_not_count() -> None:
    text = "# 1. Why\n\n## Context\n\nA cell.\n\n## Options weighed\n\n## Decision\n\nThis.\n"
    assert parts_of(text) == ["Context", "Decision"]
