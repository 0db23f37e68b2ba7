"""Files as other programs write them (tests/data/foreign): read rightly, or refused in words."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from controller.cad import CadError, load_solid

FOLDER = Path(__file__).resolve().parents[1] / "data" / "foreign"
TRUTH: dict[str, dict[str, Any]] = json.loads((FOLDER / "truth.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", sorted(TRUTH))
def test_a_foreign_file_is_read_rightly_or_refused_in_words(name: str) -> None:
    truth = TRUTH[name]
    if "refused" in truth:
        with pytest.raises(CadError) as caught:
            load_solid(FOLDER / name)
        assert str(caught.value).startswith(str(FOLDER / name)), "the file is named first"
        assert re.search(truth["refused"], str(caught.value)), str(caught.value)
        return
    solid = load_solid(FOLDER / name)
    assert solid.mesh.extents == pytest.approx(truth["size_mm"], abs=1e-4)
    assert solid.volume_mm3 == pytest.approx(truth["volume_mm3"], rel=1e-6)


def test_the_corpus_has_forty_files_and_nothing_that_is_not_listed() -> None:
    there = {path.name for path in FOLDER.iterdir() if path.is_file()}
    assert there - {"make.py", "truth.json"} == set(TRUTH)
    assert len(TRUTH) >= 40
