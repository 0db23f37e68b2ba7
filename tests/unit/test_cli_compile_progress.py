"""What `cellctl compile` prints on stderr of a part that takes long, and of one that does not."""

from __future__ import annotations

import json
import threading

import pytest

from controller.cli.parts import progress as progress_module
from controller.cli.parts.progress import Progress, shown_progress


def test_a_line_names_the_stage_and_how_long_it_has_lasted() -> None:
    progress = Progress("scan", as_json=False)
    progress.begin("finding surfaces")
    began_s = progress._stage_began_s
    progress._began_s = began_s - 10.0
    assert progress.line(began_s + 7.0) == "scan: finding surfaces (7 s of 17 s so far)"


def test_a_program_gets_the_same_as_an_object() -> None:
    progress = Progress("scan", as_json=True)
    progress.begin("finding surfaces")
    began_s = progress._stage_began_s
    progress._began_s = began_s - 10.0
    assert json.loads(progress.line(began_s + 7.0)) == {
        "event": "progress",
        "part": "scan",
        "stage": "finding surfaces",
        "stage_s": 7.0,
        "seconds": 17.0,
    }


def test_a_stage_that_lasts_reports_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    written: list[str] = []
    is_written = threading.Event()

    def write(text: str) -> None:
        written.append(text)
        is_written.set()

    monkeypatch.setattr(progress_module, "write_error_line", write)
    monkeypatch.setattr(progress_module, "QUIET_S", 0.0)
    with shown_progress("scan", as_json=False) as progress:
        progress.begin("finding surfaces")
        assert is_written.wait(30.0)
    count = len(written)
    assert all(line.startswith("scan: ") for line in written)
    # the thread has ended with the part: nobody is left to write another line
    assert "progress" not in [thread.name for thread in threading.enumerate()]
    assert len(written) == count
