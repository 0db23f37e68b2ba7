"""Every end is a stop, and a start after a kill moves nothing: reduced forms of two benchmarks.

The emulated cell is a process of its own here; what moved is its own word.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from bench_ends import WAYS, end_by
from bench_kill import STAGES, kill_in

SPEED = 10.0


@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    "way", [name if name == "terminal" else pytest.param(name, marks=pytest.mark.slow)
            for name in WAYS],
)  # fmt: skip
def test_a_run_that_is_ended_halts_the_arm_and_leaves_a_report_and_no_process(
    way: str, tmp_path: Path
) -> None:
    outcome = end_by(way, SPEED, tmp_path)
    assert outcome["ok"], outcome


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("stage", STAGES)
def test_a_start_after_a_kill_moves_nothing_and_lets_nothing_go(stage: str, tmp_path: Path) -> None:
    outcome = kill_in(stage, SPEED, tmp_path)
    assert outcome["ok"], outcome
