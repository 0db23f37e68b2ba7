"""Each record of a decision has its four parts, so that a reader finds the reason at once."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ADRS = sorted((Path(__file__).resolve().parents[2] / "docs" / "adr").glob("0*.md"))
PARTS = ["Context", "Options weighed", "Decision", "Consequences"]


def parts_of(text: str) -> list[str]:
    """Return the headings of the second level that have text below them."""
    return re.findall(r"^## (.+)\n\s*(?!#)\S", text, re.MULTILINE)


@pytest.mark.parametrize("page", ADRS, ids=lambda page: page.stem)
def test_a_record_has_its_four_parts(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert text.startswith(f"# {int(page.stem[:4])}. ")
    assert parts_of(text) == PARTS


def test_a_part_without_text_does_not_count() -> None:
    text = "# 1. Why\n\n## Context\n\nA cell.\n\n## Options weighed\n\n## Decision\n\nThis.\n"
    assert parts_of(text) == ["Context", "Decision"]
