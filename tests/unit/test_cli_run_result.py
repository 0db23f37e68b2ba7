"""What `cellctl run --json` prints of a part."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from controller.cell.batch import PartRecord, RunProgress
from controller.cell.machine import PartFault, Recovery
from controller.cli.running.report_file import warn_no_report
from controller.cli.running.run_output import part_json, progress_line


def test_recoveries_are_named_by_the_fault() -> None:
    part = PartRecord(1, recoveries=[Recovery(PartFault.GRASP_MISSED, "closed on nothing")])
    assert part_json(part)["recoveries"] == ["grip_missed"]


def test_a_state_without_a_label_is_a_line_of_its_own() -> None:
    shown = RunProgress(state="grasping", step=1, step_count=9, remaining_s=80.0)
    assert progress_line(shown) == "grasping 1/9 (80 s left)"
    shown.label = "pick it up"
    assert progress_line(shown) == "grasping 1/9: pick it up (80 s left)"
    shown.label = "grasping"  # as an action says that it begins
    assert progress_line(shown) == "grasping 1/9 (80 s left)"


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT])
def test_only_a_full_disk_is_asked_for_room(
    number: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report = tmp_path / "run" / "report.html"
    warn_no_report(OSError(number, os.strerror(number)), report, "run", tmp_path)
    said = capsys.readouterr().err
    assert said.startswith(f"cellctl: {report}: {os.strerror(number)}; make room, then ")
    assert f"`cellctl report run --runs {tmp_path}` writes it" in said


def test_a_file_of_the_program_that_is_missing_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report = tmp_path / "run" / "report.html"
    gone = "/usr/lib/cellctl/page.css"
    error = FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), gone)
    warn_no_report(error, report, "run", tmp_path)
    said = capsys.readouterr().err
    assert said.startswith(f"cellctl: {gone}: No such file or directory; the report {report} needs")
    assert "room" not in said


def test_a_report_that_cannot_be_moved_to_its_place_is_named_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report = tmp_path / "run" / "report.html"
    error = PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(report))
    warn_no_report(error, report, "run", tmp_path)
    said = capsys.readouterr().err
    assert said.startswith(f"cellctl: {report}: Permission denied; `cellctl report")
