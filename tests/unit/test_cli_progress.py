"""What `compile` and `plan` print on stderr of a part that takes long, and of one that does not."""

from __future__ import annotations

import json
import threading
from pathlib import Path

import pytest
from cad_solids import box, mesh_of

from controller.cad.compiled import load_part
from controller.cell.plans import PlanCache
from controller.cli.planning.certificates import certified_each
from controller.cli.terminal import progress as progress_module
from controller.cli.terminal.progress import PartProgress, shown_progress
from controller.config import EMULATED_CELL, load_cell
from controller.setup.planner import planner_setup


def test_a_line_names_the_stage_and_how_long_it_has_lasted() -> None:
    progress = PartProgress("scan", as_json=False)
    progress.begin("finding surfaces")
    began_s = progress._stage_began_s
    progress._began_s = began_s - 10.0
    assert progress.line(began_s + 7.0) == "scan: finding surfaces (7 s of 17 s so far)"


def test_a_program_gets_the_same_as_an_object() -> None:
    progress = PartProgress("scan", as_json=True)
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


def test_each_certificate_is_a_stage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    path = tmp_path / "wide.stl"  # nothing can hold it, so that its certificates are quick
    mesh_of(box(200, 190, 180)).export(path)
    part = load_part(path)
    setup = planner_setup(None, load_cell(EMULATED_CELL), part)
    stages: list[str] = []
    progress = PartProgress("wide", as_json=False)
    monkeypatch.setattr(PartProgress, "begin", lambda _, stage: stages.append(stage))
    planning = PlanCache(part, setup.layout, setup.options)
    certified = list(certified_each(planning, part.poses, progress))
    assert [c.certificate.pose_index for c in certified] == [p.index for p in part.poses]
    assert stages[0] == "grasps and views for the cell"
    for pose, stage in zip(part.poses, stages[1:], strict=True):
        assert stage.startswith(f"certificate of stable pose {pose.index}, ")
        assert stage.endswith(f" of {len(part.poses)}")
