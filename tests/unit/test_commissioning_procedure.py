"""What holds of a commissioning: done, stale, failed, not done; and the cell file it leaves."""

from __future__ import annotations

import hashlib
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from controller.bring_up.procedure import (
    CommissioningFolder,
    StepEnd,
    StepFigure,
    StepPlan,
    StepRecord,
    StepStanding,
    StepStatus,
    calibrated_text,
    cell_digest,
    standings,
    worst_of,
)
from controller.config import Cell, ConfigError, load_cell, load_yaml
from controller.config.calibration_reference import CalibrationReference
from controller.config.calibrations import LampsCalibration
from controller.config.shipped import EMULATED_CELL

NOW = datetime(2031, 5, 4, 12, 0, tzinfo=UTC)
DIGEST, OTHER = "a" * 64, "b" * 64
PLANS = (StepPlan("first", (), 30), StepPlan("second", ("first",), None))


def record(step: str, at: datetime, **more: Any) -> StepRecord:
    fields: dict[str, Any] = {
        "step": step,
        "outcome": StepEnd.PASSED,
        "began": at - timedelta(minutes=1),
        "ended": at,
        "cell_digest": DIGEST,
    }
    return StepRecord(**(fields | more))


def of(*records: StepRecord, digest: str = DIGEST, **hashes: str) -> dict[str, StepStanding]:
    found = standings(PLANS, {one.step: one for one in records}, NOW, digest, hashes)  # type: ignore[arg-type]
    return {one.step: one for one in found}


def test_steps_that_passed_in_order_are_done() -> None:
    first = record("first", NOW - timedelta(days=2))
    found = of(first, record("second", NOW - timedelta(days=1)))
    assert [one.status for one in found.values()] == [StepStatus.DONE, StepStatus.DONE]


def test_a_step_without_a_record_is_not_done() -> None:
    assert of()["first"] == StepStanding("first", StepStatus.NOT_DONE, "never begun")


@pytest.mark.parametrize(
    ("outcome", "status"), [("failed", StepStatus.FAILED), ("broken off", StepStatus.NOT_DONE)]
)
def test_a_step_that_did_not_pass_names_why(outcome: str, status: StepStatus) -> None:
    found = of(record("first", NOW, outcome=outcome, message="no board in sight"))["first"]
    assert found.status is status
    assert "no board in sight" in found.reason


def test_a_step_is_stale_by_age_to_the_day() -> None:
    assert of(record("first", NOW - timedelta(days=30)))["first"].status is StepStatus.DONE
    old = of(record("first", NOW - timedelta(days=30, seconds=1)))["first"]
    assert (old.status, "older than 30 days" in old.reason) == (StepStatus.STALE, True)


def test_another_cell_in_the_file_makes_every_step_stale() -> None:
    found = of(record("first", NOW), digest=OTHER)["first"]
    assert found.status is StepStatus.STALE
    assert "cell file" in found.reason


def test_a_calibration_that_was_used_and_is_another_one_now_makes_a_step_stale() -> None:
    used = record("first", NOW, based_on={"lamps": DIGEST})
    assert of(used, lamps=DIGEST)["first"].status is StepStatus.DONE
    assert "is another one" in of(used, lamps=OTHER)["first"].reason
    assert "is gone" in of(used)["first"].reason


def test_a_step_whose_need_was_repeated_after_it_is_stale() -> None:
    found = of(record("first", NOW), record("second", NOW - timedelta(days=1)))["second"]
    assert found.status is StepStatus.STALE
    assert "repeated" in found.reason


def test_a_step_whose_need_is_stale_is_stale() -> None:
    early = NOW - timedelta(days=40)
    found = of(record("first", early), record("second", NOW - timedelta(days=1)))
    assert [one.status for one in found.values()] == [StepStatus.STALE, StepStatus.STALE]


def test_only_figures_outside_their_limits_are_named() -> None:
    low = StepFigure(name="a", value=1.0, low=2.0)
    high = StepFigure(name="b", value=3.0, unit="mm", high=2.0)
    free, edge = StepFigure(name="c", value=9.0), StepFigure(name="d", value=2.0, low=2.0, high=2.0)
    assert worst_of((low, high, free, edge)) == (low, high)
    assert high.words == "b: 3 mm (at most 2 allowed)"


# ---- the cell file -------------------------------------------------------------------------------
REFERENCE = CalibrationReference(file="calibrations/lamps.json", sha256=DIGEST)


