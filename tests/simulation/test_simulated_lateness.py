"""A controller that gets no turn for a while: what the cell does meanwhile, and afterwards."""

import pytest

from simulation.case import Case, run_case
from simulation.cell import Scene

SLOW = pytest.mark.slow
SEED = 11
LATE = Scene(watchdog_s=1.0, may_be_late=True)


@pytest.mark.parametrize("state", ["presenting", pytest.param("handing", marks=SLOW)])
def test_a_controller_that_is_a_little_late_ends_nothing(state: str) -> None:
    ended = run_case(Case(SEED, scene=LATE, fault=("controller late by 0.5 s", state)))
    assert any("late by 0.5 s at" in what for what in ended.caused)
    assert ended.is_in_tray, ended.messages
    assert not ended.violations


@pytest.mark.parametrize(
    ("state", "late"),
    [
        ("resetting", "controller late by 2 s"),
        pytest.param("presenting", "controller late by 8 s", marks=SLOW),
        pytest.param("handing", "controller late by 8 s", marks=SLOW),
        pytest.param("placing", "controller late by 8 s", marks=SLOW),
    ],
)
def test_a_controller_that_is_late_finds_the_motors_without_supply_and_stops(
    state: str, late: str
) -> None:
    ended = run_case(Case(SEED, scene=LATE, fault=(late, state), starts=1))
    assert any(f"{late} at" in what for what in ended.caused)
    assert ended.ends == ["aborted motor_watchdog"], ended.messages
    assert not ended.violations


def test_after_the_watchdog_a_start_goes_on_with_the_part() -> None:
    case = Case(
        SEED,
        scene=LATE,
        fault=("controller late by 2 s", "presenting"),
        recovery="auto",
        again=True,
    )
    ended = run_case(case)
    assert "motor_watchdog" in ended.ends[0]
    assert ended.is_in_tray, ended.messages
    assert not ended.violations
