"""A run that ends for want of a calibration has a message that names it."""

from types import SimpleNamespace
from typing import Any

import pytest

from controller.cell.alarms import alarm_of
from controller.cli.running.run_output import calibration_note


def result(code: str, why: str) -> Any:
    alarm = alarm_of(code) if code else None
    return SimpleNamespace(outcome=SimpleNamespace(alarm=alarm), why_not_verified=why)


@pytest.mark.parametrize("code", ["many_parts", "hold_not_seen", "stall", "stalled", "grip_missed"])
def test_what_a_wrong_calibration_raises_names_it(code: str) -> None:
    note = calibration_note(result(code, "nothing was measured"))
    assert "not verified: nothing was measured" in note
    assert "cellctl commission" in note


@pytest.mark.parametrize(
    ("code", "why"),
    [
        ("many_parts", ""),  # verified
        ("estop", "nothing was measured"),
        ("unplugged", "nothing was measured"),
        ("journal", "nothing was measured"),
        ("", "nothing was measured"),
    ],
)
def test_what_it_cannot_raise_does_not(code: str, why: str) -> None:
    assert calibration_note(result(code, why)) == ""