def test_the_cell_files_text_is_kept_to_the_letter_with_its_comments() -> None:
    text = EMULATED_CELL.read_text()
    once = calibrated_text(text, {"lamps": REFERENCE})
    assert once.startswith(text.rstrip("\n"))
    assert once.count("\ncalibration:") == 1


def test_calibrations_take_the_place_of_those_the_file_had_wherever_they_stood() -> None:
    old = "calibration:   # old\n  arm: {file: x.json, sha256: 0}\n"
    text = f"name: a\n{old}\n# kept\ntable: {{}}  # t\n"
    twice = calibrated_text(calibrated_text(text, {"overhead": REFERENCE}), {"lamps": REFERENCE})
    assert "arm" not in twice
    assert "overhead" not in twice
    assert "table: {}  # t" in twice
    assert twice == calibrated_text(text, {"lamps": REFERENCE})
    assert "calibration" not in calibrated_text(twice, {})


def test_comments_and_addresses_make_no_other_cell(tmp_path: Path) -> None:
    text = EMULATED_CELL.read_text()
    path = tmp_path / "cell.yaml"

    def digest_of(changed: str) -> str:
        path.write_text(changed)
        return cell_digest(load_yaml(path, Cell))

    drawn = digest_of(text)
    assert digest_of("# a word\n" + text) == drawn
    assert (
        digest_of(text.replace("arm:         {address: emulated}", "arm: {address: /dev/x}"))
        == drawn
    )
    # a key whose default is what the file did not state: later versions have more keys
    post = "  post:     [100"
    for mm, is_drawn in ((0.0, True), (1.0, False)):
        held = digest_of(text.replace(post, f"  held: {{mm: {mm}}}\n{post}"))
        assert (held == drawn) is is_drawn
    assert digest_of(text.replace("upper_mm: 253.5", "upper_mm: 253.6")) != drawn


def lamps(**channels: tuple[int, int]) -> LampsCalibration:
    tree = {
        name: {"analog": a, "relay": r, "level": 1.0, "settle_s": 0.1}
        for name, (a, r) in channels.items()
    }
    return LampsCalibration.model_validate(
        {"kind": "lamps", "measured": NOW.isoformat(), "lamps": tree}
    )


def test_what_was_measured_is_in_the_cell_that_the_file_describes(tmp_path: Path) -> None:
    folder = CommissioningFolder(tmp_path)
    swapped = lamps(table_ring=(2, 2), table_side=(1, 1))
    made = folder.keep(EMULATED_CELL, {"lamps": swapped})
    data = (tmp_path / "calibrations" / "lamps.json").read_bytes()
    assert made == {"lamps": hashlib.sha256(data).hexdigest()}
    cell = load_cell(folder.cell_file)
    assert (cell.lamps["table_ring"].analog, cell.lamps["table_side"].relay) == (2, 1)
    again = folder.load_for(EMULATED_CELL, ("lamps",))  # as a step that measures them starts
    assert again.lamps["table_ring"].analog == 1
    assert list(tmp_path.glob(".*")) == []


# ---- records -------------------------------------------------------------------------------------
def test_a_broken_off_step_does_not_take_the_place_of_one_that_ended(tmp_path: Path) -> None:
    folder = CommissioningFolder(tmp_path)
    done = record("first", NOW)
    folder.write_record(done)
    folder.write_record(record("first", NOW + timedelta(days=1), outcome="broken off"))
    assert folder.read_records(("first", "second")) == {"first": done}


def test_the_first_try_that_was_broken_off_is_kept(tmp_path: Path) -> None:
    folder = CommissioningFolder(tmp_path)
    folder.write_record(record("first", NOW, outcome="broken off", message="Ctrl-C"))
    assert folder.read_records(("first",))["first"].message == "Ctrl-C"


@pytest.mark.parametrize("text", ["{", "[]", '{"step": "second"}'])
def test_a_damaged_record_is_named_with_what_to_do(tmp_path: Path, text: str) -> None:
    folder = CommissioningFolder(tmp_path)
    path = folder.record_file("first")
    path.parent.mkdir()
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"first\.json: .*remove it"):
        folder.read_records(("first",))


def test_two_runs_in_one_second_have_folders_of_their_own(tmp_path: Path) -> None:
    folder = CommissioningFolder(tmp_path)
    assert folder.begin_evidence("light", NOW) != folder.begin_evidence("light", NOW)
