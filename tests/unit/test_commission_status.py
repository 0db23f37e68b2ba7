"""What `cellctl commission --status` states of calibrations: how often runs used them."""

import hashlib
import json
from datetime import UTC, datetime
from pathlib import Path

import pytest

from controller.bring_up.procedure import CommissioningFolder
from controller.cell.journal import JOURNAL_NAME, Journal, rows
from controller.cli.app import main
from controller.cli.bring_up.calibration_lines import calibration_lines
from controller.config import EMULATED_CELL
from controller.config.calibrations import TraysCalibration

NOW = datetime(2026, 3, 20, tzinfo=UTC)


def commissioned(folder: Path, valid_runs: int | None) -> str:
    """Write a commissioning with one calibration; return the calibration's hash."""
    trays = TraysCalibration(
        measured=datetime(2026, 3, 2, tzinfo=UTC),
        cell="emulated",
        centres={"accept": (101.0, 391.0)},
        u_mm=0.5,
        valid_runs=valid_runs,
    )
    CommissioningFolder(folder).keep(EMULATED_CELL, {"trays": trays})
    return hashlib.sha256((folder / "calibrations" / "trays.json").read_bytes()).hexdigest()


def ran(runs: Path, digest: str, times: int) -> None:
    """Journal so many runs that used a calibration."""
    runs.mkdir()
    for number in range(times):
        journal = Journal(runs / JOURNAL_NAME, f"run {number}")
        journal.write(
            rows.RunBegan(
                recipe={"name": "holder"},
                cell={"calibration": {"trays": {"file": "x", "sha256": digest}}},
                devices={},
                count=1,
                software={},
            )
        )
        journal.close()


@pytest.mark.parametrize(("times", "left"), [(0, 5), (3, 2), (7, 0)])
def test_runs_that_used_a_calibration_are_counted_down(
    tmp_path: Path, times: int, left: int
) -> None:
    ran(tmp_path / "runs", commissioned(tmp_path / "out", 5), times)
    (one,) = calibration_lines(CommissioningFolder(tmp_path / "out"), tmp_path / "runs", NOW)
    assert (one.run_count, one.runs_left) == (times, left)
    assert f"{left} of 5 are left" in one.words
    assert ("stale" in one.words) == (left == 0)


def test_a_calibration_without_a_limit_has_no_runs_left_to_state(tmp_path: Path) -> None:
    ran(tmp_path / "runs", commissioned(tmp_path / "out", None), 2)
    (one,) = calibration_lines(CommissioningFolder(tmp_path / "out"), tmp_path / "runs", NOW)
    assert one.words == "measured 2026-03-02, 2 runs have used it"


def test_runs_with_another_calibration_do_not_count(tmp_path: Path) -> None:
    commissioned(tmp_path / "out", 5)
    ran(tmp_path / "runs", "0" * 64, 4)
    (one,) = calibration_lines(CommissioningFolder(tmp_path / "out"), tmp_path / "runs", NOW)
    assert one.runs_left == 5


def test_the_command_states_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ran(tmp_path / "runs", commissioned(tmp_path / "out", 5), 1)
    arguments = ["commission", "--cell", str(EMULATED_CELL), "--out", str(tmp_path / "out")]
    arguments += ["--status", "--runs", str(tmp_path / "runs"), "--json"]
    assert main(arguments) == 1  # nothing else is done
    found = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    (one,) = [row for row in found if row["event"] == "calibration"]
    assert (one["name"], one["run_count"], one["runs_left"]) == ("trays", 1, 4)
