"""Every end is a stop, and a start after a kill moves nothing.

The emulated cell is a process of its own here; what moved is its own word.
"""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from ends import WAYS, end_by
from kill_world import kill_world, let_go_count, lines_of, start

SPEED = 10.0
RECIPE, PART, CELL_SEED = "recipes/holder.yaml", "recipes/parts/holder.stl", 8


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("way", WAYS)
def test_a_run_that_is_ended_halts_the_arm_and_leaves_a_report_and_no_process(
    way: str, tmp_path: Path
) -> None:
    outcome = end_by(way, SPEED, tmp_path)
    assert outcome["ok"], outcome


@pytest.mark.slow
@pytest.mark.timeout(900)
# states of the cell, and one of custody: while the fixed gripper alone has the part
@pytest.mark.parametrize("stage", ["presenting", "handing", "in_fixture", "placing"])
def test_a_start_after_a_kill_moves_nothing_and_lets_nothing_go(stage: str, tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    with kill_world(tmp_path, PART, seed=CELL_SEED, speed=SPEED) as world:
        with start(world, RECIPE, runs) as first:
            for line in lines_of(first):
                if stage in (line.get("state"), line.get("custody")):
                    world.until_moving()
                    os.kill(first.pid, signal.SIGKILL)
                    break
        killed = world.when_still()
        with start(world, RECIPE, runs) as second:
            *_, result = lines_of(second)
        after = world.when_still()
        # the operator takes the part out by hand and says so
        for gripper in ("arm", "fixture"):
            world.ask("lose_part", gripper=gripper)
        world.ask("remove")
        reached = ""
        with start(world, RECIPE, runs, "--part-removed") as third:
            for line in lines_of(third):
                reached = line.get("state", line.get("message"))
                if reached == "acquiring":
                    break
            os.kill(third.pid, signal.SIGKILL)
    assert (second.returncode, result["end"]) == (1, "refused"), result
    assert let_go_count(after) == let_go_count(killed)
    assert after["last_motion_s"] == killed["last_motion_s"]
    assert after["parts"][0]["T_world_part"] == killed["parts"][0]["T_world_part"]
    assert reached == "acquiring"
