"""A controller that cannot act, on real wires: the arm stops all the same.

The limits are far above what `benchmarks/bench_blind.py` measures, and far below never.
"""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

from bench_blind import GIVE_UP_S, try_it

WATCHDOG_S = 1.0

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]


def test_a_stopped_controller_costs_the_motors_their_supply() -> None:
    trial = try_it("sigstop", "homing", "door", seed=1, watchdog_s=WATCHDOG_S)
    assert trial.problem == ""
    assert trial.power_off_s is not None
    assert trial.power_off_s < GIVE_UP_S / 4


@pytest.mark.parametrize("fault", ["output", "disk", "database", "gc"])
def test_a_door_stops_the_arm_whatever_keeps_the_controller(fault: str) -> None:
    trial = try_it(fault, "homing", "door", seed=2, watchdog_s=WATCHDOG_S)
    assert trial.problem == ""
    assert trial.stop_s is not None
    assert trial.stop_s < 1.5  # less than the pause of the garbage collector


def test_an_order_to_stop_reaches_the_supervisor_of_a_controller_that_stands_still() -> None:
    trial = try_it("gc", "homing", "stop", seed=3, watchdog_s=WATCHDOG_S)
    assert trial.problem == ""
    assert trial.stop_s is not None
    assert trial.stop_s < 1.5
