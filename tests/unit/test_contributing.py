"""Tests that CONTRIBUTING.md names by their start are there; `test_citations.py` looks at files."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


def test_tests_that_it_names_by_their_start_exist() -> None:
    starts = set(re.findall(r"`(?:tests/unit/)?(test_\w+\*?(?:\.py)?)`", TEXT))
    assert len(starts) > 10
    assert {one for one in starts if not any((ROOT / "tests" / "unit").glob(one))} == set()
