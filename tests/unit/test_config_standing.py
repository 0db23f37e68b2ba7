"""Whether calibrations count: age, runs, what they are based on, verification, and the verdict."""

from datetime import UTC, datetime
from typing import Any

import pytest
from test_config_calibrations import ARM, CAMERA, HEADER

from controller.config import Recipe
from controller.config.calibration_reference import CalibrationName, CalibrationReference
from controller.config.calibrations import (
    ArmCalibration,
    Calibration,
    CalibrationsStanding,
    CameraCalibration,
    Usage,
    VerificationRecord,
    standing_of,
)
from controller.config.view_set import SetCalibration
from controller.inspection import PartInspection, PartVerdict, Verdict
from controller.stored.as_calibrated import as_calibrated

NOW = datetime(2026, 3, 12, tzinfo=UTC)  # ten days after HEADER's
OLD, NEW = "a" * 64, "b" * 64
FIGURES = {"pick position": {"value": 0.3, "limit": 0.5, "unit": "mm", "count": 25}}


def verification(based_on: dict[str, str], **changes: Any) -> VerificationRecord:
    body = HEADER | {"kind": "verification", "figures": FIGURES, "based_on": based_on} | changes
    return VerificationRecord.model_validate(body)


def standing(
    found: dict[CalibrationName, Calibration], usage: dict[str, Usage] | None = None
) -> CalibrationsStanding:
    hashes = {"overhead": OLD, "arm": NEW, "verification": "c" * 64}
    references = {
        name: CalibrationReference(file=f"{name}.json", sha256=hashes[name]) for name in found
    }
    return standing_of(references, found, NOW, usage or {})


def camera(**changes: Any) -> CameraCalibration:
    return CameraCalibration.model_validate(CAMERA | changes)


def arm(**changes: Any) -> ArmCalibration:
    return ArmCalibration.model_validate(ARM | changes)


def test_a_cell_as_drawn_has_nothing_stale_and_is_not_verified() -> None:
    found = standing({})
    assert found.stale == ()
    assert "nothing was measured" in found.why_not_verified


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"valid_days": 9}, "measured 2026-03-02, valid for 9 days"),
        ({"valid_runs": 3}, "3 runs have used it, it is valid for 3"),
        ({"measured": "2026-04-01T00:00:00Z"}, "yet to come"),
        ({"based_on": {"overhead": NEW}}, "overhead was calibrated anew since"),
        ({"based_on": {"lamps": NEW}}, "based on a calibration of lamps that is gone"),
        ({"residual": {"value": 0.2, "unit": "px", "limit": 0.1}}, "leaves 0.2 px, 0.1 are"),
    ],
)
def test_a_stale_calibration_has_its_reason(changes: dict[str, Any], why: str) -> None:
    found = standing({"overhead": camera(), "arm": arm(**changes)}, {NEW: Usage(3)})
    (sentence,) = found.stale
    assert sentence.startswith("the calibration of arm is stale: ")
    assert why in sentence


@pytest.mark.parametrize(
    "changes",
    [
        {"valid_days": 11},
        {"valid_runs": 4},
        {"based_on": {"overhead": OLD}},
        {"residual": {"value": 0.1, "unit": "px", "limit": 0.1}},
    ],
)
def test_a_calibration_counts_up_to_its_limits(changes: dict[str, Any]) -> None:
    assert standing({"overhead": camera(), "arm": arm(**changes)}, {NEW: Usage(3)}).stale == ()


@pytest.mark.parametrize(
    ("record", "why"),
    [
        (verification({"overhead": OLD, "arm": NEW}), ""),
        (verification({"overhead": OLD}), "arm came after its verification"),
        (verification({"overhead": NEW, "arm": NEW}), "overhead was calibrated anew since"),
        (verification({"overhead": OLD, "arm": NEW}, valid_days=5), "valid for 5 days"),
        (
            verification(
                {"overhead": OLD, "arm": NEW},
                figures={"pick position": FIGURES["pick position"] | {"value": 0.6}},
            ),
            "verification of 2026-03-02 failed",
        ),
    ],
)
def test_a_cell_is_verified_by_the_calibrations_that_it_runs_with(
    record: VerificationRecord, why: str
) -> None:
    found = standing({"overhead": camera(), "arm": arm(), "verification": record})
    assert (why in found.why_not_verified) if why else not found.why_not_verified


STALE = SetCalibration(stale=("the calibration of arm is stale: old",), why_not_verified="none")


@pytest.mark.parametrize(
    ("required", "calibration", "expected"),
    [
        ("any", STALE, Verdict.PASS),
        ("current", STALE, Verdict.INDETERMINATE),
        ("verified", STALE, Verdict.INDETERMINATE),
        ("current", SetCalibration(why_not_verified="none"), Verdict.PASS),
        ("verified", SetCalibration(why_not_verified="none"), Verdict.INDETERMINATE),
        ("verified", SetCalibration(), Verdict.PASS),
    ],
)
def test_a_recipe_decides_whether_a_stale_cell_may_pass_a_part(
    required: str, calibration: SetCalibration, expected: Verdict
) -> None:
    recipe = Recipe.model_validate(
        {"name": "a", "part": "a.stl", "inspection": {"calibration": required}}
    )
    ledger = PartVerdict(Verdict.PASS, (), (), 1.0, ())
    found = as_calibrated(PartInspection(Verdict.PASS, (), (), (), (), ledger), calibration, recipe)
    assert found.verdict is expected
    assert all(any(why in reason for reason in found.reasons) for why in calibration.stale)


def test_a_fail_stays_a_fail() -> None:
    ledger = PartVerdict(Verdict.FAIL, (), (), 1.0, ())
    found = as_calibrated(
        PartInspection(Verdict.FAIL, ("a chip",), (), (), (), ledger), STALE, None
    )
    assert found.verdict is Verdict.FAIL
    assert found.reasons[0] == "a chip"


@pytest.mark.parametrize(
    ("off_mm", "is_stale"),
    [
        ((0.1, 0.1, 0.5, 0.6, 0.5), True),
        ((9.0, 9.0, 9.0, 0.1, 0.1, 0.1, 0.1, 0.5), False),  # what was is forgiven
        ((0.1, 0.1, 0.1, 0.1, 4.0), False),  # one part that slipped
        ((0.6, 0.6, 0.6, 0.6), False),  # too few to tell
    ],
)
def test_an_arm_that_camera_and_counters_disagree_about_is_stale(
    off_mm: tuple[float, ...], is_stale: bool
) -> None:
    found = standing({"overhead": camera(), "arm": arm()}, {NEW: Usage(9, off_mm), OLD: Usage(9)})
    assert any("disagree by 0.50 mm" in one for one in found.stale) is is_stale
    # whether the camera over the table still stands is not to be seen at the station
    assert not any("overhead" in one for one in found.stale)
